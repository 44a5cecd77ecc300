"""What a finding can be about: each quantity is a pure function of the evidence, a source and a window of time."""

from __future__ import annotations

import pandas as pd

from postprocess.compare.pinch_quantities import PINCH_QUANTITIES
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence import wake_trace as traces
from postprocess.evidence.evidence import Evidence, Quantity, Window


def _track(evidence: Evidence, source: str, window: Window, finger: int) -> pd.DataFrame:
    return tracks.dominant_track(evidence.vortices[source], finger, window, f"vortices of {source}")


def paired(evidence: Evidence, pair: str, window: Window, finger: int) -> pd.DataFrame:
    """The tip's vortex in a pair of sources such as "piv-cfd" side by side; the second name is the reference."""
    other, reference = pair.split("-")
    seen = _track(evidence, other, window, finger)
    _track(evidence, reference, window, finger)  # says so where the reference has none
    return tracks.pair_tracks(tracks.counterpart(evidence.vortices[reference], seen, finger, window), seen)


def _dominant_side(evidence: Evidence, source: str, window: Window, finger: int) -> str:
    track = _track(evidence, source, window, finger)
    return str(track.loc[track["time"].between(*window), "side"].mode().iloc[0])


def _dominant_sense(evidence: Evidence, source: str, window: Window, finger: int) -> str:
    track = _track(evidence, source, window, finger)
    mean = track.loc[track["time"].between(*window), "circulation"].mean()
    return "counter-clockwise" if mean > 0 else "clockwise"


def _rival_fraction(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    ranking = tracks.strengths(evidence.vortices[source], finger, window)
    if ranking.empty:
        raise ValueError(f"vortices of {source}: none near the tip of finger {finger} in the window")
    return float(ranking.iloc[1] / ranking.iloc[0]) if len(ranking) > 1 else 0.0


def _tip_distance(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    track = _track(evidence, source, window, finger)
    return float(track.loc[track["time"].between(*window), "tip_distance"].mean())


def _track_coverage(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    track = _track(evidence, source, window, finger)
    times = evidence.planes[source]["time"].values
    instants = int(((times >= window[0]) & (times <= window[1])).sum())
    return float(track["time"].between(*window).sum() / max(instants, 1))


def _circulation_difference(evidence: Evidence, pair: str, window: Window, finger: int) -> float:
    return tracks.circulation_difference(tracks.within(paired(evidence, pair, window, finger), window))


def _centre_distance(evidence: Evidence, pair: str, window: Window, finger: int) -> float:
    return tracks.centre_distance(tracks.within(paired(evidence, pair, window, finger), window))


def _velocity_difference(evidence: Evidence, pair: str, window: Window, finger: int) -> float:
    sums = evidence.sums[pair]
    return fields.rms_difference(sums[sums["time"].between(*window)]) / evidence.scale


def _velocity_correlation(evidence: Evidence, pair: str, window: Window, finger: int) -> float:
    sums = evidence.sums[pair]
    return fields.correlation(sums[sums["time"].between(*window)])


def _trace(evidence: Evidence, source: str, window: Window, finger: int) -> tuple[float, float]:
    since = max((start for start in evidence.starts if start <= window[0]), default=0.0)
    return traces.trace_velocity(evidence.planes[source], window, finger, since)


def _trace_upward(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _trace(evidence, source, window, finger)[0] / evidence.scale


def _trace_upward_share(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _trace(evidence, source, window, finger)[1]


QUANTITIES: dict[str, Quantity] = {
    "dominant_side": Quantity(_dominant_side, "", "side of the tip on which the strongest vortex lies"),
    "dominant_sense": Quantity(_dominant_sense, "", "sense of rotation of the strongest vortex"),
    "rival_fraction": Quantity(
        _rival_fraction,
        "fraction",
        "circulation of the next strongest vortex near the tip, as a part of the strongest",
    ),
    "tip_distance": Quantity(_tip_distance, "tip widths", "mean distance of the vortex from the tip"),
    "track_coverage": Quantity(_track_coverage, "fraction", "share of instants at which the vortex is found"),
    "circulation_difference": Quantity(
        _circulation_difference,
        "fraction",
        "RMS difference of circulation, over the RMS circulation of the reference",
    ),
    "centre_distance": Quantity(_centre_distance, "m", "RMS distance between the two vortex centres"),
    "velocity_rms_difference": Quantity(
        _velocity_difference, "fraction", "RMS velocity difference over the peak tip speed"
    ),
    "velocity_correlation": Quantity(_velocity_correlation, "1", "correlation of the two velocity fields"),
    "trace_upward_velocity": Quantity(
        _trace_upward, "fraction", "mean upward velocity where the finger has passed, over the peak tip speed"
    ),
    "trace_upward_share": Quantity(
        _trace_upward_share, "fraction", "share of the area where the finger has passed in which water rises"
    ),
    **PINCH_QUANTITIES,
}
