"""Bending of the finger by equations (1)-(6) of Hao et al. 2017, doi 10.1177/1729881417707148."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

LOWEST_VALID_PRESSURE = -25e3  # Pa; below it the walls would pass through each other
_CHAMBERS = 8
# m, as the paper names them: heights of the cavity and of its rectangular part, side wall, length
_H1, _H2, _B1, _L2 = 0.012, 0.007, 0.002, 0.003


_ACTUATOR = {
    "chambers": _CHAMBERS, "wedge_deg": 15.0, "width": 0.028, "h1": _H1, "h2": _H2, "l1": 0.002,
    "l2": _L2, "gap": 0.002, "b1": _B1, "b2": 0.0025,
}  # fmt: skip


def describes(actuator: dict[str, Any]) -> bool:
    """Whether the equations are of an actuator, a scene's section: its geometry is the paper's."""
    return all(np.isclose(actuator.get(key, np.nan), value) for key, value in _ACTUATOR.items())


def bend(
    pressure_pa: ArrayLike, *, width: float = 0.024, wedge_deg: float = 15.0, length: float = 0.070
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bend angle γ (rad), positive towards the ventral side, and radius R (m).

    `width` (m) is that of the cavity, W − 2 b1; the paper does not say which, and W = 28 mm would
    give R(20 kPa) = 37.9 mm. The fit of equation (3) gives a spurious bend at rest, γ = 0 at
    0.66 kPa, and the model knows no contact below `LOWEST_VALID_PRESSURE`.
    """
    loaded_area = width * _H2 + np.cos(np.deg2rad(wedge_deg)) * width * (_H1 - _H2)
    wall_area = 2 * _H1 * _B1 + (width + 2 * _B1) * _B1
    stress_kpa = np.asarray(pressure_pa, dtype=float) * loaded_area / wall_area / 1e3  # (1)
    strain = 6.35e-7 * stress_kpa**2 + 9.4e-3 * stress_kpa - 0.017  # (3)
    gamma = np.asarray(2 * _CHAMBERS * np.arctan(_L2 * strain / (2 * _H2)))  # (4), (5)
    with np.errstate(divide="ignore"):
        return gamma, np.asarray(length / gamma)  # (6)
