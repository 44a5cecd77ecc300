"""One vortex of a plane field."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Vortex:
    """One vortex, in the plane's units; counter-clockwise positive; `*_std`: standard uncertainty.

    `x`, `y`, `radius` and `peak_vorticity` are of its region, where the smoothed flow rotates more
    than it strains: centroid, circle of equal area, largest vorticity. `circulation` is the whole
    one of the Lamb-Oseen fit, with `circulation_radius` NaN; where none fits, or a radius is set,
    the one within `circulation_radius`. `circulation_disc` is the smoothed vorticity within
    `disc_radius`, which goes with the smoothing length. `*_random_std` is the part of the
    uncertainty that the vectors' errors make. `x_fit` to `explained` are of the Lamb-Oseen vortex
    that fits best, swirl circulation/(2 pi r) (1 - exp(-r^2/core_radius^2)); NaN where none fits.
    `explained` is the part of the vectors' variance that it explains.

    `at_edge`: a circle that it is measured within reaches beyond the plane. Its place, radius and
    peak are those of the part that is seen, its circulation and fit are told where its region lies
    within the plane; all other measures are NaN.
    """

    x: float
    y: float
    circulation: float
    circulation_radius: float
    radius: float
    peak_vorticity: float
    circulation_disc: float
    disc_radius: float
    x_std: float
    y_std: float
    circulation_std: float
    radius_std: float
    peak_vorticity_std: float
    circulation_disc_std: float
    x_random_std: float
    y_random_std: float
    circulation_disc_random_std: float
    x_fit: float
    y_fit: float
    circulation_fit: float
    core_radius: float
    x_fit_std: float
    y_fit_std: float
    circulation_fit_std: float
    core_radius_std: float
    explained: float
    at_edge: bool = field(default=False, kw_only=True)

    def __repr__(self) -> str:
        place = f"x={self.x:.4g}, y={self.y:.4g}"
        strength = f"circulation={self.circulation:.4g}, radius={self.radius:.4g}"
        return f"Vortex({place}, {strength})"
