"""PIV and vortex code on exact fields: Lamb-Oseen, Rankine, Batchelor and Taylor-Green."""

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import j1

from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import make_plane
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import PEAK_SWIRL, lamb_oseen
from piv.vortices.vortex import Vortex
from tests.studies.piv.pairs import render_pair
from tests.studies.validation.checks import Check, How, Result

Field = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]

SHAPE = (512, 640)  # px
CENTRE = (320.3, 255.6)
CORE = 40.0  # px
PEAK = 6.0  # px per frame interval
GAMMA = PEAK * 2 * np.pi * CORE / PEAK_SWIRL
SHEET = 12.0  # px, thickness of the light sheet
AXIAL = 0.25  # displacement through the sheet on the Batchelor vortex's axis, over its thickness
CELL = 160.0  # px: size of a Taylor-Green cell
TG_CENTRE = (2.5 * CELL * 0.8, 1.5 * CELL)
SEEDS = (101, 102, 103)


def lamb(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Lamb-Oseen vortex."""
    return lamb_oseen(x, y, *CENTRE, GAMMA, CORE)


def rankine(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rankine vortex: solid rotation within CORE, potential flow outside."""
    rx, ry = x - CENTRE[0], y - CENTRE[1]
    rate = GAMMA / (2 * np.pi * np.maximum(rx**2 + ry**2, CORE**2))
    return -rate * ry, rate * rx


def batchelor(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Batchelor's vortex: Lamb-Oseen with a jet along its axis, out of the sheet."""
    r2 = (x - CENTRE[0]) ** 2 + (y - CENTRE[1]) ** 2
    return (*lamb(x, y), AXIAL * SHEET * np.exp(-r2 / CORE**2))


def taylor_green(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Taylor-Green cells of CELL px; that around TG_CENTRE turns counter-clockwise."""
    k = np.pi / CELL
    a, b = k * (x - TG_CENTRE[0]), k * (y - TG_CENTRE[1])
    return -PEAK * np.cos(a) * np.sin(b), PEAK * np.sin(a) * np.cos(b)


SCALE = 16.0  # px: half the window of PIV
DISC = 3 * SCALE
# circulations within DISC of the smoothed field: a Lamb-Oseen vortex stays one; of a Taylor-Green
# cell with the largest vorticity 2 k PEAK the mean over a disc is 2 J1(z)/z of that
LAMB_DISC = -np.expm1(-(DISC**2) / (CORE**2 + 2 * SCALE**2)) * GAMMA
K = np.pi / CELL
Z = np.sqrt(2) * K * DISC
CELL_DISC = 2 * K * PEAK * np.exp(-((K * SCALE) ** 2)) * np.pi * DISC**2 * 2 * j1(Z) / Z
# name, field, centre, a hundredth of its own radius, circulation
OTHERS = (
    ("Rankine", rankine, CENTRE, 0.01 * CORE, None),
    ("Taylor-Green", taylor_green, TG_CENTRE, 0.005 * CELL, CELL_DISC),
)


def _check(
    id: str, quantity: str, result: Any, tolerance: float, why: str, reference: Any, unit: str = "1"
) -> Check:
    """A check against the closed form: `at most` without reference, else relative."""
    how: How = "at most" if reference is None else "relative"
    value = float(result)
    return Check(id, quantity, value, tolerance, how, why, reference, "closed form", unit)


def _plane_of(field: Field, step: float) -> xr.Dataset:
    """The exact field on a grid of `step` px."""
    x, y = np.arange(16, SHAPE[1] - 16, step), np.arange(16, SHAPE[0] - 16, step)
    return make_plane(x, y, *field(*np.meshgrid(x, y))[:2])


def _nearest(vortices: list[Vortex], centre: tuple[float, float]) -> tuple[Vortex, float]:
    """The vortex nearest to `centre`, and its distance."""
    gaps = [np.hypot(v.x - centre[0], v.y - centre[1]) for v in vortices]
    k = int(np.argmin(gaps))
    return vortices[k], float(gaps[k])


def _measure_planes() -> list[Check]:
    """The vortex code on exact planes."""
    step, flux = 8.0, "px²/frame"
    found, gap = _nearest(find_vortices(_plane_of(lamb, step), rotation_prior=np.inf), CENTRE)
    gap = np.hypot(found.x_fit - CENTRE[0], found.y_fit - CENTRE[1])
    why, cells = (
        "no noise: only the fit's convergence remains",
        "edge of a hundred cells, and weights that end at three scales",
    )
    checks = [
        _check("planes.lamb.fit", "Lamb-Oseen: circulation of the fit", found.circulation_fit,
               1e-3, why, GAMMA, flux),
        _check("planes.lamb.core", "Lamb-Oseen: core radius", found.core_radius, 1e-3, why, CORE,
               "px"),
        _check("planes.lamb.centre", "Lamb-Oseen: distance of the centre", gap, 0.01, why, None,
               "px"),
        _check("planes.lamb.circulation", "Lamb-Oseen: circulation within 48 px",
               found.circulation_disc, 0.01, cells, LAMB_DISC, flux),
    ]  # fmt: skip
    for name, field, centre, within, circulation in OTHERS:
        key = name.lower()
        found, gap = _nearest(find_vortices(_plane_of(field, step), scale=SCALE), centre)
        why = "one per cent of the radius"
        checks.append(
            _check(f"planes.{key}.centre", f"{name}: distance of the centre", gap, within, why,
                   None, "px")
        )  # fmt: skip
        if circulation is not None:
            checks.append(
                _check(f"planes.{key}.circulation", f"{name}: circulation within 48 px",
                       found.circulation_disc, 0.01, cells, circulation, flux)
            )  # fmt: skip
    return checks


def _measure_images() -> list[Check]:
    """PIV of rendered images of the same fields, then the vortex code on its vectors."""
    checks = []
    use = (
        "a use: a fifth at most of what PIV of a scene may differ by from its simulation"
        " (circulation 5 %, centre 1.5 mm)"
    )
    lost = "a quarter of the particles leave the sheet on the axis"
    noise = "twice what a 32 px window measures with 2 % noise"
    # limits of circulation and core radius (relative), centre and rms of a component (px)
    for name, field, why, limits in (
        ("Lamb-Oseen", lamb, use, (0.01, 0.02, 0.1, 0.05)),
        ("Batchelor", batchelor, lost, (0.02, 0.03, 0.2, 0.08)),
    ):
        rows = np.array([_from_images(field, seed) for seed in SEEDS])
        key, scatter = name.lower(), rows[:, 0].std(ddof=1) / GAMMA
        (gamma, core), (gap, rms) = rows[:, :2].mean(0), np.sqrt(np.mean(rows[:, 2:] ** 2, axis=0))
        checks += [
            _check(f"images.{key}.fit", f"{name}, PIV: circulation of the fit (seeds scatter"
                   f" by {scatter:.1%})", gamma, limits[0], why, GAMMA, "px²/frame"),
            _check(f"images.{key}.core", f"{name}, PIV: core radius", core, limits[1], why, CORE,
                   "px"),
            _check(f"images.{key}.centre", f"{name}, PIV: distance of the centre, rms", gap,
                   limits[2], why, None, "px"),
            _check(f"images.{key}.rms", f"{name}, PIV: rms error of a component", rms, limits[3],
                   noise, None, "px"),
        ]  # fmt: skip
    why = "a use, as above"
    found = [_nearest(find_vortices(_piv(taylor_green, seed)), TG_CENTRE)[0] for seed in SEEDS]
    ratio = np.mean([v.circulation_disc for v in found]) / CELL_DISC
    words = "Taylor-Green, PIV: circulation within 48 px, measured / exact"
    checks.append(_check("images.taylor-green.circulation", words, ratio, 0.02, why, 1.0))
    return checks


def _piv(field: Field, seed: int) -> xr.Dataset:
    a, b = render_pair(field, SHAPE, noise=0.02, sheet_thickness_px=SHEET, seed=seed)
    return correlate_pair(a, b)


def _from_images(field: Field, seed: int) -> tuple[float, float, float, float]:
    """Circulation, core radius, distance of the centre and rms error (px) from one pair."""
    plane = _piv(field, seed)
    vortex, _ = _nearest(find_vortices(plane), CENTRE)
    gap = float(np.hypot(vortex.x_fit - CENTRE[0], vortex.y_fit - CENTRE[1]))
    exact = field(*np.meshgrid(plane["x"].values, plane["y"].values))[:2]
    error = np.stack([plane["u"].values - exact[0], plane["v"].values - exact[1]])[:, 3:-3, 3:-3]
    return vortex.circulation_fit, vortex.core_radius, gap, float(np.sqrt(np.nanmean(error**2)))


def measure() -> Result:
    """Every row of the PIV and vortex code."""
    text = (
        f"Planes of the exact field on 8 px, and pairs of images rendered from it ({SHAPE[1]} ×"
        f" {SHAPE[0]} px, 0.04 particles per pixel, 2 % noise, three seeds), core radius"
        f" {CORE:g} px, peak swirl {PEAK:g} px. `piv.correlation.pair` and `piv.vortices.find`"
        " with their defaults."
    )
    title = "PIV and vortex code on exact fields"
    return Result("exact_fields", title, text, (*_measure_planes(), *_measure_images()))
