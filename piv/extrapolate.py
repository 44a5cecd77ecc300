"""Vectors continued linearly beyond the good ones: into a body, or into a core that was not found yet."""

from __future__ import annotations

import cv2
import numpy as np

from piv.outliers import fill_absent

REACH = 3  # nodes: good vectors that a plane is fitted to
WIDTH = 1.5  # nodes: standard deviation of their weight
RIDGE = 0.1  # nodes²: holds the slope down where the good vectors lie on a line
LEAST = 0.1  # weight of good vectors below which no plane is fitted

_AXIS = np.arange(-REACH, REACH + 1, dtype=np.float32)
_BELL = np.exp(-0.5 * (_AXIS / WIDTH) ** 2)


def _sums(field: np.ndarray) -> list[np.ndarray]:
    """Weighted sums of field times 1, x, y around every node, x and y in nodes."""

    def sums(kernel_x, kernel_y):
        return cv2.sepFilter2D(field, cv2.CV_32F, kernel_x, kernel_y, borderType=cv2.BORDER_CONSTANT)

    return [sums(_BELL, _BELL), sums(_AXIS * _BELL, _BELL), sums(_BELL, _AXIS * _BELL)]


def continue_linearly(u: np.ndarray, v: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Copies of u, v (ny, nx) whose other vectors are planes fitted to the `good` ones within three nodes.

    Beyond their reach vectors are filled by neighbours' means, as by `fill_absent`.
    """
    weight = good.astype(np.float32)
    m, mx, my = _sums(weight)
    axis2 = _AXIS**2 * _BELL
    mxx = cv2.sepFilter2D(weight, cv2.CV_32F, axis2, _BELL, borderType=cv2.BORDER_CONSTANT)
    myy = cv2.sepFilter2D(weight, cv2.CV_32F, _BELL, axis2, borderType=cv2.BORDER_CONSTANT)
    mxy = cv2.sepFilter2D(weight, cv2.CV_32F, _AXIS * _BELL, _AXIS * _BELL, borderType=cv2.BORDER_CONSTANT)
    total = np.maximum(m, 1e-9)
    cx, cy = mx / total, my / total  # centroid of the good vectors
    xx, yy, xy = mxx / total - cx**2 + RIDGE, myy / total - cy**2 + RIDGE, mxy / total - cx * cy
    det = xx * yy - xy**2
    fitted = ~good & (m > LEAST)
    out = []
    for field in (u, v):
        f, fx, fy = _sums(np.where(good, field, 0).astype(np.float32))
        mean = f / total
        gx, gy = fx / total - cx * mean, fy / total - cy * mean
        slope_x, slope_y = (yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det
        out.append(np.where(fitted, mean - slope_x * cx - slope_y * cy, field))
    return fill_absent(out[0], out[1], good | fitted)
