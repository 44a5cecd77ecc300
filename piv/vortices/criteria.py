"""Local vortex criteria of a plane field: vorticity, signed swirling strength, 2-D Q."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray

SCHEMES = ("least-squares", "fourth-order")


class Gradients(NamedTuple):
    """Velocity gradients (y, x), 1/s; NaN where too few neighbours are valid."""

    dudx: ndarray
    dudy: ndarray
    dvdx: ndarray
    dvdy: ndarray


def gradients(
    u: ndarray, v: ndarray, valid: ndarray, dx: float, dy: float, scheme: str = "least-squares"
) -> Gradients:
    """Velocity gradients on a regular grid (y, x).

    With two valid neighbours on both sides: `least-squares` (slope of a line through five points,
    low noise) or `fourth-order` (central). Beside invalid points the second-order central or
    one-sided formula of the points that are there, then the first-order one; a stencil never
    reaches past an invalid point, so never across a body. Source: Raffel et al., Particle Image
    Velocimetry (2018), table 7.1.
    """
    if scheme not in SCHEMES:
        raise ValueError(f"gradient scheme must be one of {', '.join(SCHEMES)}, got {scheme!r}")
    ok = np.asarray(valid).astype(bool) & np.isfinite(u) & np.isfinite(v)
    return Gradients(
        derivative(u, ok, dx, 1, scheme),
        derivative(u, ok, dy, 0, scheme),
        derivative(v, ok, dx, 1, scheme),
        derivative(v, ok, dy, 0, scheme),
    )


def derivative(f: ndarray, ok: ndarray, step: float, axis: int, scheme: str) -> ndarray:
    """Derivative of `f` (y, x), or of a stack (…, y, x), along y (`axis` 0) or x (1).

    Scheme as in `gradients`.
    """
    f = np.moveaxis(np.where(ok, f, 0.0), axis - 2, -1)
    ok = np.moveaxis(ok, axis - 2, -1)
    n = f.shape[-1]
    value = np.pad(f, [(0, 0)] * (f.ndim - 1) + [(2, 2)])
    there = np.pad(ok, [(0, 0)] * (ok.ndim - 1) + [(2, 2)])

    def at(k: int) -> ndarray:
        return value[..., 2 + k : 2 + k + n]

    left1, right1 = (there[..., 2 + k : 2 + k + n] for k in (-1, 1))
    left2, right2 = left1 & there[..., :n], right1 & there[..., 4:]
    full = (
        (2 * at(2) + at(1) - at(-1) - 2 * at(-2)) / 10
        if scheme == "least-squares"
        else (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12
    )
    out = np.select(
        [left2 & right2, left1 & right1, right2, left2, right1, left1],
        [
            full,
            (at(1) - at(-1)) / 2,
            (-3 * at(0) + 4 * at(1) - at(2)) / 2,
            (3 * at(0) - 4 * at(-1) + at(-2)) / 2,
            at(1) - at(0),
            at(0) - at(-1),
        ],
        np.nan,
    )
    return np.moveaxis(np.where(ok, out / step, np.nan), -1, axis - 2)


def vorticity(g: Gradients) -> ndarray:
    """Out-of-plane vorticity dv/dx - du/dy, counter-clockwise positive."""
    return g.dvdx - g.dudy


def swirling_strength(g: Gradients) -> ndarray:
    """Swirling strength: imaginary part of the complex eigenvalues, with vorticity's sign; or 0.

    Source: Zhou, Adrian, Balachandar & Kendall, J. Fluid Mech. 387 (1999), in two dimensions.
    """
    discriminant = (g.dudx - g.dvdy) ** 2 / 4 + g.dudy * g.dvdx
    return np.sqrt(np.maximum(-discriminant, 0)) * np.sign(vorticity(g))


def q_criterion(g: Gradients) -> ndarray:
    """Two-dimensional Q = -(dudx^2 + dvdy^2)/2 - dudy dvdx, 1/s^2."""
    return -(g.dudx**2 + g.dvdy**2) / 2 - g.dudy * g.dvdx
