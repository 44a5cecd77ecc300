"""The findings of a scene, reference/findings.toml: schema and judgement.

format = "findings"
format_version = 1

[[finding]]
id = "tip-vortex-dorsal"            # unique, a-z and hyphens
kind = "paper"                      # "paper": something the paper saw; "agreement": PIV against CFD
finding = "…"                       # the paper's statement, in one sentence
figure = "Fig. 10(a)"               # where it says so; "" for an agreement of the project's own
quantity = "dominant_side"          # a name of postprocess.compare.quantities.QUANTITIES
of = ["cfd", "piv"]                 # sources that must show it; "piv-cfd" for a difference
comparison = "equals"               # "<=", ">=", "in range" (value = [low, high]), "equals"
value = "dorsal"                    # number (SI), [low, high] or word
tolerance = 0.0                     # SI, added on the generous side; numbers only
reason = "…"                        # why this value and tolerance
window = [0.25, 0.75]               # fractions of the change of bend angle; or one of:
# window = { gap = [0.02, 0.005] }            gap between tip and plane, m, as the fingers close
# window = { contact = [-0.02, 0.1] }         s from contact: 0.1 mm above the residual gap
# window = { stroke = 1, part = [0.25, 1.0] } fractions of one stroke's bend, counted from 0
# window = { stroke = 1, after = [0.1, 0.3] } s from the start of one stroke
finger = 0                          # optional, which finger (quantities of a pair take both)
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fileio.toml_text import read_toml
from postprocess.evidence.evidence import Measured
from postprocess.evidence.time_windows import Window, read_window

_COMPARISONS = ("<=", ">=", "in range", "equals")
_KINDS = ("paper", "agreement")
_SOURCES = ("cfd", "piv", "piv-cfd")  # a laboratory is compared by postprocess.lab
_REQUIRED = (
    "id",
    "kind",
    "finding",
    "figure",
    "quantity",
    "of",
    "comparison",
    "value",
    "reason",
    "window",
)

_Value = float | str | tuple[float, float]


@dataclass(frozen=True)
class Finding:
    """One checkable statement; the fields are those of the file, see the module's text."""

    id: str
    kind: str
    finding: str
    figure: str
    quantity: str
    of: tuple[str, ...]
    comparison: str
    value: _Value
    reason: str
    window: Window
    tolerance: float = 0.0
    finger: int = 0


def is_met(finding: Finding, measured: Measured) -> bool:
    """Whether one measured value satisfies the finding, its tolerance included."""
    if isinstance(measured, str) or isinstance(finding.value, str):
        return measured == finding.value
    if isinstance(finding.value, tuple):
        low, high = finding.value
        return low - finding.tolerance <= measured <= high + finding.tolerance
    if finding.comparison == "<=":
        return measured <= finding.value + finding.tolerance
    if finding.comparison == ">=":
        return measured >= finding.value - finding.tolerance
    return abs(measured - finding.value) <= finding.tolerance


def read_findings(path: Path, quantities: frozenset[str]) -> tuple[Finding, ...]:
    """The findings of a file, checked; ValueError names file, entry, key and remedy."""
    raw = read_toml(path)
    if raw.get("format") != "findings" or raw.get("format_version") != 1:
        raise ValueError(f'{path}: needs format = "findings" and format_version = 1 at its top')
    findings = tuple(_finding(entry, path, quantities) for entry in raw.get("finding", []))
    if not findings:
        raise ValueError(f"{path}: has no [[finding]]; a scene needs at least one to be judged by")
    names = [finding.id for finding in findings]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise ValueError(f"{path}: id = {twice!r} occurs twice; give every finding its own id")
    return findings


def _finding(entry: dict[str, Any], path: Path, quantities: frozenset[str]) -> Finding:
    where = f"{path}: finding {entry.get('id', '(without id)')!r}"
    missing = next((key for key in _REQUIRED if key not in entry), None)
    if missing:
        raise ValueError(f"{where} lacks the key {missing!r}")
    unknown = sorted(set(entry) - set(Finding.__dataclass_fields__))
    if unknown:
        raise ValueError(f"{where} has the unknown key {unknown[0]!r}; remove or rename it")
    for key, allowed in (
        ("kind", _KINDS),
        ("comparison", _COMPARISONS),
        ("quantity", sorted(quantities)),
    ):
        if entry[key] not in allowed:
            raise ValueError(f"{where}: {key} = {entry[key]!r} is not one of {', '.join(allowed)}")
    of = (entry["of"],) if isinstance(entry["of"], str) else tuple(entry["of"])
    wrong = next((source for source in of if source not in _SOURCES), None)
    if wrong or not of:
        raise ValueError(f"{where}: of = {wrong!r} is not one of {', '.join(_SOURCES)}")
    if not str(entry["reason"]).strip():
        raise ValueError(
            f"{where}: reason is empty; say why the value and its tolerance are what they are"
        )
    window = read_window(entry["window"], where)
    value = _value(entry["value"], entry["comparison"], where)
    tolerance = float(entry.get("tolerance", 0.0))
    if tolerance < 0:
        raise ValueError(f"{where}: tolerance = {tolerance} is negative")
    checked = {"of": of, "window": window, "value": value, "tolerance": tolerance}
    return Finding(**(entry | checked))


def _value(value: Any, comparison: str, where: str) -> _Value:
    if comparison == "in range":
        if not isinstance(value, list) or len(value) != 2 or not value[0] <= value[1]:
            raise ValueError(
                f"{where}: comparison 'in range' needs value = [low, high], got {value!r}"
            )
        return float(value[0]), float(value[1])
    if isinstance(value, str):
        if comparison != "equals":
            raise ValueError(f"{where}: the word {value!r} can only be compared by 'equals'")
        return value
    if isinstance(value, list):
        raise ValueError(f"{where}: value = {value!r} is a list, which only 'in range' takes")
    return float(value)
