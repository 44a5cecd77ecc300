"""Vortex tables: the dominant vortex of a tip, and two of them against each other."""

from pathlib import Path

import numpy as np
import pandas as pd

from piv.formats import vortex_table

REACH = 2.5  # tip widths; a vortex further off is not the tip's
RIVAL = 0.5  # of the strongest's circulation: may be the vortex that another source sees
KNOWN = 0.05  # standard uncertainty over circulation: a vortex that a wall hides is known less
ENOUGH = 1 / 3  # of the instants; a circulation that is known at fewer is not judged
# instants of a window that is judged: the mean of four, each known to KNOWN, is known to half of
# the 5 % by which a circulation may differ
FEWEST = 4
COMPARED = ("circulation", "x", "y", "radius", "peak_vorticity")


def read_vortices(path: Path) -> pd.DataFrame:
    """The table of vortices `of_disc`, sorted by time."""
    names = (*vortex_table.NEEDED, "track", "finger", "side", "tip_distance")
    return of_disc(vortex_table.read_vortices(path, names).sort_values("time", ignore_index=True))


def of_disc(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the disc's circulation, half a tip's width in radius, as `circulation`.

    Grids and windows agree in it, in the whole one beside a body less (docs/vortices.md). That of
    the fit stays `circulation_fit`.
    """
    ends = [end for end in ("", "_std", "_random_std") if f"circulation_disc{end}" in table]
    names = {f"circulation_disc{end}": f"circulation{end}" for end in ends}
    return table.drop(columns=[*names.values()], errors="ignore").rename(columns=names)


def strengths(table: pd.DataFrame, finger: int, window: tuple[float, float]) -> pd.Series:
    """Mean |circulation| (m²/s) of each track near the tip over the window, strongest first.

    A track counts as zero at instants where it is absent, so that a flicker cannot win. Vortices
    at the edge of what is seen, which are not measured, do not count.
    """
    inside = table[table["time"].between(*window)]
    near = inside[(inside["finger"] == finger) & (inside["tip_distance"] <= REACH)]
    near = near[near["circulation"].notna()]
    instants = inside["time"].nunique()
    total = near["circulation"].abs().groupby(near["track"]).sum()
    return (total / max(instants, 1)).sort_values(ascending=False)


def dominant_track(
    table: pd.DataFrame, finger: int, window: tuple[float, float], name: str
) -> pd.DataFrame:
    """All rows of the track that is strongest near the tip over the window; ValueError if none."""
    ranking = strengths(table, finger, window)
    if ranking.empty:
        raise ValueError(
            f"{name}: no vortex within {REACH:g} tip widths of the tip of finger {finger}"
            f" between {window[0]:.3f} and {window[1]:.3f} s"
        )
    return table[table["track"] == ranking.index[0]].reset_index(drop=True)


def counterpart(
    table: pd.DataFrame, of: pd.DataFrame, finger: int, window: tuple[float, float]
) -> pd.DataFrame:
    """The track of `table` that is the same vortex as the track `of` another source.

    Vortices of one sense may share a tip: the nearest over the window is taken among those at
    least half as strong as the strongest.
    """
    ranking = strengths(table, finger, window)
    rivals = ranking.index[ranking >= RIVAL * ranking.iloc[0]]
    candidates = {name: table[table["track"] == name].reset_index(drop=True) for name in rivals}

    def distance(name: int) -> float:
        rows = pair_tracks(candidates[name], of)
        rows = rows[rows["time"].between(*window)]
        return centre_distance(rows) if len(rows) else np.inf

    return candidates[min(rivals, key=distance)]


def dominant_tracks(
    tables: dict[str, pd.DataFrame], finger: int, window: tuple[float, float]
) -> dict[str, pd.DataFrame]:
    """The tip's vortex by source: the dominant track of the last, and its counterparts before.

    A source without a vortex near the tip is left out.
    """
    seen = {s: t for s, t in tables.items() if not strengths(t, finger, window).empty}
    if not seen:
        return {}
    *others, last = seen
    chosen = dominant_track(seen[last], finger, window, last)
    return {s: counterpart(seen[s], chosen, finger, window) for s in others} | {last: chosen}


def pair_tracks(reference: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """`reference` linear in time at those of `other`'s instants at which it exists, beside `other`.

    Columns: time, each of COMPARED that both have with _reference and _other, centre_distance (m),
    and whether both circulations are `known` to KNOWN.
    """
    sure = (rows.assign(known=known(rows).astype(float)) for rows in (reference, other))
    then, at = common_instants(*sure)
    pair = pd.DataFrame({"time": at["time"]})
    for name in reference.columns.intersection(other.columns).intersection(COMPARED):
        pair[f"{name}_reference"], pair[f"{name}_other"] = then[name], at[name]
    pair["known"] = (then["known"] == 1.0) & (at["known"] == 1.0)
    dx, dy = pair["x_other"] - pair["x_reference"], pair["y_other"] - pair["y_reference"]
    return pair.assign(centre_distance=np.hypot(dx, dy))


def common_instants(
    reference: pd.DataFrame, other: pd.DataFrame
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The numbers of two series at those of `other`'s instants at which both exist.

    `reference` is linear in time between its rows.
    """
    ends = reference["time"].agg(["min", "max"]).tolist()
    inside = other["time"].between(ends[0] - 1e-9, ends[1] + 1e-9)
    at = other[inside].reset_index(drop=True)
    numbers = reference.select_dtypes(["number", "boolean"]).astype(float)
    then = {
        name: np.interp(at["time"], reference["time"], numbers[name]) if len(at) else []
        for name in numbers
    }
    return pd.DataFrame(then), at


def common_means(
    tips: dict[str, pd.DataFrame], window: tuple[float, float]
) -> dict[str, dict[str, float]]:
    """Means of COMPARED by source over a window (s), with the number of `instants`.

    Of two sources both are of the same instants: of those at which both circulations are known,
    or, where there is none, of those at which both find the vortex. None: no such instant.
    """
    rows = {source: track[track["time"].between(*window)] for source, track in tips.items()}
    if len(tips) == 2:
        (one, reference), (two, other) = tips.items()
        pair = pair_tracks(reference, other)
        pair = pair[pair["time"].between(*window)]
        pair = pair[pair["known"]] if pair["known"].any() else pair
        ends = {one: "_reference", two: "_other"}
        rows = {
            source: pd.DataFrame({n: pair[n + end] for n in COMPARED if n + end in pair})
            for source, end in ends.items()
        }
    return {
        source: {str(name): float(of[name].mean()) for name in of.columns.intersection(COMPARED)}
        | {"instants": len(of)}
        for source, of in rows.items()
        if len(of)
    }


def known_window(
    tables: dict[str, pd.DataFrame], stroke: tuple[float, float], least: float = 0.0
) -> tuple[float, float] | None:
    """First and last instant (s) of a stroke at which every source knows the tip's vortex.

    Where the circulation is known at less than ENOUGH of them: at which both find the vortex. The
    uncertainty of PIV would pick its own instants where these are few. None with fewer than FEWEST,
    for less than `least` (s), or for less than ENOUGH of the time for which the first source, the
    flow, has that vortex.
    """
    tips = dominant_tracks(tables, 0, stroke)
    if len(tips) < 2:
        return None
    pair = pair_tracks(*tips.values())
    pair = pair[pair["time"].between(*stroke)]
    sure = pair[pair["known"]] if pair["known"].sum() >= max(FEWEST, ENOUGH * len(pair)) else pair
    there = next(iter(tips.values()))["time"].clip(*stroke)
    times = sure["time"]
    if len(times) < FEWEST or np.ptp(times) < max(least, ENOUGH * np.ptp(there)) - 1e-9:
        return None
    return float(times.min()), float(times.max())


def known(rows: pd.DataFrame, of: str = "") -> pd.Series:
    """Whether the circulation is known to KNOWN; a table without uncertainties says so of all.

    `of`: end of the columns' names, as "_0" of a pair's left vortex.
    """
    std = rows.get(f"circulation_std{of}", pd.Series(0.0, rows.index))
    return std.astype(float) <= KNOWN * rows[f"circulation{of}"].abs()


def within(
    pair: pd.DataFrame,
    window: tuple[float, float],
    otherwise: str = "the two vortices do not exist together",
) -> pd.DataFrame:
    """Rows of a pairing inside a window (s); ValueError with `otherwise` where there is none."""
    rows = pair[pair["time"].between(*window)]
    if rows.empty:
        raise ValueError(f"{otherwise} between {window[0]:.3f} and {window[1]:.3f} s")
    return rows


def relative_difference(pair: pd.DataFrame, name: str) -> float:
    """RMS of the difference of a column of COMPARED over the RMS of the reference's."""
    reference = pair[f"{name}_reference"]
    return rms(pair[f"{name}_other"] - reference) / rms(reference)


def centre_distance(pair: pd.DataFrame) -> float:
    """RMS distance of the two centres, m."""
    return rms(pair["centre_distance"])


def rms(values: pd.Series) -> float:
    """Root of the mean square of what is known; NaN of nothing."""
    return float(np.sqrt((values.astype(float) ** 2).mean()))
