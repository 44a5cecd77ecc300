"""Vortices of a plane field: regions of rotation, each refined by a Lamb-Oseen fit."""

from __future__ import annotations

import numpy as np
import xarray as xr

from piv.formats.plane_series import MASKED, VALID, usable
from piv.formats.recording import window_of
from piv.images.masks import inside_polygon
from piv.vortices.contour import circle, round_contour
from piv.vortices.joint_fit import fit_regions
from piv.vortices.lamb_oseen_fit import PEAK_RADIUS
from piv.vortices.region_measures import CIRCLE, DISC, Measures, Plane
from piv.vortices.regions import Region, find_regions
from piv.vortices.settings import VortexSettings
from piv.vortices.vortex import Vortex

ALIKE = 1.5  # windows over which errors of PIV are alike: it smooths its vectors
_TIP_PART = 1 / 6  # of the tip's width: the scale at which its vortices are found
# smoothing lengths from a body's outline: nearer vectors, of its wall layer, are left out, since
# PIV sees them in part, and the layer's opposite vorticity would be smoothed into the vortex
WALL = 0.3


def find_vortices(
    plane: xr.Dataset, settings: VortexSettings | None = None, **options: float | str
) -> list[Vortex]:
    """Find the vortices of one plane, strongest first.

    A vortex is a region in which the smoothed flow rotates more than it strains; a Lamb-Oseen
    vortex on a background of drift and linear gradient is then fitted to it, its neighbours taken
    along or taken off.

    Parameters
    ----------
    plane
        u, v, valid and perhaps u_std, v_std over (y, x), in any unit.
    settings
        All settings, in place of `options`.
    options
        Fields of `VortexSettings`.

    Returns
    -------
    list of Vortex
        x, y, circulation and radius with their standard uncertainties, in the plane's units.

    Raises
    ------
    ValueError
        Where the plane has a time axis, or an option is unknown or out of its range.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(-0.05, 0.051, 0.002), np.arange(-0.04, 0.041, 0.002))
    >>> r2 = x**2 + y**2 + 1e-12
    >>> swirl = 0.006 / (2 * np.pi * r2) * (1 - np.exp(-r2 / 0.01**2))
    >>> (vortex,) = piv.find_vortices(piv.make_plane(x[0], y[:, 0], -swirl * y, swirl * x))
    >>> round(vortex.circulation, 4)
    0.006
    """
    s = _settings(settings, options)
    widest = float(max(np.ptp(plane[axis].values) for axis in "xy"))
    for name in ("scale", "radius", "correlation_length"):
        if (getattr(s, name) or 0.0) > widest:
            raise ValueError(
                f"{name} = {getattr(s, name):g} exceeds the plane, which is {widest:.3g} wide or"
                " high: give a smaller one, in the units of the axes"
            )
    p = plane_of(plane, s)
    scale = scale_of(plane, s)
    regions = find_regions(p, scale, s)
    start = np.array([_start(r.measures, scale) for r in regions]).reshape(-1, 4)
    fits = fit_regions(p, start, s)
    found = [
        _vortex(plane, r, fit or (np.nan,) * 9, DISC * scale, s.radius)
        for r, fit in zip(regions, fits, strict=True)
    ]
    return sorted(
        found, key=lambda v: (v.at_edge, -abs(v.peak_vorticity if v.at_edge else v.circulation))
    )


def _vortex(
    plane: xr.Dataset, r: Region, fit: tuple[float, ...], disc: float, radius: float | None
) -> Vortex:
    """The vortex of a region and its fit; its circulation does not depend on the scale.

    At the edge it has what is seen, and a fit where its region lies within the plane.
    """
    m, std = r.measures, r.std
    whole = fit[2], fit[6], np.nan
    if np.isnan(fit[2]):
        whole = m.circle, std.circle, CIRCLE * m.radius
    if radius is not None:
        within = round_contour(plane, circle(m.x, m.y, radius))
        whole = whole if np.isnan(within.circulation) else (*within[:2], radius)
    circulation, circulation_std, within_radius = (float(q) for q in whole)
    to_edge = _to_edge(plane, m.x, m.y)
    if to_edge < np.nanmax([disc, m.radius, within_radius]):
        # a fit needs the whole region, and no circle
        if to_edge < m.radius or not np.isnan(within_radius):
            circulation, circulation_std, fit = np.nan, np.nan, (np.nan,) * 9
        seen = m.x, m.y, circulation, np.nan, m.radius, m.peak_vorticity, np.nan, disc
        return Vortex(*seen, np.nan, np.nan, circulation_std, *[np.nan] * 6, *fit, at_edge=True)
    return Vortex(
        *(m.x, m.y, circulation, within_radius, m.radius, m.peak_vorticity, m.circulation, disc),
        *(std.x, std.y, circulation_std, std.radius, std.peak_vorticity, std.circulation),
        *(r.random.x, r.random.y, r.random.circulation, *fit),
    )


