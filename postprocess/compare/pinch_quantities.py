"""Quantities of two fingers that close: their pair of vortices, the flow between them, and the single finger beside."""

from __future__ import annotations

import numpy as np
import pandas as pd

from postprocess.evidence import centreline
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence import vortex_pairs as pairs
from postprocess.evidence.evidence import Evidence, Quantity, Window


def paired_tips(evidence: Evidence, source: str, window: Window) -> pd.DataFrame:
    """Pairs of tip vortices of a source inside a window (s); ValueError where the scene has one finger or there is no pair."""
    if source not in evidence.pairs:
        raise ValueError("the scene has one finger, so there is no pair of vortices")
    return pairs.within(evidence.pairs[source], window)


def _lines(evidence: Evidence, source: str, window: Window) -> pd.DataFrame:
    if source not in evidence.lines:
        raise ValueError("the scene has one finger, so there is no plane between two")
    rows = evidence.lines[source]
    rows = rows[rows["time"].between(*window)]
    if rows.empty:
        raise ValueError(f"{source}: no instant between {window[0]:.3f} and {window[1]:.3f} s")
    return rows


def _side(evidence: Evidence, source: str, window: Window, finger: int) -> str:
    return pairs.both_sides(paired_tips(evidence, source, window))


def _senses(evidence: Evidence, source: str, window: Window, finger: int) -> str:
    return pairs.senses(paired_tips(evidence, source, window))


def _imbalance(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return pairs.rms(paired_tips(evidence, source, window)["imbalance"])


def _mirror_distance(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return pairs.rms(paired_tips(evidence, source, window)["mirror_distance"])


def _coverage(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    rows = paired_tips(evidence, source, window)
    times = evidence.planes[source]["time"].values
    return float(len(rows) / max(int(((times >= window[0]) & (times <= window[1])).sum()), 1))


def shift(evidence: Evidence, source: str, window: Window, name: str) -> float:
    """Mean shift (m) of the pinch's vortices against the single finger's at the same bend, in a column `name`."""
    if source not in evidence.single:
        raise FileNotFoundError(evidence.single_absent or "no single finger was run with this source")
    rows = paired_tips(evidence, source, window)
    cfd = evidence.planes["cfd"]
    bend = np.interp(rows["time"], cfd["time"].values, cfd["bend"].values[:, 0])
    single = evidence.single[source]
    span = (bend.min() - 1e-9, bend.max() + 1e-9)
    times = single.loc[single["bend"].between(*span), "time"]
    if times.empty:
        raise ValueError("the single finger has no vortex at the bend angles of this window")
    track = tracks.dominant_track(
        single, 0, (float(times.min()), float(times.max())), f"single finger, {source}"
    )
    return pairs.shift_at_equal_bend(rows, bend, track, track["bend"].to_numpy(float), name)


def _ventral_shift(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return -shift(evidence, source, window, "across_tip")


def _forward_shift(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return shift(evidence, source, window, "along_tip")


def _followed(evidence: Evidence, source: str, window: Window, finger: int) -> pd.DataFrame:
    """The dominant track of a finger inside a window; ValueError where it does not last through half of it."""
    track = tracks.dominant_track(evidence.vortices[source], finger, window, f"vortices of {source}")
    rows = track[track["time"].between(*window)]
    if rows["time"].iloc[-1] - rows["time"].iloc[0] < 0.5 * (window[1] - window[0]):
        raise ValueError(
            f"vortices of {source}: the vortex of finger {finger} is followed from {rows['time'].iloc[0]:.3f} to"
            f" {rows['time'].iloc[-1]:.3f} s only, less than half of {window[0]:.3f} to {window[1]:.3f} s"
        )
    return rows


def _descent(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    rows = _followed(evidence, source, window, finger)
    return float(rows["y"].iloc[0] - rows["y"].iloc[-1])


def _dorsal_drift(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    rows = _followed(evidence, source, window, finger)
    return float(rows["across_tip"].iloc[-1] - rows["across_tip"].iloc[0])


def _parting_share(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return float(_lines(evidence, source, window)["stagnation_y"].notna().mean())


def _jet_peak(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return float(_lines(evidence, source, window)["jet_speed"].max()) / evidence.scale


def _oblique(evidence: Evidence, source: str, window: Window, above: bool) -> tuple[float, float, float]:
    return centreline.oblique_flow(evidence.planes[source], _lines(evidence, source, window), window, above)


def _rise_share(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _oblique(evidence, source, window, True)[1]


def _rise_speed(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _oblique(evidence, source, window, True)[0] / evidence.scale


def _rise_angle(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _oblique(evidence, source, window, True)[2]


def _fall_share(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _oblique(evidence, source, window, False)[1]


def _fall_angle(evidence: Evidence, source: str, window: Window, finger: int) -> float:
    return _oblique(evidence, source, window, False)[2]


PINCH_QUANTITIES: dict[str, Quantity] = {
    "pair_side": Quantity(_side, "", "side of the tip on which the vortices of both fingers lie"),
    "pair_senses": Quantity(_senses, "", "senses of rotation of the two tip vortices"),
    "pair_imbalance": Quantity(
        _imbalance, "fraction", "RMS over the instants of |Γ0 + Γ1| over the mean of |Γ0| and |Γ1|"
    ),
    "pair_mirror_distance": Quantity(
        _mirror_distance, "m", "RMS distance of one vortex centre from the mirror image of the other"
    ),
    "pair_coverage": Quantity(_coverage, "fraction", "share of instants at which both tips have a vortex"),
    "ventral_shift": Quantity(
        _ventral_shift, "m", "mean shift towards the ventral side against the single finger at the same bend"
    ),
    "forward_shift": Quantity(
        _forward_shift, "m", "mean shift along the tip's direction against the single finger at the same bend"
    ),
    "vortex_descent": Quantity(
        _descent,
        "m",
        "how far the finger's strongest vortex sinks from the window's first to its last instant",
    ),
    "dorsal_drift": Quantity(
        _dorsal_drift, "m", "how far that vortex moves towards the dorsal side, as seen from the tip"
    ),
    "parting_share": Quantity(
        _parting_share,
        "fraction",
        "share of instants at which the flow between the fingers parts into up and down",
    ),
    "jet_peak": Quantity(
        _jet_peak, "fraction", "peak downward speed between and below the tips, over the peak tip speed"
    ),
    "rise_share": Quantity(
        _rise_share,
        "fraction",
        "share of the area between the fingers above the parting line in which water rises",
    ),
    "rise_speed": Quantity(
        _rise_speed,
        "fraction",
        "mean upward velocity between the fingers above the parting line, over the peak tip speed",
    ),
    "rise_angle": Quantity(_rise_angle, "rad", "angle from the vertical of the flow above the parting line"),
    "fall_share": Quantity(
        _fall_share, "fraction", "share of the area below the parting line in which water sinks"
    ),
    "fall_angle": Quantity(_fall_angle, "rad", "angle from the vertical of the flow below the parting line"),
}
