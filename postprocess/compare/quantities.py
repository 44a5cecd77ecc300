"""What a finding can be about: each quantity is a pure function of a part of the evidence."""

import pandas as pd

from postprocess.compare.pinch_quantities import PINCH_QUANTITIES
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.evidence import Part, Quantity
from postprocess.evidence.wake_trace import trace_velocity
from postprocess.words import quantity


def paired(part: Part) -> pd.DataFrame:
    """The tip's vortex in a pair such as "piv-cfd", side by side in the window of the part."""
    tables, finger, window = part.evidence.vortices, part.finger, part.window
    sources = part.of.split("-")
    # Also of the reference, to say so where it has no vortex.
    track, _ = (
        tracks.dominant_track(tables[source], finger, window, f"vortices of {source}")
        for source in sources
    )
    pair = tracks.pair_tracks(tracks.counterpart(tables[sources[1]], track, finger, window), track)
    return tracks.within(pair, window)


def _known_instants(part: Part) -> tuple[int, int]:
    """At how many instants of how many both circulations are known."""
    known = paired(part)["known"]
    return int(known.sum()), len(known)


def _dominant(part: Part) -> pd.DataFrame:
    """The rows of the tip's strongest vortex in the window."""
    table, name = part.evidence.vortices[part.of], f"vortices of {part.of}"
    return part.inside(tracks.dominant_track(table, part.finger, part.window, name))


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
    earlier = (start for start in part.evidence.clock.starts if start <= part.window[0])
    plane = part.evidence.planes[part.of]
    return trace_velocity(plane, part.window, part.finger, max(earlier, default=0.0))


def _tip_width(part: Part) -> float:
    return float(part.evidence.planes["cfd"].attrs["tip_width"])


QUANTITIES: dict[str, Quantity] = {
    "dominant_side": Quantity(
        lambda p: str(_dominant(p)["side"].mode().iloc[0]),
        "",
        "side of the tip on which the strongest vortex lies",
    ),
    "dominant_sense": Quantity(
        lambda p: "counter-clockwise" if _dominant(p)["circulation"].mean() > 0 else "clockwise",
        "",
        "sense of rotation of the strongest vortex",
    ),
    "rival_fraction": Quantity(
        _rival_fraction,
        "fraction",
        "circulation of the next strongest vortex near the tip, as a part of the strongest",
    ),
    "tip_distance": Quantity(
        lambda p: float(_dominant(p)["tip_distance"].mean()),
        "tip widths",
        "mean distance of the vortex from the tip",
    ),
    "track_coverage": Quantity(
        lambda p: p.share(len(_dominant(p))),
        "fraction",
        "share of instants at which the vortex is found",
    ),
    "circulation_difference": Quantity(
        lambda p: tracks.relative_difference(paired(p).query("known"), "circulation"),
        "fraction",
        "RMS difference of circulation, over the RMS circulation of the reference, where both are"
        f" known to {quantity(tracks.KNOWN, 'fraction')}",
        _known_instants,
    ),
    "centre_distance": Quantity(
        lambda p: tracks.centre_distance(paired(p)),
        "m",
        "RMS distance between the two vortex centres",
    ),
    "centre_distance_relative": Quantity(
        lambda p: tracks.centre_distance(paired(p)) / _tip_width(p),
        "tip widths",
        "RMS distance between the two vortex centres",
    ),
    "velocity_rms_difference": Quantity(
        lambda p: fields.rms_difference(_velocity_sums(p)) / p.evidence.scale,
        "fraction",
        "RMS velocity difference over the peak tip speed",
    ),
    "velocity_correlation": Quantity(
        lambda p: fields.correlation(_velocity_sums(p)),
        "1",
        "correlation of the two velocity fields",
    ),
    "trace_upward_velocity": Quantity(
        lambda p: _trace(p)[0] / p.evidence.scale,
        "fraction",
        "mean upward velocity where the finger has passed, over the peak tip speed",
    ),
    "trace_upward_share": Quantity(
        lambda p: _trace(p)[1],
        "fraction",
        "share of the area where the finger has passed in which water rises",
    ),
    **PINCH_QUANTITIES,
}
