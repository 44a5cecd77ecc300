"""Mean, RMS, Reynolds stresses, standard errors and convergence over time or groups."""

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.fields.blocks import blocks
from piv.formats.plane_series import make_plane, units_of, usable, vectors_of

# grid points, evenly chosen, that the correlation of samples in time is estimated from
_SAMPLED = 2500
# the variance of their means is then known to a third at a point, and better over the field
_LEAST_BATCHES = 16
_SNAPSHOTS = 16  # of the running mean, for its convergence


class Moments:
    """Means and central second moments of u and v (Welford; Chan, Golub & LeVeque 1983)."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.n = np.zeros(shape, np.int64)
        self.mean = np.zeros((2, *shape))
        self.sums = np.zeros((3, *shape))  # of squares and products of deviations: uu, vv, uv
        self.noise = np.zeros((2, *shape))  # sums of u_std², v_std²

    def add(self, u: ndarray, v: ndarray, ok: ndarray) -> None:
        """One instant; points that are not `ok` have no part in it."""
        self.n += ok
        before = np.where(ok, np.stack([u, v]) - self.mean, 0.0)
        self.mean += before / np.maximum(self.n, 1)
        after = np.where(ok, np.stack([u, v]) - self.mean, 0.0)
        self.sums[:2] += before * after
        self.sums[2] += before[0] * after[1]


class _Batches:
    """Means over 1, 2, 4, ... instants in a row: the effect of correlation on a mean's error.

    Flyvbjerg & Petersen, J. Chem. Phys. 91 (1989).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self.open: list[tuple[ndarray, ndarray] | None] = []
        self.levels: list[
            list[ndarray]
        ] = []  # of each: number, mean and sum of squares of batch means
        self.made: list[int] = []

    def add(self, values: ndarray, ok: ndarray, level: int = 0) -> None:
        """The next sum of 2^level instants and the number of usable ones in it."""
        if level == len(self.levels):
            self.levels.append([np.zeros(self.shape), np.zeros(self.shape), np.zeros(self.shape)])
            self.open.append(None)
            self.made.append(0)
        self.made[level] += 1
        number, mean, squares = self.levels[level]
        use = 2 * ok >= 2**level
        batch = np.where(use, values / np.maximum(ok, 1), 0.0)
        number += use
        apart = np.where(use, batch - mean, 0.0)
        mean += apart / np.maximum(number, 1)
        squares += apart * np.where(use, batch - mean, 0.0)
        waiting = self.open[level]
        if waiting is None:
            self.open[level] = values, ok
        else:
            self.open[level] = None
            self.add(waiting[0] + values, waiting[1] + ok, level + 1)

    def inefficiency(self) -> float:
        """Instants that are worth one independent sample; 1 where there are too few to tell."""
        if not self.levels:
            return 1.0  # no instant at all
        level = max((k for k, made in enumerate(self.made) if made >= _LEAST_BATCHES), default=0)
        variance = [_variance(*self.levels[k][::2]) for k in (0, level)]
        if not variance[0] > 0:
            return 1.0
        return max(1.0, float(2**level * variance[1] / variance[0]))


def _variance(number: ndarray, squares: ndarray) -> float:
    good = number > 1
    return float(np.mean(squares[good] / (number[good] - 1))) if good.any() else 0.0


