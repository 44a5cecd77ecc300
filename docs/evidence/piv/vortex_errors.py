"""`python -m docs.evidence.piv vortex_errors`: errors of vortices and how often their bands hold.

Lamb-Oseen vortices in PIV of rendered pairs, and exact ones. Smoothed at the finder's scale they
stay Lamb-Oseen vortices, so that every measure is known.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
import xarray as xr

from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.pairs import render_pair
from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import make_plane
from piv.formats.recording import window_of
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import PEAK_RADIUS, PEAK_SWIRL, lamb_oseen
from piv.vortices.region_measures import DISC

FIRST, CASES = 80001, 600  # the constants of region_errors.py were set on seeds below 71000
MEASURES = ("x", "y", "circulation_disc", "radius", "peak_vorticity")
Case = tuple[xr.Dataset, tuple[float, float, float, float], float]  # plane, vortex, scale


def of_pair(seed: int) -> Case:
    """PIV with windows of 16 to 48 px, a core of at least a window, noise to 5 %."""
    rng = np.random.default_rng(seed)
    window = int(rng.choice([16, 24, 32, 48]))
    core = float(np.clip(window / 4 * rng.uniform(4, 15), 16, 60))
    side = int(np.clip(8 * core, 256, 512))
    x, y = side / 2 + rng.uniform(-8, 8, 2)
    circulation = rng.choice([-1, 1]) * rng.uniform(2, 7) * 2 * np.pi * core / PEAK_SWIRL
    vortex = (x, y, circulation, core)
    pair = render_pair(
        lambda x, y: lamb_oseen(x, y, *vortex),
        (side, side),
        noise=rng.uniform(0, 0.05),
        seed=seed,
    )
    plane = correlate_pair(*pair, window=window)
    return plane, vortex, window_of(plane) / 2


def exact(seed: int) -> Case:
    """8 to 30 grid points per core radius, without noise, in a drift."""
    rng = np.random.default_rng(seed)
    step = 1 / rng.uniform(8, 30)
    axis = np.arange(-6, 6, step) + rng.uniform(0, step)
    vortex = (*rng.uniform(-0.3, 0.3, 2), rng.choice([-1, 1]), 1.0)
    u, v = lamb_oseen(*np.meshgrid(axis, axis), *vortex)
    return make_plane(axis, axis, u + 0.3, v), vortex, rng.uniform(0.25, 0.4)


def errors(case: Case) -> np.ndarray:
    """Relative errors (of a centre: over the radius) and stated uncertainties (2, MEASURES)."""
    plane, (x, y, circulation, core), scale = case
    found = find_vortices(plane, scale=scale)
    nearest = min(found, key=lambda v: np.hypot(v.x - x, v.y - y))
    wide = np.sqrt(core**2 + 2 * scale**2)
    within = -np.expm1(-((DISC * scale / wide) ** 2)) * circulation
    radius, peak = PEAK_RADIUS * wide, circulation / (np.pi * wide**2)
    truth, size = (
        np.array([x, y, within, radius, peak]),
        np.array([radius] * 2 + [within, radius, peak]),
    )
    values, stds = (
        np.array([getattr(nearest, name + ending) for name in MEASURES]) for ending in ("", "_std")
    )
    return np.array([(values - truth) / size, stds / abs(size)])


def rows(label: str, make: Callable[[int], Case]) -> list[dict[str, object]]:
    """A row of the table for each measure; errors are in per cent."""
    error, std = np.moveaxis(np.array([errors(make(FIRST + k)) for k in range(CASES)]), 1, 0)
    table: list[dict[str, object]] = []
    for name, e, s in zip(MEASURES, error.T, std.T, strict=True):
        row: dict[str, object] = {"vortices": label, "measure": name}
        numbers = {
            "mean error, %": e.mean(),
            "its standard deviation": e.std(),
            "95th percentile": np.percentile(abs(e), 95),
            "stated, RMS": np.sqrt(np.mean(s**2)),
        }
        row |= {key: round(100 * number, 2) for key, number in numbers.items()}
        table.append(row | {f"within {n}": f"{np.mean(abs(e) < n * s):.0%}" for n in (1, 2)})
    return table


def study() -> None:
    """Write the table into the docs."""
    table = pd.DataFrame(rows("in PIV", of_pair) + rows("exact", exact))
    write_study("vortex_errors", [table], f"Seeds {FIRST}-{FIRST + CASES - 1}; {libraries()}.")
