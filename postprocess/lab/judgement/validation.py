"""Validation after ASME V&V 20: comparison error E = S − D against its uncertainty u_val.

The flow's S is the nominal run plus what the finer runs change, at the recording's own motion
(linear in what the runs of pressure and duration change). E estimates the model's error within
± k u_val, u_val² = Σ u² over numerics, inputs and data. Beyond k times the u_val without a model
error the model errs by about E; else both agree, unless a large error would not be `detectable`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

LEVEL = 0.95
DRAWS = 20_000
KINDS = {"numerical": "u_num", "input": "u_input", "data": "u_D"}
AGREES, ERROR, UNCERTAIN = "agrees", "model error", "too uncertain"
DIFFERS = "differs within the inputs"  # surely, but within the inputs' uncertainty


@dataclass(frozen=True)
class Source:
    """One source of uncertainty: `kind` of `KINDS`, `std` (component,), `how` it was found.

    `share`: of E, where the source is that share of it and so grows with a model error.
    """

    name: str
    kind: str
    std: np.ndarray
    how: str
    share: float = 0.0


@dataclass(frozen=True)
class ValidatedQuantity:
    """One quantity: simulation (seen by PIV, and direct) and data, (component,), in SI.

    `scale`: what a band is measured by. `explained`: part of S − D due to the difference of the
    motions, which is not in E; None where it is not known. `instant`: standard uncertainty of each
    side at one instant, of a mean over several. `finer`: part of S that the finer runs have added.
    """

    name: str
    label: str
    unit: str
    simulation: np.ndarray
    direct: np.ndarray
    data: np.ndarray
    scale: float
    sources: list[Source] = field(default_factory=list)
    explained: np.ndarray | None = None
    instant: dict[str, np.ndarray] = field(default_factory=dict)
    finer: np.ndarray | None = None

    @property
    def error(self) -> np.ndarray:
        """E, (component,): S − D at the recording's motion, where it is known what that does."""
        difference = self.simulation - self.data
        return difference if self.explained is None else difference - self.explained

    @property
    def measurement_part(self) -> np.ndarray:
        """Part of direct S − D that the measurement causes."""
        return self.direct - self.simulation

    @property
    def u_val(self) -> np.ndarray:
        """Standard validation uncertainty, (component,)."""
        return np.sqrt(sum(s.std**2 for s in self.sources))

    def u_with(self, model_error: float) -> np.ndarray:
        """Standard uncertainty of E, (component,), if the model errs by so much."""
        grown = (
            s.share * np.full_like(s.std, model_error) if s.share else s.std for s in self.sources
        )
        return np.sqrt(sum(part**2 for part in grown))

    def u_kind(self, kind: str) -> np.ndarray:
        """Standard uncertainty of one kind of source, (component,)."""
        parts = [s.std**2 for s in self.sources if s.kind == kind]
        return np.sqrt(sum(parts)) if parts else np.zeros_like(self.error)

    @property
    def dominant(self) -> Source:
        """The source with the largest part of u_val²."""
        return max(self.sources, key=lambda s: float(np.sum(s.std**2)))

    def verdict(self, too_uncertain: float, level: float = LEVEL) -> str:
        """`ERROR`, `AGREES`, or `UNCERTAIN` where `too_uncertain` of the scale could hide."""
        if self.significance() > coverage_factor(self.error.size, level):
            return ERROR
        return AGREES if self.detectable(level) <= too_uncertain * self.scale else UNCERTAIN

    def detectable(self, level: float = LEVEL) -> float:
        """The smallest model error δ that the verdict finds with probability `LEVEL`; inf: none.

        Of the worst component: δ = k u(0) + z u(δ), so that 5 % fall below the limit k u(0).
        """
        k = coverage_factor(self.error.size, level)
        z = detectable_factor(self.error.size, level) - k
        u = lambda delta: float(np.max(self.u_with(delta)))  # noqa: E731
        grows = z * float(np.sqrt(sum(s.share**2 for s in self.sources)))
        if grows >= 1 or not np.isfinite(u(0.0)):
            return float("inf")
        most = 2 * (k + z) * u(0.0) / (1 - grows)  # u(δ) is at most u(0) + share δ
        return float(brentq(lambda delta: delta - k * u(0.0) - z * u(delta), 0.0, most))

    def differs(self, level: float = LEVEL) -> bool:
        """Whether E is beyond the data's uncertainty, whatever the inputs may be."""
        of_data = self.u_kind("data")
        size = float(np.sqrt(np.sum((self.error / np.maximum(of_data, 1e-30)) ** 2)))
        return size > coverage_factor(self.error.size, level)

    def significance(self) -> float:
        """|E| over its standard uncertainty without a model error, over all components."""
        return float(np.sqrt(np.sum((self.error / self.u_with(0.0)) ** 2)))


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


