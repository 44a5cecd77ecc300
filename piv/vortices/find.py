"""Vortices of a plane field: detection by Gamma2 and swirling strength, then a joint fit."""

from __future__ import annotations

import cv2
import numpy as np
import xarray as xr

from fileio.formats.plane_series import usable
from piv.vortices.circulation import (
    area_circulation,
    clear_radius,
    contour_circulation,
    distance_to_invalid,
)
from piv.vortices.criteria import gradients, vorticity
from piv.vortices.joint_fit import fit_regions
from piv.vortices.lamb_oseen_fit import PEAK_SWIRL, Fit
from piv.vortices.regions import Plane, find_candidates
from piv.vortices.settings import VortexSettings
from piv.vortices.vortex import Vortex


def find_vortices(
    plane: xr.Dataset, settings: VortexSettings | None = None, **options: float | str
) -> list[Vortex]:
    """Vortices of one plane (y, x; variables u, v, valid, optional u_std, v_std), strongest first.

    Works in whatever units the plane has. `options` are fields of `VortexSettings`. Candidates are
    regions of Gamma2 and swirling strength; each is then fitted with a Lamb-Oseen vortex on a
    background of drift and linear gradient, its neighbours taken along or taken off. None lies
    within an `outline` that the plane has. Raises ValueError where the plane still has a time axis
    or an option is unknown.
    """
    s = _settings(settings, options)
    p = plane_of(plane, s.weights)
    dx, dy = float(p.x[1] - p.x[0]), float(p.y[1] - p.y[0])
    g = gradients(p.u, p.v, p.valid, dx, dy, s.scheme)
    candidates = find_candidates(p, g, s)
    if not candidates:
        return []
    least = s.min_circulation
    rough = 0.3 * (s.min_part * abs(candidates[0].circulation) if least is None else least)
    regions = np.array([c for c in candidates if abs(c.circulation) >= rough]).reshape(-1, 4)
    # the layer on a wall that is still rolling up may be fitted best from within the body: no
    # vortex is there yet
    fits = [f for f in fit_regions(p, regions, s) if not _in_body(plane, *f.fit.vortices[0, :2])]
    omega = vorticity(g)
    distance = distance_to_invalid(p.valid, dx, dy)
    return sorted(
        (_record(p, f.fit, omega, distance, f.n_vectors) for f in fits),
        key=lambda w: -abs(w.circulation),
    )


def _settings(settings: VortexSettings | None, options: dict[str, float | str]) -> VortexSettings:
    base = settings or VortexSettings()
    unknown = sorted(set(options) - set(vars(base)))
    if unknown:
        raise ValueError(
            f"unknown vortex option {unknown[0]!r}; the options are {', '.join(vars(base))}"
        )
    return VortexSettings(**(vars(base) | options))


def _in_body(plane: xr.Dataset, x: float, y: float) -> bool:
    """Whether a point lies within one of the outlines that the plane holds."""
    if "outline" not in plane:
        return False
    outline = plane["outline"].values.astype(np.float32)
    bodies = outline.reshape(-1, *outline.shape[-2:])
    return any(cv2.pointPolygonTest(body, (float(x), float(y)), False) > 0 for body in bodies)


def plane_of(plane: xr.Dataset, weighting: str) -> Plane:
    """The arrays of a plane, with the weights of its vectors in the fit."""
    for name in ("u", "v"):
        if name not in plane or set(plane[name].dims) != {"y", "x"}:
            dims = plane[name].dims if name in plane else "none"
            raise ValueError(
                f"vortices are found in one plane with {name!r} over (y, x), got dimensions {dims}"
            )
    u, v = (plane[n].transpose("y", "x").values.astype(float) for n in ("u", "v"))
    x, y = plane["x"].values.astype(float), plane["y"].values.astype(float)
    valid = np.isfinite(u) & np.isfinite(v)
    if "valid" in plane:
        valid &= usable(plane).transpose("y", "x").values
    weights = []
    for name in ("u_std", "v_std"):
        if name in plane and weighting == "uncertainty":
            std = plane[name].transpose("y", "x").values.astype(float)
            good = valid & np.isfinite(std) & (std > 0)
            # a few vectors with an implausibly small error must not rule the fit
            floor = 0.3 * np.median(std[good]) if good.any() else 1.0
            weights.append(
                np.where(good, 1 / np.maximum(np.where(good, std, 1.0), floor) ** 2, 0.0)
            )
        else:
            weights.append(valid.astype(float))
    xx, yy = np.meshgrid(x, y)
    u, v = (np.where(valid, q, np.nan) for q in (u, v))
    noise_known = weighting == "uncertainty" and "u_std" in plane and "v_std" in plane
    return Plane(x, y, u, v, valid, weights[0], weights[1], xx, yy, noise_known)


def _record(p: Plane, fit: Fit, omega: np.ndarray, distance: np.ndarray, n: int) -> Vortex:
    x, y, circulation, a = (float(q) for q in fit.vortices[0])
    std = np.sqrt(np.maximum(np.diag(fit.covariance)[:4], 0))
    peak = PEAK_SWIRL * abs(circulation) / (2 * np.pi * a)
    slope = np.array([peak / circulation, -peak / a])
    peak_std = np.sqrt(max(slope @ fit.covariance[2:4, 2:4] @ slope, 0.0))
    radius = clear_radius(distance, p.x, p.y, x, y, 2 * a)
    integrals: tuple[float, ...] = (np.nan, np.nan, np.nan)
    if radius >= 0.5 * a:
        area = area_circulation(p.x, p.y, omega, x, y, radius)
        integrals = area, contour_circulation(p.x, p.y, p.u, p.v, x, y, radius), radius
    drift, shear = fit.background[[0, 3]], np.hypot.reduce(fit.background[[1, 2, 4, 5]])
    values = (x, y, circulation, a, peak, *std, peak_std, *integrals, *drift, shear, fit.explained)
    # all but the last are floats
    return Vortex(*map(float, values), n)  # type: ignore[arg-type, call-arg]
