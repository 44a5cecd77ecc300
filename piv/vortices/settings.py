"""How vortices are found in a plane field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class VortexSettings:
    """How vortices are found; lengths and circulations in the plane's units.

    stencil_radius: radius of the Gamma2 disc; None = two grid steps. Larger finds larger vortices only.
    gamma2: least |Gamma2| of a region (2/pi: rotation exceeds strain).
    min_points: least grid points of a region. max_elongation: longest region, length over width.
    min_circulation: least |circulation|; None = `min_part` of the strongest in the plane.
    significance: least |circulation| over its standard error.
    fit_radius: radius of the fitted disc in core radii; where vectors know their uncertainty it is doubled in steps as long
    as the residuals are no larger than that (the background's rotation is hardly told from the vortex' in a small disc).
    neighbour_part: neighbours weaker than this part of a vortex belong to its background.
    strain_prior, rotation_prior: see `vortex_fit.fit_vortices`.
    region_prior: relative standard deviation of a core radius as told by its region, where half of the disc is hidden; it
    weighs as the hidden part over the seen one, nothing where all is seen.
    correlation_length: distance over which the vectors' errors are correlated (the interrogation window's
    width for PIV); None = estimated from the residuals.
    scheme: of the gradients, `least-squares` or `fourth-order`.
    weights: of the vectors in the fit, by their `uncertainty` (u_std, v_std, where given) or `equal`; equal where
    two planes are compared of which only one has uncertainties.
    """

    stencil_radius: float | None = None
    gamma2: float = 2 / np.pi
    min_points: int = 5
    max_elongation: float = 4.0
    min_circulation: float | None = None
    min_part: float = 0.1
    significance: float = 2.0
    fit_radius: float = 2.0
    min_explained: float = 0.3
    neighbour_part: float = 0.3
    strain_prior: float = 0.3
    rotation_prior: float = 0.03
    region_prior: float = 0.2
    correlation_length: float | None = None
    scheme: str = "least-squares"
    weights: str = "uncertainty"

    def __post_init__(self) -> None:
        if self.weights not in ("uncertainty", "equal"):
            raise ValueError(f"weights = {self.weights!r}: give 'uncertainty' or 'equal'")
        for name in ("strain_prior", "rotation_prior", "region_prior"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} = {getattr(self, name):g}: give a positive number, 1e9 to switch it off"
                )
