"""The closed outline of the finger in the plane of symmetry: ventral profile and dorsal envelope."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def normals(profile: FloatArray) -> FloatArray:
    """Unit normals (point, 2) of a profile (point, 2), towards the dorsal side."""
    direction = np.gradient(profile, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.stack([direction[:, 1], -direction[:, 0]], -1)


def outline(profile: FloatArray, thickness: FloatArray) -> FloatArray:
    """Closed polygon (2 point, 2): the profile from root to tip, then the dorsal envelope back to the root."""
    dorsal = profile + thickness[:, None] * normals(profile)
    return np.concatenate([profile, dorsal[::-1]])


def crosses_itself(polygon: FloatArray) -> bool:
    """Whether two edges of a closed polygon (point, 2) that share no corner meet."""
    return not shapely.LinearRing(polygon).is_simple