def statistics(
    series: xr.Dataset,
    group: ndarray | None = None,
    centres: ndarray | None = None,
    *,
    centre_units: str = "1",
    least: int = 2,
) -> xr.Dataset:
    """Compute means, RMS and Reynolds stresses over time, or over groups of instants.

    The series is read once, block by block. Standard errors account for correlated samples.

    Parameters
    ----------
    series
        A plane series.
    group
        Number of each instant's group, -1 for none.
    centres
        What the groups stand for, as the coordinate `time` of the result; with `centre_units`.
    least
        Usable vectors that a mean needs.

    Returns
    -------
    xarray.Dataset
        A plane, or a series over `centres`: u, v the means, u_std, v_std their standard errors;
        u_rms, v_rms, uu, vv, uv (Reynolds stresses, n - 1); uu_noise, vv_noise (mean square of the
        vectors' own uncertainty, a part of uu, vv) where it is known; n usable vectors.
        convergence_u, convergence_v (over `instants`): RMS over the field of the mean so far less
        the final one.

    Raises
    ------
    ValueError
        For a plane, or groups that do not fit.

    Examples
    --------
    >>> u = np.random.default_rng(1).normal(2, 0.5, (40, 3, 4))
    >>> series = piv.make_plane(np.arange(4.0), np.arange(3.0), u, 0 * u, time=np.arange(40.0))
    >>> mean = piv.statistics(series)
    >>> bool((abs(mean["u"] - 2) < 0.4).all())
    True
    """
    if "time" not in series["u"].dims:
        raise ValueError("statistics over time need a series, this is a single plane")
    if least < 2:
        raise ValueError(f"at least 2 samples are needed for a standard error, got {least}")
    count = series.sizes["time"]
    labels = np.zeros(count, int) if group is None else np.asarray(group)
    if labels.shape != (count,):
        raise ValueError(f"{labels.size} groups for {count} instants")
    if not (labels >= 0).any():
        raise ValueError("no instant is in any group")
    if (most := int(np.bincount(labels[labels >= 0]).max())) < least:
        raise ValueError(f"a mean needs at least {least} instants; the largest group has {most}")
    number = int(labels.max()) + 1 if centres is None else len(centres)
    shape = (series.sizes["y"], series.sizes["x"])
    step = max(1, int(np.ceil(np.sqrt(shape[0] * shape[1] / _SAMPLED))))
    some = (slice(step // 2, None, step), slice(step // 2, None, step))
    part_shape = np.zeros(shape)[some].shape
    moments = [Moments(shape) for _ in range(number)]
    batches = [[_Batches(part_shape) for _ in range(2)] for _ in range(number)]
    stops = np.unique(np.geomspace(1, count, _SNAPSHOTS).astype(int))
    snapshots: list[ndarray] = []
    noisy = {"u_std", "v_std"} <= set(series)
    done = 0
    for part in blocks(vectors_of(series)):
        a, b = (part[n].values.astype(float) for n in ("u", "v"))
        good = usable(part).values
        for k in range(len(a)):
            g = labels[done]
            done += 1
            if g >= 0:
                ok = good[k]
                moments[g].add(a[k], b[k], ok)
                for batch, values in zip(batches[g], (a[k], b[k]), strict=True):
                    batch.add(np.where(ok, values, 0.0)[some], ok[some].astype(int))
                if noisy:
                    for m, name in enumerate(("u_std", "v_std")):
                        moments[g].noise[m] += np.where(ok, part[name].values[k], 0.0) ** 2
            if group is None and done in stops:
                snapshots.append(
                    np.where(moments[0].n > 0, moments[0].mean, np.nan).astype(np.float32)
                )
    fields = [_fields(m, b, least, noisy) for m, b in zip(moments, batches, strict=True)]
    return _dataset(
        series,
        fields,
        centres if group is not None else None,
        centre_units,
        stops,
        snapshots,
        batches,
    )


def _fields(m: Moments, batches: list[_Batches], least: int, noisy: bool) -> dict[str, ndarray]:
    enough = m.n >= least
    n = np.where(enough, m.n, np.nan)
    uu, vv, uv = m.sums / (n - 1)
    out = {
        "u": np.where(enough, m.mean[0], np.nan),
        "v": np.where(enough, m.mean[1], np.nan),
        "valid": enough,
    }
    out |= {
        "u_std": np.sqrt(batches[0].inefficiency() * uu / n),
        "v_std": np.sqrt(batches[1].inefficiency() * vv / n),
    }
    out |= {"u_rms": np.sqrt(uu), "v_rms": np.sqrt(vv), "uu": uu, "vv": vv, "uv": uv, "n": m.n}
    return out | ({"uu_noise": m.noise[0] / n, "vv_noise": m.noise[1] / n} if noisy else {})


def _dataset(series, fields, centres, centre_units, stops, snapshots, batches) -> xr.Dataset:
    x, y = series["x"].values, series["y"].values
    if centres is None:
        stacked = fields[0]
        plane = make_plane(x, y, **stacked)
        final = np.where(fields[0]["valid"], [fields[0]["u"], fields[0]["v"]], np.nan)
        off = np.array(snapshots) - final
        some = np.isfinite(off).any(
            axis=(1, 2, 3)
        )  # before the first usable vector there is no mean
        apart = np.sqrt(np.nanmean(off[some] ** 2, axis=(2, 3)))
        for k, name in enumerate(("convergence_u", "convergence_v")):
            plane[name] = ("instants", apart[:, k])
        plane = plane.assign_coords(instants=stops[some])
    else:
        stacked = {n: np.stack([f[n] for f in fields]) for n in fields[0]}
        plane = make_plane(x, y, time=np.asarray(centres, float), **stacked)
        plane["time"].attrs = {"units": centre_units, "long_name": "phase or bin"}
    length, velocity = units_of(series)
    for name in map(str, plane.variables):
        if name in ("x", "y"):
            plane[name].attrs["units"] = length
        elif name in ("uu", "vv", "uv", "uu_noise", "vv_noise"):
            plane[name].attrs["units"] = f"{velocity}²" if velocity == "px" else "m²/s²"
        elif name in ("n", "valid", "instants"):
            plane[name].attrs["units"] = "1"
        elif name != "time":
            plane[name].attrs["units"] = velocity
    plane.attrs = dict(series.attrs)
    plane.attrs["inefficiency_u"], plane.attrs["inefficiency_v"] = (
        [float(b[k].inefficiency()) for b in batches] for k in (0, 1)
    )
    return plane
