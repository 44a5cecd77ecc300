"""Validation after ASME V&V 20: comparison error E = S − D, its uncertainty u_val, the verdict.

The flow's S is the nominal run plus what the recording's own motion changes.
E estimates the model's error within ± k u_val, u_val² = Σ u² over numerics, inputs and data.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import chndtrinc
from scipy.stats import chi2

LEVEL = 0.95
KINDS = {"numerical": "u_num", "input": "u_input", "data": "u_D"}
AGREES, ERROR, UNCERTAIN = "agrees", "model error", "undecided"
DIFFERS = "differs within the inputs"  # beyond the data's uncertainty, within the inputs'
MOTION = ("final_bend", "duration")  # what the silhouette shows
TOO_UNCERTAIN = 0.3  # of a quantity: where an error of this size could hide, nothing is said
SHARED = ("PIV",)  # sources of the data that repeats have in common
POSTERIOR, LEVEL_ERROR = "posterior of the registration", "the level's own error"


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

    `scale`: its size, for percentages. `moved`: what the recording's own motion has added to S;
    None where not known. `window` (s): of the instants. `instant`: standard uncertainty of each
    side there.
    """

    name: str
    label: str
    unit: str
    simulation: np.ndarray
    data: np.ndarray
    scale: float
    sources: list[Source] = field(default_factory=list)
    moved: np.ndarray | None = None
    window: tuple[float, float] | None = None
    instant: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def error(self) -> np.ndarray:
        """E = S − D, (component,)."""
        return self.simulation - self.data

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

    def detectable(self, level: float = LEVEL) -> float:
        """The smallest error of the worst component that the verdict finds with 95 %."""
        return float(detectable_factor(self.error.size, level) * np.max(self.u_val))

    def significance(self, u: np.ndarray | None = None) -> float:
        """|E|/u_val, or of E over another uncertainty `u`, over all components."""
        return float(np.linalg.norm(self.error / np.maximum(self.u_val if u is None else u, 1e-30)))

    def verdict(self, level: float = LEVEL) -> str:
        """`ERROR`, `AGREES`, or `UNCERTAIN` where an error of `TOO_UNCERTAIN` could hide.

        A motion that differs by more than the data leave open never agrees: `DIFFERS`.
        """
        limit = coverage_factor(self.error.size, level)
        if self.significance() > limit:
            return ERROR
        if self.name in MOTION and self.significance(self.u_kind("data")) > limit:
            return DIFFERS
        return AGREES if self.detectable(level) <= TOO_UNCERTAIN * self.scale else UNCERTAIN


def coverage_factor(components: int, level: float = LEVEL) -> float:
    """k of the confidence `level` for a Gaussian of so many components (1: 1.96)."""
    return float(np.sqrt(chi2.ppf(level, components)))


def detectable_factor(components: int, level: float = LEVEL) -> float:
    """Model error over u_val that is found with probability `LEVEL` (1 component: 3.60)."""
    limit = coverage_factor(components, level) ** 2
    return float(np.sqrt(chndtrinc(limit, components, 1 - LEVEL)))


def joint_level(quantities: int) -> float:
    """Level of each of so many tests at which all hold with probability `LEVEL` (Šidák)."""
    return LEVEL ** (1 / quantities)


def repeated(repeats: list[ValidatedQuantity]) -> ValidatedQuantity:
    """One quantity of n repeats: means over them.

    What is a recording's own counts by 1/√n, and so does what E scatters from repeat to repeat
    beyond it; what all share counts whole.
    """
    first, n = repeats[0], len(repeats)
    if n == 1:
        return first
    names = list(dict.fromkeys(s.name for q in repeats for s in q.sources))
    sources, own = [], np.zeros_like(first.error)
    for name in names:
        found = [s for q in repeats for s in q.sources if s.name == name]
        square = np.sum([s.std**2 for s in found], axis=0) / n
        if found[0].kind == "data" and name not in SHARED:
            own = own + square
            square = square / n
        sources.append(replace(found[0], std=np.sqrt(square)))
    seen = np.var([q.error for q in repeats], axis=0, ddof=1)
    excess = np.sqrt(np.maximum(seen - own, 0.0) / n)
    sources.append(Source("repeats", "data", excess, f"of E from repeat to repeat, n = {n}"))
    both = np.mean([(q.simulation, q.data) for q in repeats], axis=0)
    return replace(first, simulation=both[0], data=both[1], sources=sources)


def judged(q: ValidatedQuantity, level: float = LEVEL) -> dict[str, Any]:
    """A quantity with its verdict, as comparison.json has it."""
    return {
        **asdict(q),
        "error": q.error,
        "u_val": q.u_val,
        "k": coverage_factor(q.error.size, level),
        **{symbol: q.u_kind(kind) for kind, symbol in KINDS.items()},
        "significance": q.significance(),
        "verdict": q.verdict(level),
        "detectable": q.detectable(level),
        "dominant": q.dominant.name,
    }


def verdicts(rows: list[dict[str, Any]]) -> dict[str, str | None]:
    """The verdict on the whole, on the motion and on the flow; None where not tested.

    A flow agrees only where its circulation is decided.
    """
    motion = [q["verdict"] for q in rows if q["name"] in MOTION]
    words = {q["name"]: q["verdict"] for q in rows if q["name"] not in MOTION}
    flow = ERROR if ERROR in words.values() else words.get("circulation")
    return {"verdict": _worst([*motion, flow]), "motion": _worst(motion), "flow": flow}


def _worst(words: list[str | None]) -> str | None:
    return next((word for word in (ERROR, DIFFERS, UNCERTAIN, AGREES) if word in words), None)
