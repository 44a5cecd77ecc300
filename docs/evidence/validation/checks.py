"""Checks of a flow (quantity, reference, result, tolerance, reason) and its results file."""

import json
import re
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from piv.files.atomic import write_text
from piv.files.provenance import versions
from softfinger.study.table import commit

FORMAT, FORMAT_VERSION = "checks", 1
NUMBERS = r"\[[-+\d.eE,\s]+\]"  # lists of numbers are written in one line
How = Literal["relative", "absolute", "at most", "at least"]


@dataclass(frozen=True)
class Check:
    """One row of the ledger.

    `how`: `relative`: |result − reference| ≤ tolerance · |reference|; `absolute`: |result −
    reference| ≤ tolerance; `at most`, `at least`: result ≤ or ≥ tolerance (no reference).
    """

    id: str
    quantity: str
    result: float
    tolerance: float
    how: How
    why: str  # why this tolerance
    reference: float | None = None
    source: str = ""  # of the reference
    unit: str = "1"

    def __post_init__(self) -> None:
        if (self.reference is None) != (self.how in ("at most", "at least")):
            raise ValueError(f"check {self.id}: {self.how!r} and {self.reference} do not fit")

    @property
    def deviation(self) -> float:
        """Distance from the reference, or the result itself where there is none."""
        if self.reference is None:
            return self.result
        gap = self.result - self.reference
        return gap / abs(self.reference) if self.how == "relative" else gap

    @property
    def met(self) -> bool:
        """Whether the result lies within its tolerance; NaN never does."""
        if self.how == "at least":
            return bool(self.result >= self.tolerance)
        if self.how == "at most":
            return bool(self.result <= self.tolerance)
        return bool(abs(self.deviation) <= self.tolerance)


@dataclass(frozen=True)
class Result:
    """Checks of one flow, curves of its figure, and origin of the numbers."""

    name: str
    title: str
    checks: tuple[Check, ...]
    curves: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)


def write_result(result: Result, path: Path) -> None:
    """Write a results file (docs/formats.md, Checks) whole or not at all; seven digits."""
    content = {"format": FORMAT, "format_version": FORMAT_VERSION} | vars(result)
    content |= {
        "checks": [asdict(c) | {"deviation": c.deviation, "met": c.met} for c in result.checks],
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit(),
        "versions": versions() | result.provenance.get("versions", {}),
        "provenance": {k: v for k, v in result.provenance.items() if k != "versions"},
    }
    text = json.dumps(_rounded(content), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, re.sub(NUMBERS, lambda match: " ".join(match.group().split()), text) + "\n")


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.7g}")
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    return value
