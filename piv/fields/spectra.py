"""Power spectral densities in time and space of vectors with gaps, by the Lomb-Scargle periodogram.

N. R. Lomb, Astrophys. Space Sci. 39 (1976) 447; J. D. Scargle, Astrophys. J. 263 (1982) 835.
Without gaps it is the usual periodogram; gaps are left out, not filled.
"""

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray
from scipy.signal import lombscargle

from piv.fields.blocks import blocks
from piv.formats.plane_series import usable, vectors_of

_LEAST_PART = 0.5  # of a line or a segment that must hold usable vectors


def density(positions: ndarray, values: ndarray, frequencies: ndarray, step: float) -> ndarray:
    """One-sided power spectral density (value² per frequency unit) of samples with gaps (NaN).

    Its integral over the frequencies 1/L, 2/L, ... of a record of length L is the variance, as far
    as gaps allow.
    """
    ok = np.isfinite(values)
    samples = values[ok] - values[ok].mean()
    power = lombscargle(positions[ok], samples, 2 * np.pi * frequencies)
    return 2 * step * power


def frequencies_of(count: int, step: float) -> ndarray:
    """1/L, 2/L, ... below half of 1/step of a record of `count` samples."""
    return np.arange(1, (count - 1) // 2 + 1) / (count * step)


def _step(axis: ndarray, name: str) -> float:
    apart = np.diff(axis)
    if axis.size < 8:
        raise ValueError(f"a spectrum needs at least 8 samples along {name}, got {axis.size}")
    if np.ptp(apart) > 1e-3 * apart.mean():
        raise ValueError(f"a spectrum needs evenly spaced samples along {name}")
    return float(apart.mean())


def time_spectrum(
    series: xr.Dataset, points: list[tuple[float, float]], segments: int = 1
) -> pd.DataFrame:
    """Compute spectra of u and v over time at the vectors nearest to points, averaged.

    Lomb-Scargle periodograms; records with less than half of their vectors are left out.

    Parameters
    ----------
    series
        A plane series with evenly spaced instants, at least 8.
    points
        (x, y) of each point.
    segments
        Parts of the record that are averaged, too.

    Returns
    -------
    pandas.DataFrame
        frequency (Hz, or per frame), psd_u, psd_v and averaged, the number of records.

    Raises
    ------
    ValueError
        For a plane, a point outside, or too few instants.

    Examples
    --------
    >>> t = np.arange(64) / 32
    >>> u = np.sin(2 * np.pi * 4 * t)[:, None, None] * np.ones((3, 4))
    >>> series = piv.make_plane(np.arange(4.0), np.arange(3.0), u, u, time=t)
    >>> spectrum = piv.time_spectrum(series, [(1, 1)])
    >>> float(spectrum["frequency"][spectrum["psd_u"].idxmax()])
    4.0
    """
    if "time" not in series["u"].dims:
        raise ValueError("a spectrum in time needs a series, this is a single plane")
    if segments < 1:
        raise ValueError(f"segments must be at least 1, got {segments}")
    for x, y in points:
        inside = all(series[n][0] <= c <= series[n][-1] for n, c in (("x", x), ("y", y)))
        if not inside:
            raise ValueError(f"the point {x:g} {y:g} is not within the plane")
    where = {
        "x": xr.DataArray([p[0] for p in points], dims="point"),
        "y": xr.DataArray([p[1] for p in points], dims="point"),
    }
    chosen = [part.sel(where, method="nearest") for part in blocks(vectors_of(series))]
    at = xr.concat(chosen, "time").transpose("point", "time")
    at = at.where(usable(at))
    time = series["time"].values
    step = _step(time, "time")
    size = time.size // segments
    if size < 8:
        raise ValueError(
            f"{segments} segments of {time.size} instants are shorter than 8; give fewer"
        )
    records = [
        (time[:size], at[n].values[p, k * size : (k + 1) * size], n)
        for p in range(len(points))
        for k in range(segments)
        for n in ("u", "v")
    ]
    return _mean(records, frequencies_of(size, step), step)


def space_spectrum(plane: xr.Dataset, axis: str) -> pd.DataFrame:
    """Compute spectra of u and v along x or y, averaged over lines and instants.

    Parameters
    ----------
    plane
        A plane or series.
    axis
        "x" or "y".

    Returns
    -------
    pandas.DataFrame
        Columns as of `time_spectrum`; frequency in cycles per length.

    Raises
    ------
    ValueError
        For another axis, or fewer than 8 vectors along it.

    Examples
    --------
    >>> x = np.arange(32) / 16
    >>> u = np.ones((3, 1)) * np.sin(2 * np.pi * 2 * x)
    >>> spectrum = piv.space_spectrum(piv.make_plane(x, np.arange(3.0), u, u), "x")
    >>> float(spectrum["frequency"][spectrum["psd_u"].idxmax()])
    2.0
    """
    if axis not in ("x", "y"):
        raise ValueError(f"spectra in space are along x or y, not {axis!r}")
    positions = plane[axis].values
    step = _step(positions, axis)
    frequencies = frequencies_of(positions.size, step)

    def records():
        for part in blocks(vectors_of(plane)):
            known = part.where(usable(part)).transpose(..., axis)
            for n in ("u", "v"):
                lines = known[n].values.reshape(-1, positions.size)
                yield from ((positions, line, n) for line in lines)

    return _mean(records(), frequencies, step)


def _mean(records, frequencies: ndarray, step: float) -> pd.DataFrame:
    total = {n: np.zeros(frequencies.size) for n in ("u", "v")}
    used = dict.fromkeys(total, 0)
    for positions, values, n in records:
        if np.isfinite(values).mean() >= _LEAST_PART:
            total[n] += density(positions, values, frequencies, step)
            used[n] += 1
    if not used["u"]:
        raise ValueError("no record has half of its vectors")
    columns = {f"psd_{n}": total[n] / used[n] for n in total}
    return pd.DataFrame({"frequency": frequencies} | columns | {"averaged": used["u"]})
