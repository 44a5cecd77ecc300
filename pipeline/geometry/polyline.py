"""Measures of polylines."""

from __future__ import annotations

import numpy as np


def arc_length(line: np.ndarray) -> np.ndarray:
    """Length (point,) along a polyline (point, 2), zero at its start."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
