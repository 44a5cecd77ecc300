"""Quantities of two fingers that close: their vortices, the flow between, the single finger."""

import numpy as np
import pandas as pd

from postprocess.evidence import centreline
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence import vortex_pairs as pairs
from postprocess.evidence.evidence import Part, Quantity
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, formed, pair_of, vortex_of
from postprocess.words import quantity


def _of_pair(part: Part, tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """A source's table of two fingers; ValueError where the scene has one."""
    if part.of not in tables:
        raise ValueError("the scene has one finger, so there is no pair and no plane between two")
    return tables[part.of]


def _paired_tips(part: Part) -> pd.DataFrame:
    """Pairs of tip vortices in the window; ValueError where there is none."""
    absent = "the two tips never have a vortex each"
    return tracks.within(_of_pair(part, part.evidence.pairs), part.window, absent)


def _known_pairs(part: Part) -> pd.DataFrame:
    """Return the pairs of which both circulations are known."""
    rows = _paired_tips(part)
    return rows[tracks.known(rows, "_0") & tracks.known(rows, "_1")]


def _lines(part: Part) -> pd.DataFrame:
    rows = part.inside(_of_pair(part, part.evidence.lines))
    if rows.empty:
        raise ValueError(f"{part.of}: no instant {part.words()}")
    return rows


def _ventral_shift(part: Part) -> float:
    """Mean shift (m) of the pinch's vortices against the single finger's at the same bend."""
    evidence = part.evidence
    if part.of not in evidence.single:
        raise FileNotFoundError(
            evidence.single_absent or "no single finger was run with this source"
        )
    rows = _paired_tips(part)
    bend = np.interp(rows["time"], evidence.clock.time, evidence.clock.progress)
    single = evidence.single[part.of]
    times = single.loc[single["bend"].between(bend.min() - 1e-9, bend.max() + 1e-9), "time"]
    if times.empty:
        raise ValueError("the single finger has no vortex at the bend angles of this window")
    window = (float(times.min()), float(times.max()))
    track = tracks.dominant_track(single, 0, window, f"single finger, {part.of}")
    to_bend = track["bend"].to_numpy(float)
    return -pairs.shift_at_equal_bend(rows, bend, track, to_bend, "across_tip")


def _oblique(part: Part, above: bool) -> centreline.Oblique:
    return centreline.oblique_flow(part.evidence.planes[part.of], _lines(part), part.window, above)


def _integrals(part: Part) -> pd.DataFrame:
    return part.inside(_of_pair(part, part.evidence.integrals))


def _ventral(part: Part) -> pd.DataFrame:
    """The ventral pair with upward flow between; ValueError where it is never there."""
    rows = pair_of(_integrals(part), *VENTRAL)
    if rows.empty:
        raise ValueError(
            f"{part.of}: no pair of vortices with upward flow between them on the ventral side"
            f" {part.words()}"
        )
    return rows


def _forming_gap(part: Part) -> float:
    """The gap (m) that is still to close when the ventral pair forms; 0 from contact on."""
    plane, clock = part.evidence.planes[part.of], part.evidence.clock
    times = plane["time"].values
    times = times[(times >= part.window[0]) & (times <= part.window[1])]
    at = formed(times, _ventral(part), plane.attrs["tip_width"])
    if at is None:
        raise ValueError(
            f"{part.of}: the pair on the ventral side never lasts, or is older than the first"
            f" instant, {part.words()}"
        )
    met = clock.met()
    if met is not None and at >= met:
        return 0.0  # tips that rebound open the gap again
    return float(clock.gap_at(np.array([at]))[0]) - clock.residual_gap


def _measured(part: Part) -> pd.DataFrame:
    """Return the rows of `_integrals` whose circulation is measured; ValueError without one."""
    rows = _integrals(part)
    if rows["circulation"].notna().any():
        return rows[rows["circulation"].notna()]
    raise ValueError(f"{part.of}: the circulation of no vortex is measured {part.words()}")


def _strongest(rows: pd.DataFrame, *by: str) -> pd.DataFrame:
    """The row of largest |circulation|, which is a number, in each group."""
    return rows.loc[rows.groupby(list(by))["circulation"].apply(lambda c: c.abs().idxmax())]


def _ventral_flow(part: Part) -> str:
    """The flow between the two strongest vortices on the ventral side at most instants."""
    rows = _measured(part)
    rows = rows[(rows["side"] == "ventral") & (rows["finger"] == 0)]
    if rows.empty:
        raise ValueError(f"{part.of}: no vortex on the ventral side {part.words()}")
    return str(_strongest(rows, "time")["flow"].mode().iloc[0])


def _side(part: Part) -> str:
    """Usual side of the strongest vortex of either finger; "different" if they differ."""
    rows = _measured(part)
    if set(rows["finger"]) != {0, 1}:
        raise ValueError(f"{part.of}: no vortex at both tips {part.words()}")
    strongest = _strongest(rows, "time", "finger")
    left, right = (
        strongest.loc[strongest["finger"] == finger, "side"].mode().iloc[0] for finger in (0, 1)
    )
    return str(left) if left == right else "different"


def _dorsal(part: Part) -> pd.DataFrame:
    """A finger's vortex of the dorsal pair, with `across_tip` (m).

    ValueError where it is not one vortex throughout half of the window.
    """
    rows, plane = vortex_of(_integrals(part), *DORSAL, part.finger), part.evidence.planes[part.of]
    lasted = float(np.ptp(rows["time"])) if len(rows) else 0.0
    vortex = f"{part.of}: the dorsal vortex of finger {part.finger}"
    if lasted < 0.5 * (part.window[1] - part.window[0]):
        raise ValueError(f"{vortex} is there for {lasted:.3f} s {part.words()}")
    if (np.hypot(rows["x"].diff(), rows["y"].diff()) >= plane.attrs["tip_width"]).any():
        raise ValueError(f"{vortex} jumps by a tip width {part.words()}")
    finger = plane[["tip", "dorsal_direction"]].isel(finger=part.finger)
    finger = finger.sel(time=rows["time"].to_numpy())
    from_tip = rows[["x", "y"]].to_numpy() - finger["tip"].values
    return rows.assign(across_tip=(from_tip * finger["dorsal_direction"].values).sum(axis=1))


def _travelled(part: Part, column: str) -> float:
    """Change of a column from the first to the last instant of the dorsal vortex."""
    values = _dorsal(part)[column]
    return float(values.iloc[-1] - values.iloc[0])


PINCH_QUANTITIES: dict[str, Quantity] = {
    "pair_side": Quantity(
        _side,
        "",
        "side of the tip on which the strongest vortex of either finger lies",
    ),
    "pair_senses": Quantity(
        lambda p: pairs.senses(_paired_tips(p)),
        "",
        "senses of rotation of the two tip vortices",
    ),
    "pair_imbalance": Quantity(
        lambda p: tracks.rms(_known_pairs(p)["imbalance"]),
        "fraction",
        "RMS of |Γ0 + Γ1| over the mean of |Γ0| and |Γ1|, where both are known to"
        f" {quantity(tracks.KNOWN, 'fraction')}",
        lambda p: (len(_known_pairs(p)), len(_paired_tips(p))),
    ),
    "pair_mirror_distance": Quantity(
        lambda p: tracks.rms(_paired_tips(p)["mirror_distance"]),
        "m",
        "RMS distance of one vortex centre from the mirror image of the other",
    ),
    "ventral_pair_share": Quantity(
        lambda p: p.share(len(pair_of(_integrals(p), *VENTRAL))),
        "fraction",
        "share of instants with a pair of vortices on the ventral side and upward flow between"
        " them",
    ),
    "ventral_pair_flow": Quantity(
        _ventral_flow,
        "",
        "direction of the flow between the two strongest vortices on the ventral side",
    ),
    "ventral_pair_rise": Quantity(
        lambda p: float(_ventral(p)["between"].mean()) / p.evidence.scale,
        "fraction",
        "mean upward velocity midway between the two vortices on the ventral side, over the peak"
        " tip speed",
    ),
    "ventral_pair_gap": Quantity(
        _forming_gap,
        "m",
        "gap still to close to the residual one when that pair forms: there at every instant for"
        " 20 ms, moving less than a tip width from one to the next",
    ),
    "pair_coverage": Quantity(
        lambda p: p.share(len(_paired_tips(p))),
        "fraction",
        "share of instants at which both tips have a vortex",
    ),
    "ventral_shift": Quantity(
        _ventral_shift,
        "m",
        "mean shift towards the ventral side against the single finger at the same bend",
    ),
    "vortex_descent": Quantity(
        lambda p: -_travelled(p, "y"),
        "m",
        "how far the finger's vortex of the dorsal pair sinks from the window's first to its last"
        " instant",
    ),
    "dorsal_drift": Quantity(
        lambda p: _travelled(p, "across_tip"),
        "m",
        "how far that vortex moves towards the dorsal side, as seen from the tip",
    ),
    "parting_share": Quantity(
        lambda p: float(_lines(p)["stagnation_y"].notna().mean()),
        "fraction",
        "share of instants at which the flow between the fingers parts into up and down",
    ),
    "jet_peak": Quantity(
        lambda p: float(_lines(p)["jet_speed"].max()) / p.evidence.scale,
        "fraction",
        "peak downward speed between and below the tips, over the peak tip speed",
    ),
    "rise_share": Quantity(
        lambda p: _oblique(p, True).share,
        "fraction",
        "share of the area between the fingers above the parting line in which water rises",
    ),
    "rise_angle": Quantity(
        lambda p: _oblique(p, True).angle,
        "rad",
        "angle from the vertical of the flow above the parting line",
    ),
    "fall_share": Quantity(
        lambda p: _oblique(p, False).share,
        "fraction",
        "share of the area below the parting line in which water sinks",
    ),
    "fall_angle": Quantity(
        lambda p: _oblique(p, False).angle,
        "rad",
        "angle from the vertical of the flow below the parting line",
    ),
}
