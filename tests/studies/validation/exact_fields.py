"""PIV and vortex code on exact fields: Lamb-Oseen, Rankine, Batchelor and Taylor-Green, as planes and as images."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from fileio.formats.plane_series import make_plane
from piv.correlation.pair import correlate_pair
from piv.vortices.circulation import area_circulation, contour_circulation
from piv.vortices.criteria import gradients, vorticity
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import PEAK_SWIRL, lamb_oseen
from piv.vortices.vortex import Vortex
from tests.studies.piv.pairs import render_pair
from tests.studies.validation.checks import Check, Result

Field = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]

SHAPE = (512, 640)  # px
CENTRE = (320.3, 255.6)
CORE = 40.0  # px
PEAK = 6.0  # px per frame interval
GAMMA = PEAK * 2 * np.pi * CORE / PEAK_SWIRL
SHEET = 12.0  # px, thickness of the light sheet
AXIAL = 0.25  # of the sheet's thickness: displacement through it on the Batchelor vortex's axis
SEEDS = (101, 102, 103)
EXACT = "closed form"


def lamb(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Lamb-Oseen vortex."""
    return lamb_oseen(x, y, *CENTRE, GAMMA, CORE)


def rankine(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rankine vortex: solid rotation within CORE, potential flow outside."""
    rx, ry = x - CENTRE[0], y - CENTRE[1]
    rate = GAMMA / (2 * np.pi * np.maximum(rx**2 + ry**2, CORE**2))
    return -rate * ry, rate * rx


def batchelor(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Batchelor's trailing vortex: Lamb-Oseen with a jet along its axis, which carries particles out of the sheet."""
    r2 = (x - CENTRE[0]) ** 2 + (y - CENTRE[1]) ** 2
    return (*lamb(x, y), AXIAL * SHEET * np.exp(-r2 / CORE**2))


CELL = 160.0  # px: size of a Taylor-Green cell
TG_CENTRE = (2.5 * CELL * 0.8, 1.5 * CELL)


def taylor_green(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Taylor-Green cells of CELL px; that around TG_CENTRE turns counter-clockwise."""
    k = np.pi / CELL
    a, b = k * (x - TG_CENTRE[0]), k * (y - TG_CENTRE[1])
    return -PEAK * np.cos(a) * np.sin(b), PEAK * np.sin(a) * np.cos(b)


# name, field, centre, radius (px) of the circle round which its circulation is measured, and a hundredth of the radius
OTHERS = (
    ("Rankine", rankine, CENTRE, 1.5 * CORE, 0.01 * CORE),
    ("Taylor-Green", taylor_green, TG_CENTRE, 0.45 * CELL, 0.005 * CELL),
)


def disc_circulation(field: Field, centre: tuple[float, float], radius: float) -> float:
    """Circulation round a circle, from the exact field."""
    angle = np.arange(4096) * 2 * np.pi / 4096
    u, v = field(centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle))[:2]
    return float(np.mean(v * np.cos(angle) - u * np.sin(angle)) * 2 * np.pi * radius)


def plane_of(field: Field, step: float) -> xr.Dataset:
    """The exact field on a grid of `step` px."""
    x, y = np.arange(16, SHAPE[1] - 16, step), np.arange(16, SHAPE[0] - 16, step)
    return make_plane(x, y, *field(*np.meshgrid(x, y))[:2])


def nearest(vortices: list[Vortex], centre: tuple[float, float]) -> Vortex:
    """The vortex whose centre is nearest to `centre`."""
    return min(vortices, key=lambda v: np.hypot(v.x - centre[0], v.y - centre[1]))


def around(plane: xr.Dataset, centre: tuple[float, float], radius: float) -> float:
    """Circulation round a circle, by piv.vortices.circulation."""
    x, y, u, v = (plane[n].values for n in ("x", "y", "u", "v"))
    return contour_circulation(x, y, u, v, *centre, radius)


def measure_planes() -> list[Check]:
    """The vortex code on exact planes."""
    step = 8.0
    fit = nearest(find_vortices(plane_of(lamb, step), rotation_prior=np.inf), CENTRE)
    gap = float(np.hypot(fit.x - CENTRE[0], fit.y - CENTRE[1]))
    noiseless = "no noise: only the fit's convergence remains"
    checks = [
        Check("planes.lamb.circulation", "Lamb-Oseen: circulation of the fit", fit.circulation, 1e-3, "relative", noiseless,
              GAMMA, EXACT, "px²/frame"),
        Check("planes.lamb.core", "Lamb-Oseen: core radius", fit.core_radius, 1e-3, "relative", noiseless, CORE, EXACT, "px"),
        Check("planes.lamb.centre", "Lamb-Oseen: distance of the centre", gap, 0.01, "at most", noiseless, None, EXACT, "px"),
    ]  # fmt: skip
    for name, field, centre, radius, within in OTHERS:
        plane = plane_of(field, step)
        vortex = nearest(find_vortices(plane), centre)
        gap = float(np.hypot(vortex.x - centre[0], vortex.y - centre[1]))
        key = name.lower()
        checks += [
            Check(f"planes.{key}.centre", f"{name}: distance of the centre", gap, within, "at most",
                  "one per cent of the radius: the profile is not the fit's", None, EXACT, "px"),
            Check(f"planes.{key}.contour", f"{name}: circulation round a circle of {radius:g} px", around(plane, centre, radius),
                  0.01, "relative", "cubic interpolation of a field with a kink, or of 20 points to a cell",
                  disc_circulation(field, centre, radius), EXACT, "px²/frame"),
        ]  # fmt: skip
    orders = circulation_orders()
    for kind, wanted in (("contour", 4), ("area", 2)):
        checks.append(
            Check(f"planes.order.{kind}", f"Lamb-Oseen: order of the {kind} integral in the grid's step", orders[kind], 0.3,
                  "absolute", "cubic interpolation (4) and central differences (2) over two halvings", wanted, EXACT)
        )  # fmt: skip
    return checks


def circulation_orders() -> dict[str, float]:
    """Observed order of both circulation integrals between grids of CORE/2.5 and CORE/10."""
    steps, errors = (16.0, 8.0, 4.0), {"contour": [], "area": []}  # type: tuple[float, ...], dict[str, list[float]]
    radius = 1.2 * CORE
    exact = disc_circulation(lamb, CENTRE, radius)
    for step in steps:
        plane = plane_of(lamb, step)
        x, y, u, v = (plane[n].values for n in ("x", "y", "u", "v"))
        omega = vorticity(gradients(u, v, np.ones(u.shape, bool), step, step))
        errors["contour"].append(abs(contour_circulation(x, y, u, v, *CENTRE, radius) - exact))
        errors["area"].append(abs(area_circulation(x, y, omega, *CENTRE, radius) - exact))
    return {k: float(np.polyfit(np.log(steps), np.log(e), 1)[0]) for k, e in errors.items()}


def measure_images() -> list[Check]:
    """PIV of rendered images of the same fields, then the vortex code on its vectors."""
    checks = []
    limits = {  # circulation, core radius (relative), centre (px), rms of a component (px)
        "Lamb-Oseen": (lamb, CENTRE, GAMMA, 0.01, 0.02, 0.1, 0.05),
        "Batchelor": (batchelor, CENTRE, GAMMA, 0.02, 0.03, 0.2, 0.08),
    }
    use = "a use: a fifth at most of what PIV of a scene may differ by from its simulation (circulation 5 %, centre 1.5 mm)"
    for name, (field, centre, gamma, of_gamma, of_core, of_centre, of_rms) in limits.items():
        rows = np.array([_from_images(field, centre, seed) for seed in SEEDS])
        key = name.lower()
        why = (
            use
            if name == "Lamb-Oseen"
            else "a quarter of the particles leave the sheet on the axis"
        )
        checks += [
            Check(f"images.{key}.circulation", f"{name}, PIV: circulation (seeds scatter by {rows[:, 0].std(ddof=1) / gamma:.1%})", float(rows[:, 0].mean()), of_gamma, "relative",
                  why, gamma, EXACT, "px²/frame"),
            Check(f"images.{key}.core", f"{name}, PIV: core radius", float(rows[:, 1].mean()), of_core, "relative", why, CORE,
                  EXACT, "px"),
            Check(f"images.{key}.centre", f"{name}, PIV: distance of the centre, rms", float(np.sqrt(np.mean(rows[:, 2] ** 2))),
                  of_centre, "at most", why, None, EXACT, "px"),
            Check(f"images.{key}.rms", f"{name}, PIV: rms error of a component", float(np.sqrt(np.mean(rows[:, 3] ** 2))),
                  of_rms, "at most", "twice what a 32 px window measures with 2 % noise", None, EXACT, "px"),
        ]  # fmt: skip
    for name, field, centre, radius, _ in OTHERS:
        exact = disc_circulation(field, centre, radius)
        ratio = float(
            np.mean([around(_piv(field, seed), centre, radius) / exact for seed in SEEDS])
        )
        checks.append(
            Check(f"images.{name.lower()}.contour", f"{name}, PIV: circulation round a circle of {radius:g} px, measured / exact",
                  ratio, 0.02, "relative", "twice the bound of the fitted circulation, which smooths over more vectors", 1.0, EXACT)
        )  # fmt: skip
    return checks


def _piv(field: Field, seed: int) -> xr.Dataset:
    a, b = render_pair(field, SHAPE, noise=0.02, sheet_thickness_px=SHEET, seed=seed)
    return correlate_pair(a, b)


def _from_images(
    field: Field, centre: tuple[float, float], seed: int
) -> tuple[float, float, float, float]:
    """Circulation, core radius, distance of the centre and rms error (px) from one pair."""
    plane = _piv(field, seed)
    vortex = nearest(find_vortices(plane), centre)
    exact = field(*np.meshgrid(plane["x"].values, plane["y"].values))[:2]
    inner = np.s_[3:-3, 3:-3]
    error = np.stack([plane["u"].values - exact[0], plane["v"].values - exact[1]])[
        :, inner[0], inner[1]
    ]
    gap = float(np.hypot(vortex.x - centre[0], vortex.y - centre[1]))
    return vortex.circulation, vortex.core_radius, gap, float(np.sqrt(np.nanmean(error**2)))


def measure() -> Result:
    """Every row of the PIV and vortex code."""
    text = (
        f"Planes of the exact field on 8 px, and pairs of images rendered from it ({SHAPE[1]} × {SHAPE[0]} px, 0.04 particles"
        f" per pixel, 2 % noise, three seeds), core radius {CORE:g} px, peak swirl {PEAK:g} px. `piv.correlation.pair` and"
        " `piv.vortices.find` with their defaults."
    )
    return Result(
        "exact_fields",
        "PIV and vortex code on exact fields",
        text,
        (*measure_planes(), *measure_images()),
    )
