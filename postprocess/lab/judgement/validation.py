"""Validation after ASME V&V 20: comparison error E = S − D against its uncertainty u_val.

The flow's S is the nominal run plus what the finer runs change, at the recording's own motion.
E estimates the model's error within ± k u_val, u_val² = Σ u² over numerics, inputs and data.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

LEVEL = 0.95
KINDS = {"numerical": "u_num", "input": "u_input", "data": "u_D"}
AGREES, ERROR, UNCERTAIN = "agrees", "model error", "too uncertain"
POSTERIOR = "posterior of the registration"
DIFFERS = "differs within the inputs"  # beyond the data's uncertainty, within the inputs'


@dataclass(frozen=True)
class Source:
    """One source of uncertainty: `kind` of `KINDS`, `std` (component,), `how` it was found."""

    name: str
    kind: str
    std: np.ndarray
    how: str


@dataclass(frozen=True)
class ValidatedQuantity:
    """One quantity: simulation (seen by PIV) and data, (component,), in SI.

    `scale`: its size, for percentages. `explained`: part of S − D due to the difference of the
    motions, which is not in E; None where it is not known. `finer`: part of S that the finer runs
    have added. `window` (s): of the instants. `instant`: standard uncertainty of each side there.
    """

    name: str
    label: str
    unit: str
    simulation: np.ndarray
    data: np.ndarray
    scale: float
    sources: list[Source] = field(default_factory=list)
    explained: np.ndarray | None = None
    finer: np.ndarray | None = None
    window: tuple[float, float] | None = None
    instant: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def error(self) -> np.ndarray:
        """E, (component,): S − D at the recording's motion, where its effect is known."""
        difference = self.simulation - self.data
        return difference if self.explained is None else difference - self.explained

    @property
    def u_val(self) -> np.ndarray:
        """Standard validation uncertainty, (component,)."""
        return np.sqrt(sum(s.std**2 for s in self.sources))

    def u_kind(self, kind: str) -> np.ndarray:
        """Standard uncertainty of one kind of source, (component,)."""
        parts = [s.std**2 for s in self.sources if s.kind == kind]
        return np.sqrt(sum(parts)) if parts else np.zeros_like(self.error)

    @property
    def dominant(self) -> Source:
        """The source with the largest part of u_val²."""
        return max(self.sources, key=lambda s: float(np.sum(s.std**2)))

    def verdict(self, too_uncertain: float, level: float = LEVEL) -> str:
        """`ERROR`, `AGREES`, or `UNCERTAIN` where an error of `too_uncertain` could hide."""
        if self.significance() > coverage_factor(self.error.size, level):
            return ERROR
        return AGREES if self.detectable(level) <= too_uncertain * self.scale else UNCERTAIN

    def detectable(self, level: float = LEVEL) -> float:
        """The smallest error of the worst component that the verdict finds with 95 %."""
        return float(detectable_factor(self.error.size, level) * np.max(self.u_val))

    def differs(self, level: float = LEVEL) -> bool:
        """Whether E is beyond the data's uncertainty, whatever the inputs may be."""
        of_data = np.maximum(self.u_kind("data"), 1e-30)
        size = float(np.sqrt(np.sum((self.error / of_data) ** 2)))
        return size > coverage_factor(self.error.size, level)

    def significance(self) -> float:
        """|E|/u_val, over all components."""
        return float(np.sqrt(np.sum((self.error / self.u_val) ** 2)))


def coverage_factor(components: int, level: float = LEVEL) -> float:
    """k of the confidence `level` for a Gaussian of so many components (1: 1.96)."""
    return float(np.sqrt(chi2.ppf(level, components)))


def detectable_factor(components: int, level: float = LEVEL) -> float:
    """Model error over u_val that is found with probability `LEVEL` (1 component: 3.60)."""
    limit = coverage_factor(components, level) ** 2
    missed = lambda d: float(ncx2.cdf(limit, components, d**2)) - (1 - LEVEL)  # noqa: E731
    return float(brentq(missed, 1e-6, np.sqrt(limit) + 10))


def joint_level(quantities: int) -> float:
    """Level of each of so many tests at which all hold with probability `LEVEL` (Šidák)."""
    return LEVEL ** (1 / quantities)
