"""What a finding can be about: each quantity is a pure function of a part of the evidence."""

from __future__ import annotations

import pandas as pd

from postprocess.compare.pinch_quantities import PINCH_QUANTITIES
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.evidence import Part, Quantity
from postprocess.evidence.wake_trace import trace_velocity


def paired(part: Part) -> pd.DataFrame:
    """The tip's vortex in a pair of sources such as "piv-cfd" beside each other; the second source is the reference."""
    other, reference = part.of.split("-")
    tables = part.evidence.vortices
    track = tracks.dominant_track(tables[other], part.finger, part.window, f"vortices of {other}")
    # says so where the reference has none
    tracks.dominant_track(tables[reference], part.finger, part.window, f"vortices of {reference}")
    return tracks.pair_tracks(
        tracks.counterpart(tables[reference], track, part.finger, part.window), track
    )


def _paired_within(part: Part) -> pd.DataFrame:
    return tracks.within(paired(part), part.window)


def _dominant(part: Part) -> pd.DataFrame:
    """The rows of the tip's strongest vortex in the window."""
    table = part.evidence.vortices[part.of]
    return part.inside(
        tracks.dominant_track(table, part.finger, part.window, f"vortices of {part.of}")
    )


def _rival_fraction(part: Part) -> float:
    ranking = tracks.strengths(part.evidence.vortices[part.of], part.finger, part.window)
    if ranking.empty:
        raise ValueError(
            f"vortices of {part.of}: none near the tip of finger {part.finger} in the window"
        )
    return float(ranking.iloc[1] / ranking.iloc[0]) if len(ranking) > 1 else 0.0


def _velocity_sums(part: Part) -> pd.DataFrame:
    return part.inside(part.evidence.sums[part.of])


def _trace(part: Part) -> tuple[float, float]:
    since = max(
        (start for start in part.evidence.clock.starts if start <= part.window[0]), default=0.0
    )
    return trace_velocity(part.evidence.planes[part.of], part.window, part.finger, since)


QUANTITIES: dict[str, Quantity] = {
    "dominant_side": Quantity(
        lambda p: str(_dominant(p)["side"].mode().iloc[0]),
        "", "side of the tip on which the strongest vortex lies"),
    "dominant_sense": Quantity(
        lambda p: "counter-clockwise" if _dominant(p)["circulation"].mean() > 0 else "clockwise",
        "", "sense of rotation of the strongest vortex"),
    "rival_fraction": Quantity(
        _rival_fraction,
        "fraction", "circulation of the next strongest vortex near the tip, as a part of the strongest"),
    "tip_distance": Quantity(
        lambda p: float(_dominant(p)["tip_distance"].mean()),
        "tip widths", "mean distance of the vortex from the tip"),
    "track_coverage": Quantity(
        lambda p: p.share(len(_dominant(p))),
        "fraction", "share of instants at which the vortex is found"),
    "circulation_difference": Quantity(
        lambda p: tracks.circulation_difference(_paired_within(p)),
        "fraction", "RMS difference of circulation, over the RMS circulation of the reference"),
    "centre_distance": Quantity(
        lambda p: tracks.centre_distance(_paired_within(p)),
        "m", "RMS distance between the two vortex centres"),
    "centre_distance_relative": Quantity(
        lambda p: tracks.centre_distance(_paired_within(p)) / float(p.evidence.planes["cfd"].attrs["tip_width"]),
        "tip widths", "RMS distance between the two vortex centres"),
    "velocity_rms_difference": Quantity(
        lambda p: fields.rms_difference(_velocity_sums(p)) / p.evidence.scale,
        "fraction", "RMS velocity difference over the peak tip speed"),
    "velocity_correlation": Quantity(
        lambda p: fields.correlation(_velocity_sums(p)),
        "1", "correlation of the two velocity fields"),
    "trace_upward_velocity": Quantity(
        lambda p: _trace(p)[0] / p.evidence.scale,
        "fraction", "mean upward velocity where the finger has passed, over the peak tip speed"),
    "trace_upward_share": Quantity(
        lambda p: _trace(p)[1],
        "fraction", "share of the area where the finger has passed in which water rises"),
    **PINCH_QUANTITIES,
}  # fmt: skip