def _to_edge(plane: xr.Dataset, x: float, y: float) -> float:
    """Distance from a point to the nearest edge of the plane."""
    ends = ((plane[axis].values[[0, -1]], at) for axis, at in (("x", x), ("y", y)))
    return float(min(np.abs(end - at).min() for end, at in ends))


def scale_of(plane: xr.Dataset, s: VortexSettings) -> float:
    """The smoothing length: as set, or a sixth of the tip's width, or of a window its half.

    Of a plane that has neither, two grid steps; never less than one.
    """
    if s.scale is not None:
        if s.scale < _step(plane) / 2:
            raise ValueError(
                f"scale = {s.scale:g} is less than half a grid step of {_step(plane):.3g}, and no"
                " vortex could be found: give a larger one, in the units of the axes"
            )
        return s.scale
    if "tip_width" in plane.attrs:
        return max(_TIP_PART * float(plane.attrs["tip_width"]), _step(plane))
    return (window_of(plane) or 4 * _step(plane)) / 2


def _step(plane: xr.Dataset) -> float:
    return float(max(np.ptp(plane[axis].values[:2]) for axis in "xy"))


def _start(m: Measures, scale: float) -> tuple[float, float, float, float]:
    """Centre, circulation and core radius from which a fit starts: as of a Lamb-Oseen vortex."""
    wide = m.radius / PEAK_RADIUS  # Q > 0 bounds a Lamb-Oseen vortex there
    core = np.sqrt(max(wide**2 - 2 * scale**2, (m.radius / 2) ** 2))
    return m.x, m.y, -m.circulation / np.expm1(-((DISC * scale / wide) ** 2)), core


def _settings(settings: VortexSettings | None, options: dict[str, float | str]) -> VortexSettings:
    base = settings or VortexSettings()
    unknown = sorted(set(options) - set(vars(base)))
    if unknown:
        raise ValueError(
            f"unknown vortex option {unknown[0]!r}; the options are {', '.join(vars(base))}"
        )
    return VortexSettings(**(vars(base) | options))


def _at_walls(plane: xr.Dataset, near: float) -> np.ndarray:
    """Which grid points (y, x) lie within an outline of the plane, or nearer to it than `near`."""
    axes = plane["x"].values, plane["y"].values
    mask = np.zeros([a.size for a in axes[::-1]], bool)
    for outline in plane["outline"].values.reshape(-1, *plane["outline"].shape[-2:]):
        if not np.isfinite(outline).all():
            continue  # no such finger at this instant
        low, high = outline.min(axis=0) - near, outline.max(axis=0) + near
        columns, rows = (slice(*np.searchsorted(axes[k], (low[k], high[k]))) for k in (0, 1))
        mask[rows, columns] |= inside_polygon(outline, axes[0][columns], axes[1][rows], near)
    return mask


def plane_of(plane: xr.Dataset, s: VortexSettings) -> Plane:
    """The arrays of a plane, with the weights of its vectors in the fit."""
    fields = plane.variables  # without the coordinates that plane[name] makes each time
    for name in ("u", "v"):
        if name not in plane or set(fields[name].dims) != {"y", "x"}:
            dims = fields[name].dims if name in plane else "none"
            raise ValueError(
                f"vortices are found in one plane with {name!r} over (y, x), got dimensions {dims}"
            )

    def values(name: str) -> np.ndarray:
        return fields[name].transpose("y", "x").values.astype(float)

    u, v = values("u"), values("v")
    valid = np.isfinite(u) & np.isfinite(v)
    lost, wall = np.zeros((2, *valid.shape), bool)
    if "valid" in plane:
        valid &= usable(plane).transpose("y", "x").values
    if "flag" in plane:
        lost = ~valid & ~np.isin(values("flag"), (VALID, MASKED))
    if "outline" in plane:
        wall = _at_walls(plane, WALL * scale_of(plane, s))
        valid &= ~wall
        lost = ~valid & ~wall
    weights = [valid.astype(float)] * 2
    stds = [values(name) for name in ("u_std", "v_std") if name in plane]
    good = [valid & np.isfinite(std) & (std > 0) for std in stds]
    noise = [np.where(g, std, 0.0) for g, std in zip(good, stds, strict=True)]
    # of both components, or their weights would not be comparable
    if s.weights == "uncertainty" and len(good) == 2 and all(g.any() for g in good):
        # a few vectors with an implausibly small error must not rule the fit
        weights = [
            np.where(g, 1 / np.maximum(n, 0.3 * np.median(n[g])) ** 2, 0.0)
            for g, n in zip(good, noise, strict=True)
        ]
    u, v = (np.where(valid, q, np.nan) for q in (u, v))
    correlated = s.correlation_length or ALIKE * window_of(plane) or _step(plane)
    errors = (noise[0], noise[1]) if len(noise) == 2 else None
    axes = plane["x"].values.astype(float), plane["y"].values.astype(float)
    return Plane(*axes, u, v, valid, lost, wall, errors, correlated, *weights)
