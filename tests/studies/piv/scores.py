"""Errors of vectors against the truth, and what is told of them in a row of a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr

from piv.correlation import uncertainty

HEAD = "RMS error, px | coverage of ±1 standard uncertainty | unflagged > 0.5 px | absent |\n|---|---|---|---|---|"
FAR = 0.5  # px


@contextmanager
def without_count_of_cells() -> Iterator[None]:
    """No window has so few cells that they raise its variance."""
    few = uncertainty.FEW
    uncertainty.FEW = 1e-9
    try:
        yield
    finally:
        uncertainty.FEW = few


def errors(ds: xr.Dataset, flow: Callable) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x, y (ny, nx), errors and their standard uncertainties (2, ny, nx; NaN where absent), px."""
    x, y = np.meshgrid(ds["x"], ds["y"])
    u, v = flow(x, y)
    e = np.stack([ds["u"].values - u, ds["v"].values - v])
    return x, y, e, np.stack([ds["u_std"].values, ds["v_std"].values])


def rms(e: np.ndarray) -> float:
    """Root mean square of what is finite."""
    return float(np.sqrt(np.nanmean(e**2)))


def row(parts: list[tuple[np.ndarray, np.ndarray]]) -> str:
    """Cells below HEAD for errors and standard uncertainties (2, n) of several pairs; wrong ones as a share of the vectors given."""
    e, std = (np.concatenate([p[k].reshape(2, -1) for p in parts], axis=1) for k in (0, 1))
    known = np.isfinite(e).all(axis=0)
    e, std = e[:, known], std[:, known]
    cover, far = np.mean(np.abs(e) < std), np.mean(np.hypot(*e) > FAR)
    return f"{rms(e):.4f} | {cover:.0%} | {far:.3%} | {np.mean(~known):.2%} |"
