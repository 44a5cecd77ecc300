"""The tip vortices of two fingers, paired instant by instant: how equal, opposite and mirrored."""

import numpy as np
import pandas as pd

_REACH = 5.0  # tip widths: the pair is followed beyond where a vortex counts as the tip's own
_KEPT = (
    *("track", "x", "y", "circulation", "radius"),
    *("side", "tip_distance", "along_tip", "across_tip"),
)
_ERRORS = ("x_std", "y_std", "circulation_std", "radius_std")  # kept where the table has them


def pair_vortices(table: pd.DataFrame) -> pd.DataFrame:
    """One row per instant at which both tips have a vortex, left finger _0 and right _1.

    The strongest vortex near either tip, and of the other finger's the one nearest to its mirror
    image in x = 0. Where the two centres are closer than their mean radius the flow does not tell
    the circulation of either, so that instant is left out. `imbalance` = |Γ0 + Γ1| over the mean of
    |Γ0| and |Γ1|; `mirror_distance` (m): of one centre from the mirror image of the other.
    """
    kept = [*_KEPT, *(name for name in _ERRORS if name in table)]
    rows = []
    near = table[(table["tip_distance"] <= _REACH) & table["finger"].isin([0, 1])]
    for time, now in near.groupby("time"):
        fingers = [now[now["finger"] == finger] for finger in (0, 1)]
        if any(vortices.empty for vortices in fingers):
            continue
        first = int(now.loc[now["circulation"].abs().idxmax(), "finger"])
        one = fingers[first].loc[fingers[first]["circulation"].abs().idxmax()]
        others = fingers[1 - first]
        off = np.hypot(others["x"] + one["x"], others["y"] - one["y"])  # from the mirror image
        other = others.loc[off.idxmin()]
        apart = float(np.hypot(other["x"] - one["x"], other["y"] - one["y"]))
        if apart < 0.5 * (one["radius"] + other["radius"]):
            continue
        left, right = (one, other) if first == 0 else (other, one)
        total = abs(left["circulation"]) + abs(right["circulation"])
        imbalance = abs(left["circulation"] + right["circulation"]) / (0.5 * total)
        values = [v[name] for v in (left, right) for name in kept]
        rows.append([time, *values, imbalance, float(off.min())])
    named = [f"{name}_{finger}" for finger in (0, 1) for name in kept]
    return pd.DataFrame(rows, columns=["time", *named, "imbalance", "mirror_distance"])


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
