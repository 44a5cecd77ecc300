"""One vortex of a plane field."""

from __future__ import annotations

from dataclasses import dataclass

from piv.vortices.lamb_oseen_fit import PEAK_RADIUS


@dataclass(frozen=True)
class Vortex:
    """One vortex, in the plane's units; counter-clockwise positive; `*_std` are standard errors.

    Swirl: circulation/(2 pi r) (1 - exp(-r^2/core_radius^2)); `peak_swirl_velocity` is its signless
    maximum, at `peak_swirl_radius` = 1.1209 core_radius. `circulation_contour` and
    `circulation_area` are integrals over the circle of `contour_radius` (NaN where a body leaves no
    room for one of half a core radius). `drift_u`, `drift_v`: background velocity at the centre;
    `shear`: norm of the background's gradient; `explained`: part of the vectors' variance that the
    fit explains; `n_vectors`: vectors in the fit.
    """

    x: float
    y: float
    circulation: float
    core_radius: float
    peak_swirl_velocity: float
    x_std: float
    y_std: float
    circulation_std: float
    core_radius_std: float
    peak_swirl_velocity_std: float
    circulation_area: float
    circulation_contour: float
    contour_radius: float
    drift_u: float
    drift_v: float
    shear: float
    explained: float
    n_vectors: int

    def __repr__(self) -> str:
        place = f"x={self.x:.4g}, y={self.y:.4g}"
        strength = f"circulation={self.circulation:.4g}, core_radius={self.core_radius:.4g}"
        return f"Vortex({place}, {strength})"

    @property
    def peak_swirl_radius(self) -> float:
        """Radius of the largest swirl velocity."""
        return PEAK_RADIUS * self.core_radius