@dataclass(frozen=True)
class FieldComparison:
    """The velocity field: E (time, 2, y, x; NaN where not common) and its uncertainty.

    `modes`: standard displacement of the field by each coherent source, {name: (kind,
    (time, 2, y, x))}; `noise`: standard uncertainty of each vector of both sides together.
    """

    error: np.ndarray
    modes: dict[str, tuple[str, np.ndarray]]
    noise: np.ndarray

    def u_val(self) -> np.ndarray:
        """Standard uncertainty of each vector's E, (time, 2, y, x)."""
        return np.sqrt(self.noise**2 + sum(np.nan_to_num(m) ** 2 for _, m in self.modes.values()))

    def significance(self) -> np.ndarray:
        """|E|/u_val of each vector, (time, y, x)."""
        return np.sqrt(np.sum((self.error / self.u_val()) ** 2, axis=1))

    def rms(self) -> float:
        """RMS of |E| over all common vectors, m/s."""
        return float(np.sqrt(np.nanmean(np.sum(self.error**2, axis=1))))

    def parts(self) -> dict[str, tuple[str, float]]:
        """RMS over the field of each source, m/s: the modes and the vectors' own."""

        def rms(part: np.ndarray) -> float:
            known = np.where(np.isfinite(self.error), part, np.nan)
            return float(np.sqrt(np.nanmean(np.sum(known**2, axis=1))))

        parts = {name: (kind, rms(mode)) for name, (kind, mode) in self.modes.items()}
        return parts | {"vectors": ("data", rms(self.noise))}

    def allowed_rms(self, level: float = LEVEL) -> float:
        """The RMS of |E| that u_val lets be exceeded with probability 1 − level, m/s."""
        return float(np.sqrt(np.quantile(self._squares, level)))

    def detectable(self, level: float = LEVEL) -> float:
        """The smallest RMS (m/s) of an error unlike all sources that is found with `LEVEL`."""
        left = self.allowed_rms(level) ** 2 - np.quantile(self._squares, 1 - LEVEL)
        return float(np.sqrt(max(left, 0.0)))

    @cached_property
    def _squares(self) -> np.ndarray:
        """Mean squares of |E| (draw,) without a model error.

        Of Σ ξ_j mode_j + noise with standard normal ξ: a coherent source moves the whole field.
        """
        ok = np.isfinite(self.error)
        flat = [np.where(ok, np.nan_to_num(m), 0.0).ravel() for _, m in self.modes.values()]
        points = max(int(np.isfinite(self.error[:, 0]).sum()), 1)
        own = float(np.nansum(np.where(ok, self.noise, np.nan) ** 2)) / points
        if not flat:
            return np.array([own])
        gram = np.array([[a @ b for b in flat] for a in flat]) / points
        xi = np.random.default_rng(0).standard_normal((DRAWS, len(flat)))
        return np.asarray(np.einsum("di,ij,dj->d", xi, gram, xi) + own)
