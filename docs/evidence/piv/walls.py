"""A vortex core that touches a moving body: vectors at the wall and the fit."""

import numpy as np
import pandas as pd

from docs.evidence.piv.flows import lamb_oseen
from docs.evidence.piv.particles import render
from docs.evidence.piv.scores import errors, rms
from piv.correlation.pair import correlate_pair
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import PEAK_SWIRL

SHAPE = (320, 384)
MIDDLE = 159.5
WALL = 165.0  # px from the left: side of the body
CORES = (28, 24, 20, 16, 12)  # px
PEAK = 6.0  # px
PAIRS = 5
SPACING = 8  # px


def vortex(core: float):
    """Lamb-Oseen vortex (px) whose core touches the wall."""
    return lamb_oseen(core, PEAK, centre=(WALL + core, MIDDLE))


def evaluated(core: float, seed: int):
    """Vectors of a pair in which the body moves by a pixel."""
    a, b = render(vortex(core), shape=SHAPE, seed=seed, noise=0.02)
    column = np.arange(SHAPE[1])
    masks = [np.broadcast_to(column < WALL + side, SHAPE) for side in (-0.5, 0.5)]
    for image, mask in zip((a, b), masks, strict=True):
        image[mask] = 8
    return correlate_pair(a, b, spacing=SPACING, mask=tuple(masks))


def circulation_error(ds, core: float) -> float:
    """Relative error of the fitted circulation; NaN without a vortex within a core radius."""
    exact = 2 * np.pi * core * PEAK / PEAK_SWIRL
    near = [w for w in find_vortices(ds) if np.hypot(w.x - WALL - core, w.y - MIDDLE) < core]
    return near[0].circulation_fit / exact - 1 if near else np.nan


def told(circulations: list[float]) -> str:
    """RMS of the circulations that were found, and of how many pairs."""
    there = np.array(circulations)[np.isfinite(circulations)]
    found = f"{100 * rms(there):.1f} %" if there.size else "none"
    all_of = there.size == len(circulations)
    return found if all_of else f"{found} ({there.size} of {len(circulations)} found)"


def line(core: float, first: int) -> dict[str, str]:
    """A row of the table."""
    near, measured, exact = [], [], []
    for seed in range(first, first + PAIRS):
        ds = evaluated(core, seed)
        x, y, e, _ = errors(ds, vortex(core))
        near.append(e[:, (x > WALL) & (x < WALL + core) & (np.abs(y - MIDDLE) < 3 * core)])
        measured.append(circulation_error(ds, core))
        u, v = vortex(core)(x, y)
        exact.append(circulation_error(ds.assign(u=(("y", "x"), u), v=(("y", "x"), v)), core))
    e = np.concatenate(near, axis=1)
    return {
        f"core radius (spacings of {SPACING} px)": f"{core} px ({core / SPACING:.1f})",
        "steepest": f"{PEAK / PEAK_SWIRL / core:.2f} px/px",
        "RMS error between core and wall": f"{rms(e):.3f} px",
        "largest": f"{np.nanmax(np.hypot(*e)):.2f} px",
        "absent": f"{np.mean(~np.isfinite(e).all(axis=0)):.1%}",
        "circulation of the fit": told(measured),
        "of a fit to exact vectors": told(exact),
    }


def walls(first: int) -> pd.DataFrame:
    """A row for each core; seeds from `first`."""
    return pd.DataFrame([line(core, first) for core in CORES])
