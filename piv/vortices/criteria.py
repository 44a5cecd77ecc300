"""Local vortex criteria of a plane field: vorticity, signed swirling strength, 2-D Q."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from piv.compiled import compiled

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

    ok: (y, x). Scheme as in `gradients`.
    """
    values = np.ascontiguousarray(f, float).reshape(-1, *ok.shape)
    out = np.empty(values.shape)
    turned = (values, ok, out) if axis else (values.swapaxes(1, 2), ok.T, out.swapaxes(1, 2))
    _along_x(*turned, step, scheme == SCHEMES[1])
    return out.reshape(f.shape)


@compiled
def _along_x(f, ok, out, step, fourth):
    count, rows, columns = f.shape
    for r in range(rows):
        for c in range(columns):
            if not ok[r, c]:
                out[:, r, c] = np.nan
                continue
            left = 0
            while left < 2 and c > left and ok[r, c - left - 1]:
                left += 1
            right = 0
            while right < 2 and c + right + 1 < columns and ok[r, c + right + 1]:
                right += 1
            for k in range(count):
                g = f[k, r]
                if left == 2 and right == 2:
                    if fourth:
                        d = (8 * (g[c + 1] - g[c - 1]) - (g[c + 2] - g[c - 2])) / 12
                    else:
                        d = (2 * g[c + 2] + g[c + 1] - g[c - 1] - 2 * g[c - 2]) / 10
                elif left and right:
                    d = (g[c + 1] - g[c - 1]) / 2
                elif right == 2:
                    d = (-3 * g[c] + 4 * g[c + 1] - g[c + 2]) / 2
                elif left == 2:
                    d = (3 * g[c] - 4 * g[c - 1] + g[c - 2]) / 2
                elif right:
                    d = g[c + 1] - g[c]
                elif left:
                    d = g[c] - g[c - 1]
                else:
                    d = np.nan
                out[k, r, c] = d / step


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
