"""Bending of the finger by equations (1)-(6) of Hao et al. 2017, doi 10.1177/1729881417707148."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LOWEST_VALID_PRESSURE = -25e3  # Pa; below it the walls of the default chamber would pass through each other


def wall_stress(
    pressure_pa: ArrayLike,
    *,
    width: float = 0.024,
    wedge_deg: float = 15.0,
    h1: float = 0.012,
    h2: float = 0.007,
    b1: float = 0.002,
) -> NDArray[np.float64]:
    """Mean axial stress in the chamber's walls (Pa), equation (1); `width` is that of the cavity."""
    pressure = np.asarray(pressure_pa, dtype=float)
    loaded_area = width * h2 + np.cos(np.deg2rad(wedge_deg)) * width * (h1 - h2)
    wall_area = 2 * h1 * b1 + (width + 2 * b1) * b1
    return pressure * loaded_area / wall_area


def strain(stress_pa: ArrayLike) -> NDArray[np.float64]:
    """Strain of the gap between a chamber's walls, the paper's fit, equation (3) (there in kPa)."""
    stress_kpa = np.asarray(stress_pa, dtype=float) / 1e3
    return 6.35e-7 * stress_kpa**2 + 9.4e-3 * stress_kpa - 0.017


def bend(
    pressure_pa: ArrayLike,
    *,
    chambers: int = 8,
    width: float = 0.024,
    wedge_deg: float = 15.0,
    h1: float = 0.012,
    h2: float = 0.007,
    b1: float = 0.002,
    l2: float = 0.003,
    length: float = 0.070,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bend angle γ (rad) and radius R (m) over the chamber pressure (Pa), both of the shape of `pressure_pa`.

    `width` is that of the cavity, W − 2 b1 (the paper does not say which; W = 28 mm would give R(20 kPa) = 37.9 mm).
    Positive towards the ventral side. Lengths in m. Source: equations (1)-(6).

    Validity: the fit of equation (3) gives ε(0) = −0.017, hence a spurious bend at rest (γ = 0 at P = 0.66 kPa and
    R infinite there); below `LOWEST_VALID_PRESSURE` the model knows no contact and the walls of neighbouring
    chambers pass through each other: the caller clips or refuses.
    """
    stress = wall_stress(pressure_pa, width=width, wedge_deg=wedge_deg, h1=h1, h2=h2, b1=b1)
    half_angle = np.arctan(l2 * strain(stress) / (2 * h2))  # equation (4)
    gamma = np.asarray(2 * chambers * half_angle)  # equation (5)
    with np.errstate(divide="ignore"):
        radius = np.asarray(length / gamma)  # equation (6)
    return gamma, radius
