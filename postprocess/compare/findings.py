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
# window = "known"                            while both know the vortex, else as [0.25, 0.75]
# window = { gap = [0.02, 0.005] }            gap between tip and plane, m, as the fingers close
# window = { contact = [-0.02, 0.1] }         s from contact: 0.1 mm above the residual gap
# window = { stroke = 1, part = [0.25, 1.0] } fractions of one stroke's bend, counted from 0
# window = { stroke = 1, after = [0.1, 0.3] } s from the start of one stroke
finger = 0                          # optional, which finger (quantities of a pair take both)

[[sentence]]                        # of the paper on a figure, and the findings that judge it
quote = "…"                         # as it is printed
where = "Fig. 11, Results"          # in the paper
reading = "…"                       # optional: its meaning, where it has several readings
findings = ["pair-equal"]           # ids; if it cannot be tested: none, and
why = "…"                           # why not, or what of it the findings leave open
"""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Field, StringConstraints, ValidationError, model_validator

from pipeline.scene.section import NotNegative, Number, Section, validation_sentence
from pipeline.scene.toml_text import read_toml
from piv.files.errors import StageError
from piv.files.provenance import check_version
from postprocess.evidence.evidence import Measured
from postprocess.evidence.time_windows import Window, read_window

_Table = TypeVar("_Table", bound=Section)
_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
_Source = Literal["cfd", "piv", "piv-cfd"]  # a laboratory is compared by postprocess.lab


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class Finding(Section):
    """One checkable statement; the keys are those of the file, see the module's text."""

    id: str
    kind: Literal["paper", "agreement"]
    finding: str
    figure: str
    quantity: str
    of: Annotated[tuple[_Source, ...], Field(min_length=1), BeforeValidator(_listed)]
    comparison: Literal["<=", ">=", "in range", "equals"]
    value: Number | str | tuple[Number, Number]
    reason: _Text
    window: Annotated[Window, BeforeValidator(read_window)]
    tolerance: NotNegative = 0.0
    finger: int = 0

    @model_validator(mode="after")
    def _comparable(self) -> "Finding":
        value = self.value
        falling = isinstance(value, tuple) and value[0] > value[1]
        if isinstance(value, tuple) != (self.comparison == "in range") or falling:
            raise ValueError("comparison 'in range', and no other, needs value = [low, high]")
        if isinstance(value, str) and self.comparison != "equals":
            raise ValueError(f"the word {value!r} can only be compared by 'equals'")
        return self


class Sentence(Section):
    """One sentence of the paper; the keys are those of the file, see the module's text."""

    quote: _Text
    where: _Text
    reading: str = ""
    findings: tuple[str, ...] = ()
    why: str = ""

    @model_validator(mode="after")
    def _answered(self) -> "Sentence":
        if not self.findings and not self.why:
            raise ValueError("it has neither findings nor why; say why it cannot be tested")
        return self


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
    """The findings of a file, checked; StageError names file, entry, key and remedy."""
    raw = read_toml(path)
    check_version(raw, path, "findings", 1, "state both at its top")
    findings = _tables(raw, "finding", Finding, path)
    if not findings:
        raise StageError(f"{path}: has no [[finding]]; a scene needs at least one to be judged by")
    names = [finding.id for finding in findings]
    for finding in findings:
        if finding.quantity not in quantities:
            raise StageError(
                f"{path}: finding {finding.id!r}: quantity = {finding.quantity!r} is not one of"
                f" {', '.join(sorted(quantities))}"
            )
        if names.count(finding.id) > 1:
            raise StageError(f"{path}: id = {finding.id!r} occurs twice; give each its own id")
    return findings


def read_sentences(path: Path, findings: tuple[Finding, ...]) -> tuple[Sentence, ...]:
    """The sentences of a file, checked against its findings; StageError."""
    known = {finding.id for finding in findings}
    sentences = _tables(read_toml(path), "sentence", Sentence, path)
    for sentence in sentences:
        if absent := [name for name in sentence.findings if name not in known]:
            raise StageError(
                f"{path}: sentence {sentence.quote[:40]!r}: findings = {absent[0]!r} is no finding"
                " of this file; give the id of one"
            )
    return sentences


def _tables(raw: dict[str, Any], name: str, model: type[_Table], path: Path) -> tuple[_Table, ...]:
    """The tables of one name; StageError names an entry by its first key."""
    tables = []
    for number, entry in enumerate(raw.get(name, [])):
        try:
            tables.append(model(**entry))
        except ValidationError as error:
            first = str(next(iter(entry.values()), number))[:40]
            sentence = validation_sentence(error, model)
            raise StageError(f"{path}: {name} {first!r}: {sentence}") from None
    return tuple(tables)


def judge_sentence(sentence: Sentence, checks: list[dict[str, Any]]) -> dict[str, Any]:
    """A sentence with its `verdict`: met, not met, undecided or not testable."""
    met = [check["met"] for check in checks if check["id"] in sentence.findings]
    worst = next((m for m in (False, None, True) if m in met), "")
    verdicts = {False: "not met", None: "undecided", True: "met", "": "not testable"}
    return sentence.model_dump() | {"verdict": verdicts[worst]}
