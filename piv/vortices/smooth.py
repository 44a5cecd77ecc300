"""Velocity gradients of a plane at a stated scale: local linear fits with Gaussian weights."""

from __future__ import annotations

import cv2
import numpy as np
from numpy import ndarray

from piv.vortices.criteria import Gradients

# of the weights, standard deviations; ended at three they smooth a twentieth less in variance than
# `scale` says, and a peak is 1 % too high
REACH = 4.0
_LEAST_SPREAD = 0.02  # of the neighbours in two directions, variances; 1 away from absent vectors
_LEAST_SEEN = 0.3  # share of the weights that lies on vectors: with less there is no gradient


class Smoother:
    """Gradients at one scale of fields that have the same grid and the same absent vectors.

    Around each point a plane is fitted to the velocity, with weights exp(-r^2/(2 scale^2)). Away
    from absent vectors its slope is the gradient of the velocity after a Gaussian filter of the
    standard deviation `scale`; beside them it is exact for a linear field, too. Source: Fan &
    Gijbels, Local Polynomial Modelling (1996), ch. 3.
    """

    def __init__(self, valid: ndarray, lost: ndarray, dx: float, dy: float, scale: float) -> None:
        """Of a grid with vectors where `valid`; also where one is `lost` there are gradients."""
        self.valid = valid
        self._x, self._y = _weights(dx, scale), _weights(dy, scale)
        seen = valid.astype(float)
        m00 = self._moment(seen, 0, 0)
        self.ok = (valid | lost) & (m00 >= _LEAST_SEEN)
        m00 = np.where(self.ok, m00, 1.0)
        mx, my, mxx, mxy, myy = (
            self._moment(seen, i, j) / m00 for i, j in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )
        mxx, mxy, myy = mxx - mx**2, mxy - mx * my, myy - my**2
        determinant = mxx * myy - mxy**2
        self.ok &= determinant > _LEAST_SPREAD * scale**4
        determinant = np.where(self.ok, m00 * determinant, 1.0)
        self._mean = mx, my
        self._inverse = tuple(q / determinant for q in (mxx, mxy, myy))

    def gradients(self, u: ndarray, v: ndarray) -> Gradients:
        """Gradients of velocities (y, x) or (y, x, n); NaN where too few vectors are near."""
        return Gradients(*self._slopes(u), *self._slopes(v))

    def _slopes(self, f: ndarray) -> tuple[ndarray, ndarray]:
        more = (1,) * (f.ndim - 2)
        mx, my, xx, xy, yy, ok, valid = (
            q.reshape(*q.shape, *more) for q in (*self._mean, *self._inverse, self.ok, self.valid)
        )
        f = np.where(valid, f, 0.0)
        f0, fx, fy = (self._moment(f, i, j) for i, j in ((0, 0), (1, 0), (0, 1)))
        fx, fy = fx - f0 * mx, fy - f0 * my
        return (
            np.where(ok, yy * fx - xy * fy, np.nan),
            np.where(ok, xx * fy - xy * fx, np.nan),
        )

    def _moment(self, f: ndarray, i: int, j: int) -> ndarray:
        """Weighted sum over the neighbours of `f` x^i y^j, with their offsets x and y."""
        (x, wx), (y, wy) = self._x, self._y
        out = cv2.sepFilter2D(f, cv2.CV_64F, wx * x**i, wy * y**j, borderType=cv2.BORDER_CONSTANT)
        return out.reshape(f.shape)


def _weights(step: float, scale: float) -> tuple[ndarray, ndarray]:
    """Offsets and weights of the neighbours along one axis."""
    count = max(1, int(np.ceil(REACH * scale / step - 1e-6)))
    offset = np.arange(-count, count + 1) * step
    wide = scale
    for _ in range(3):
        weight = np.exp(-((offset / wide) ** 2) / 2)
        square, fourth = (weight @ offset**k / weight.sum() for k in (2, 4))
        wide *= scale / np.sqrt((square + fourth / (3 * square)) / 2)
    return offset, weight / weight.sum()
