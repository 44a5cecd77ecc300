"""How vortices are found in a plane field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated


@dataclass(frozen=True)
class VortexSettings:
    """How vortices are found; lengths and circulations in the plane's units.

    `piv vortices --help` explains every field, which is an option there. ValueError where one is
    out of its range.

    Examples
    --------
    >>> piv.VortexSettings(min_part=0.2).least_part
    0.1
    """

    scale: Annotated[
        float | None,
        "smoothing length of the flow (standard deviation of the Gaussian) at which vortices are "
        "sought; None = a sixth of the tip's width, else half a PIV window, else two grid steps",
    ] = None
    radius: Annotated[
        float | None,
        "circulation within this distance of the centre, where a vector is everywhere on that "
        "circle; None = in all by the Lamb-Oseen fit, else within two radii of the vortex",
    ] = None
    least_part: Annotated[float, "least vorticity within a vortex, as a part of its largest"] = 0.1
    max_elongation: Annotated[float, "longest region, length over width"] = 4.0
    min_circulation: Annotated[
        float | None, "least |circulation|; None = min_part of the plane's strongest"
    ] = None
    min_part: Annotated[float, "least |circulation| as a part of the plane's strongest"] = 0.1
    significance: Annotated[float, "least |circulation| over its standard uncertainty"] = 2.0
    # doubled in steps as long as the residuals are no larger than the vectors' uncertainty, or than
    # those of the first disc
    fit_radius: Annotated[float, "radius of the fitted disc, core radii"] = 2.0
    min_explained: Annotated[float, "least part of the variance that a fit must explain"] = 0.3
    neighbour_part: Annotated[
        float, "weaker neighbours than this part of a vortex belong to its background"
    ] = 0.3
    strain_prior: Annotated[float, "expected background strain over the vortex' peak vorticity"] = (
        0.3
    )
    rotation_prior: Annotated[
        float, "expected background vorticity over the vortex' peak vorticity"
    ] = 0.03
    correlation_length: Annotated[
        float | None,
        "distance over which vector errors are correlated; None = the PIV window's width, else a "
        "grid step, in the fit from the residuals",
    ] = None
    # equal where two planes are compared of which only one has uncertainties
    weights: Annotated[
        str, "of the vectors in the fit: uncertainty (where it is known) or equal"
    ] = "uncertainty"

    def __post_init__(self) -> None:
        if self.weights not in ("uncertainty", "equal"):
            raise ValueError(f"weights = {self.weights!r}: give 'uncertainty' or 'equal'")
        for name in ("least_part", "min_part", "min_explained", "neighbour_part"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name):g}: give a number from 0 to 1")
        for name in ("scale", "radius", "max_elongation", "fit_radius", "correlation_length"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} = {value:g}: give a positive number")
        for name in ("min_circulation", "significance"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise ValueError(f"{name} = {value:g}: give no negative number")
        for name in ("strain_prior", "rotation_prior"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} = {getattr(self, name):g}: give a positive number, 1e9 to switch it "
                    "off"
                )
