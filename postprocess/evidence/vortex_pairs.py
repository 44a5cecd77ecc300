"""The tip vortices of two fingers as a pair: how equal, opposite and mirrored."""

import numpy as np
import pandas as pd

from postprocess.evidence.tip_vortex import counterpart, dominant_track, strengths

_KEPT = (
    *("track", "x", "y", "circulation", "radius"),
    *("side", "tip_distance", "along_tip", "across_tip"),
)
_ERRORS = ("x_std", "y_std", "circulation_std", "radius_std")  # kept where the table has them


def pair_vortices(table: pd.DataFrame, window: tuple[float, float]) -> pd.DataFrame:
    """One row per instant at which both tips have their vortex, left finger _0 and right _1.

    The track that is strongest near either tip over the `window` (s), and of the other finger's
    strong ones the nearest to its mirror image in x = 0. Where the two centres are closer than
    their mean radius the flow does not tell the circulation of either, so that instant is left
    out. `imbalance` = |Γ0 + Γ1| over the mean of |Γ0| and |Γ1|; `mirror_distance` (m): of one
    centre from the mirror image of the other.
    """
    kept = [*_KEPT, *(name for name in _ERRORS if name in table)]
    found = [strengths(table, finger, window) for finger in (0, 1)]
    pair = pd.DataFrame({name: pd.Series(dtype=float) for name in ["time", *_named(kept)]})
    if all(len(ranking) for ranking in found):
        first = int(found[1].iloc[0] > found[0].iloc[0])
        one = dominant_track(table, first, window, "")
        other = counterpart(table, one.assign(x=-one["x"]), 1 - first, window)
        left, right = (one, other) if first == 0 else (other, one)
        columns = ["time", *kept]
        pair = left[columns].merge(right[columns], on="time", suffixes=("_0", "_1"))
    x, y, size = (
        [pair[f"{name}_{finger}"].astype(float) for finger in (0, 1)]
        for name in ("x", "y", "circulation")
    )
    total = 0.5 * (size[0].abs() + size[1].abs())
    pair["imbalance"] = (size[0] + size[1]).abs() / total
    pair["mirror_distance"] = np.hypot(x[0] + x[1], y[0] - y[1])
    apart = np.hypot(x[0] - x[1], y[0] - y[1])
    return pair[apart >= 0.5 * (pair["radius_0"] + pair["radius_1"])].reset_index(drop=True)


def _named(kept: list[str]) -> list[str]:
    return [f"{name}_{finger}" for finger in (0, 1) for name in kept]


def of_finger(pairs: pd.DataFrame, finger: int) -> pd.DataFrame:
    """One finger's vortex of every pair, with the columns of a vortex table."""
    names = {f"{name}_{finger}": name for name in (*_KEPT, *_ERRORS) if f"{name}_{finger}" in pairs}
    return pairs[["time", *names]].rename(columns=names)


def broken(table: pd.DataFrame, *tracks: str) -> pd.DataFrame:
    """The table with an empty row where one of the `tracks` changes: no line joins them."""
    new = (table[list(tracks)] != table[list(tracks)].shift()).any(axis=1).cumsum()
    empty = pd.DataFrame(np.nan, index=[0], columns=table.select_dtypes("number").columns)
    parts = [part for _, rows in table.groupby(new) for part in (rows, empty)]
    return pd.concat(parts[:-1], ignore_index=True) if len(parts) > 2 else table


def senses(rows: pd.DataFrame) -> str:
    """ "opposite" where the fingers' mean circulations differ in sign, else "equal"."""
    product = rows["circulation_0"].mean() * rows["circulation_1"].mean()
    return "opposite" if product < 0 else "equal"


def shift_at_equal_bend(
    pair: pd.DataFrame,
    pair_bend: np.ndarray,
    single: pd.DataFrame,
    single_bend: np.ndarray,
    name: str,
) -> float:
    """Mean of `name` (m) of both fingers' vortices less the single finger's at equal bend.

    `pair`: rows of a pairing with their bends (rad); `single`: rows of one track with theirs.
    ValueError where the single finger's vortex exists at none of the pair's bends.
    """
    order = np.argsort(single_bend)
    bends, values = single_bend[order], single[name].to_numpy(float)[order]
    common = (pair_bend >= bends[0]) & (pair_bend <= bends[-1])
    if not common.any():
        low, high, first, last = np.degrees([*bends[[0, -1]], pair_bend.min(), pair_bend.max()])
        raise ValueError(
            f"the single finger's vortex exists from {low:.0f}° to {high:.0f}° of bend,"
            f" the pair's from {first:.0f}° to {last:.0f}°: no common bend"
        )
    both = 0.5 * (pair[f"{name}_0"] + pair[f"{name}_1"]).to_numpy(float)
    return float((both - np.interp(pair_bend, bends, values))[common].mean())
