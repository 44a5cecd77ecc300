"""Bending of the finger by equations (1)-(6) of Hao et al. 2017, doi 10.1177/1729881417707148."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

CHAMBERS = 8
# m, as the paper names them: heights of the cavity and of its rectangular part, side wall, length of the cavity
H1, H2, B1, L2 = 0.012, 0.007, 0.002, 0.003
LOWEST_VALID_PRESSURE = (
    -25e3
)  # Pa; below it the walls of the default chamber would pass through each other


def wall_stress(pressure_pa: ArrayLike, width: float, wedge_deg: float) -> NDArray[np.float64]:
    """Mean axial stress in the chamber's walls (Pa), equation (1); `width` is that of the cavity."""
    loaded_area = width * H2 + np.cos(np.deg2rad(wedge_deg)) * width * (H1 - H2)
    wall_area = 2 * H1 * B1 + (width + 2 * B1) * B1
    return np.asarray(pressure_pa, dtype=float) * loaded_area / wall_area


def strain(stress_pa: ArrayLike) -> NDArray[np.float64]:
    """Strain of the gap between a chamber's walls, the paper's fit, equation (3) (there in kPa)."""
    stress_kpa = np.asarray(stress_pa, dtype=float) / 1e3
    return 6.35e-7 * stress_kpa**2 + 9.4e-3 * stress_kpa - 0.017


def bend(
    pressure_pa: ArrayLike, *, width: float = 0.024, wedge_deg: float = 15.0, length: float = 0.070
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bend angle γ (rad) and radius R (m) over the chamber pressure (Pa), both of the shape of `pressure_pa`.

    `width` is that of the cavity, W − 2 b1 (the paper does not say which; W = 28 mm would give R(20 kPa) = 37.9 mm).
    Positive towards the ventral side. Lengths in m. Source: equations (1)-(6).

    Validity: the fit of equation (3) gives ε(0) = −0.017, hence a spurious bend at rest (γ = 0 at P = 0.66 kPa and
    R infinite there); below `LOWEST_VALID_PRESSURE` the model knows no contact and the walls of neighbouring
    chambers pass through each other: the caller clips or refuses.
    """
    stress = wall_stress(pressure_pa, width, wedge_deg)
    half_angle = np.arctan(L2 * strain(stress) / (2 * H2))  # equation (4)
    gamma = np.asarray(2 * CHAMBERS * half_angle)  # equation (5)
    with np.errstate(divide="ignore"):
        radius = np.asarray(length / gamma)  # equation (6)
    return gamma, radius
