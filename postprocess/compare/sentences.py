"""Sentences of the paper on a figure, [[sentence]] of findings.toml, and their findings.

[[sentence]]
quote = "…"                  # as it is printed
where = "Fig. 11, Results"   # in the paper
reading = "…"                # optional: its meaning, where it has several readings
findings = ["pair-equal"]    # ids of the findings that judge it; if it cannot be tested: none, and
why = "…"                    # why not, or what of it the findings leave open
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fileio.toml_text import read_toml
from postprocess.compare.findings import Finding


@dataclass(frozen=True)
class Sentence:
    """One sentence of the paper; the fields are those of the file, see the module's text."""

    quote: str
    where: str
    reading: str = ""
    findings: tuple[str, ...] = ()
    why: str = ""


def read_sentences(path: Path, findings: tuple[Finding, ...]) -> tuple[Sentence, ...]:
    """The sentences of a file, checked against its findings; ValueError."""
    known, out = {finding.id for finding in findings}, []
    for entry in read_toml(path).get("sentence", []):
        where = f"{path}: sentence {str(entry.get('quote', '(without quote)'))[:40]!r}"
        if unknown := sorted(set(entry) - set(Sentence.__dataclass_fields__)):
            raise ValueError(f"{where} has the unknown key {unknown[0]!r}; remove or rename it")
        if missing := [key for key in ("quote", "where") if not entry.get(key)]:
            raise ValueError(f"{where} lacks the key {missing[0]!r}; add it")
        if not isinstance(named := entry.get("findings", []), list):
            raise ValueError(
                f"{where}: findings = {named!r} is no list; write findings = [{named!r}]"
            )
        sentence = Sentence(**entry | {"findings": tuple(named)})
        if absent := [name for name in sentence.findings if name not in known]:
            raise ValueError(
                f"{where}: findings = {absent[0]!r} is no finding of this file; give the id of one"
            )
        if not sentence.findings and not sentence.why:
            raise ValueError(f"{where} has neither findings nor why; say why it cannot be tested")
        out.append(sentence)
    return tuple(out)


def judge_sentence(sentence: Sentence, checks: list[dict[str, Any]]) -> dict[str, Any]:
    """A sentence with its `verdict`: met, not met, undecided or not testable."""
    met = [check["met"] for check in checks if check["id"] in sentence.findings]
    verdict = (
        "not met"
        if False in met
        else "undecided"
        if None in met
        else "met"
        if met
        else "not testable"
    )
    return asdict(sentence) | {"verdict": verdict}
