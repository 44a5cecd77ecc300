"""Errors of vectors against the truth, and what is told of them in a row of a table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import xarray as xr

FAR = 0.5  # px
EDGE = 24  # px
UNCERTAIN = 5  # flag
TOLD = (
    "coverage of ±1 standard uncertainty", f"uncertain (flag {UNCERTAIN})",
    f"of the others > {FAR} px", "absent",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of the n vectors that count, and what is told of them."""

    e: np.ndarray  # (2, n), px; NaN where absent
    std: np.ndarray  # (2, n), px; NaN where not told
    flag: np.ndarray  # (n,)
    common: np.ndarray  # (n,) bool: every method of the comparison has a vector here
    seconds: float = 0.0  # CPU time of the pair
    vectors: int = 0  # of the pair, with those that do not count


def inner(shape: tuple[int, int]) -> Callable:
    """(x, y) -> bool: at least EDGE px from the border of pictures of this shape."""
    rows, columns = shape
    return lambda x, y: (
        (x >= EDGE) & (x <= columns - 1 - EDGE) & (y >= EDGE) & (y <= rows - 1 - EDGE)
    )


def errors(ds: xr.Dataset, flow: Callable) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x, y (ny, nx), errors and standard uncertainties (2, ny, nx; NaN where absent), px."""
    x, y = np.meshgrid(ds["x"], ds["y"])
    u, v = flow(x, y)
    e = np.stack([ds["u"].values - u, ds["v"].values - v])
    told = "u_std" in ds
    std = np.stack([ds["u_std"].values, ds["v_std"].values]) if told else np.full_like(e, np.nan)
    return x, y, e, std


def judged(
    ds: xr.Dataset, flow: Callable, counts: Callable, beside: Iterable[xr.Dataset] = ()
) -> Errors:
    """Errors of the vectors at which counts(x, y) holds; `beside`: vectors of all methods."""
    x, y, e, std = errors(ds, flow)
    where = counts(x, y)
    common = np.isfinite(e).all(axis=0)
    for other in beside:
        at = {name: xr.DataArray(axis, dims=("j", "i")) for name, axis in (("x", x), ("y", y))}
        near = other.sel(at, method="nearest")
        common &= np.isfinite(near["u"].values + near["v"].values)
    flag = ds["flag"].values if "flag" in ds else np.zeros(x.shape)
    told = e[:, where], std[:, where], flag[where], common[where]
    return Errors(*told, ds.attrs.get("cpu_s", 0.0), ds["u"].size)


def joined(parts: list[Errors]) -> Errors:
    """Those of several pairs side by side."""
    names = ("e", "std", "flag", "common")
    return Errors(*(np.concatenate([getattr(p, n) for p in parts], axis=-1) for n in names))


def rms(e: np.ndarray) -> float:
    """Root mean square of what is finite; NaN where nothing is."""
    e = e[np.isfinite(e)]
    return float(np.sqrt(np.mean(e**2))) if e.size else float("nan")


def rms_of(parts: list[Errors]) -> float:
    """RMS error (px) where every method of the comparison has a vector; NaN where none counts."""
    all_ = joined(parts)
    return rms(all_.e[:, all_.common])


def speed(parts: list[Errors]) -> float:
    """Vectors per CPU second."""
    return sum(p.vectors for p in parts) / sum(p.seconds for p in parts)


def absent(parts: list[Errors]) -> float:
    """Share of the vectors that are not given."""
    return float(np.mean(~np.isfinite(joined(parts).e).all(axis=0)))


def told(parts: list[Errors]) -> dict[str, str]:
    """Cells of the columns TOLD; shares are of the vectors given."""
    all_ = joined(parts)
    known = np.isfinite(all_.e).all(axis=0)
    e, uncertain = all_.e[:, known], all_.flag[known] == UNCERTAIN
    cover, far = np.mean(np.abs(e) < all_.std[:, known]), np.mean(np.hypot(*e[:, ~uncertain]) > FAR)
    cells = f"{cover:.0%}", f"{uncertain.mean():.2%}", f"{far:.3%}", f"{absent(parts):.2%}"
    return dict(zip(TOLD, cells, strict=True))
