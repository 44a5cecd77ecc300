"""The closed outline of the finger in the plane of symmetry."""

import numpy as np
import shapely

from pipeline.formats.bending_states import FloatArray


def outline(profile: FloatArray, thickness: FloatArray) -> FloatArray:
    """Closed polygon (2 point, 2): the profile from root to tip, then the dorsal side back."""
    direction = np.gradient(profile, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normals = np.stack([direction[:, 1], -direction[:, 0]], -1)
    return np.concatenate([profile, (profile + thickness[:, None] * normals)[::-1]])


def crosses_itself(polygon: FloatArray) -> bool:
    """Whether two edges of a closed polygon (point, 2) that share no corner meet."""
    return not shapely.LinearRing(polygon).is_simple
