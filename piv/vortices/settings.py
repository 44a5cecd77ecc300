"""How vortices are found in a plane field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from piv.vortices.criteria import SCHEMES


@dataclass(frozen=True)
class VortexSettings:
    """How vortices are found; lengths and circulations in the plane's units."""

    stencil_radius: Annotated[
        float | None,
        "radius of the Gamma2 disc, None = two grid steps; larger finds larger vortices only",
    ] = None
    gamma2: Annotated[
        float, "least |Gamma2| of a vortex region (2/pi: rotation exceeds strain)"
    ] = 2 / np.pi
    min_points: Annotated[int, "least grid points of a region"] = 5
    max_elongation: Annotated[float, "longest region, length over width"] = 4.0
    min_circulation: Annotated[
        float | None, "least |circulation|; None = --min-part of the plane's strongest"
    ] = None
    min_part: Annotated[float, "least |circulation| as a part of the plane's strongest"] = 0.1
    significance: Annotated[float, "least |circulation| over its standard error"] = 2.0
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
    # relative standard deviation; weighs as the hidden part of the disc over the seen one
    region_prior: Annotated[
        float, "expected scatter of a core radius about its region's, half of the disc hidden"
    ] = 0.2
    correlation_length: Annotated[
        float | None,
        "distance over which vector errors are correlated: the window's width; None = from the "
        "residuals",
    ] = None
    scheme: Annotated[str, "of the gradients: least-squares or fourth-order"] = "least-squares"
    # equal where two planes are compared of which only one has uncertainties
    weights: Annotated[str, "of the vectors in the fit: uncertainty (where given) or equal"] = (
        "uncertainty"
    )

    def __post_init__(self) -> None:
        if self.weights not in ("uncertainty", "equal"):
            raise ValueError(f"weights = {self.weights!r}: give 'uncertainty' or 'equal'")
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme = {self.scheme!r}: give {' or '.join(map(repr, SCHEMES))}")
        for name in ("gamma2", "min_part", "min_explained", "neighbour_part"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name):g}: give a number from 0 to 1")
        if self.min_points < 1:
            raise ValueError(f"min_points = {self.min_points}: a region has at least 1 point")
        for name in ("stencil_radius", "max_elongation", "fit_radius", "correlation_length"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} = {value:g}: give a positive number")
        for name in ("min_circulation", "significance"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise ValueError(f"{name} = {value:g}: give no negative number")
        for name in ("strain_prior", "rotation_prior", "region_prior"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} = {getattr(self, name):g}: give a positive number, 1e9 to switch it "
                    "off"
                )
