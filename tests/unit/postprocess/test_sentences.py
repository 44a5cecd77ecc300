"""Sentences of the paper: what answers each, and what is refused."""

from pathlib import Path

import pytest

from pipeline.scene.scene import load_scene
from postprocess.compare.findings import (
    Sentence,
    judge_sentence,
    read_findings,
    read_sentences,
)
from postprocess.compare.quantities import QUANTITIES
from postprocess.report.assumptions import statements
from tests.conftest import ROOT

PINCH = Path("cases/pinch/reference/findings.toml")
FINDINGS = read_findings(PINCH, frozenset(QUANTITIES))


@pytest.mark.parametrize(
    "met, verdict",
    [
        ([True, True], "met"),
        ([True, False, None], "not met"),
        ([True, None], "undecided"),
        ([], "not testable"),
    ],
)
def test_a_sentence_is_met_where_all_its_findings_are(met, verdict):
    names = tuple("abc"[: len(met)])
    checks = [{"id": name, "met": value} for name, value in zip(names, met, strict=True)]
    other = {"id": "other", "met": False}
    judged = judge_sentence(
        Sentence(quote="q", where="w", findings=names, why="why"), [*checks, other]
    )
    assert judged["verdict"] == verdict


def test_every_finding_of_the_paper_answers_a_sentence():
    sentences = read_sentences(PINCH, FINDINGS)
    answered = {name for sentence in sentences for name in sentence.findings}
    assert {finding.id for finding in FINDINGS if finding.kind == "paper"} <= answered


@pytest.mark.parametrize(
    "entry, told",
    [
        ('quote = "q"', "where: this key is missing"),
        ('quote = "q"\nwhere = "w"', "neither findings nor why"),
        ('quote = "q"\nwhere = "w"\nfindings = ["none"]', "no finding of this file"),
        ('quote = "q"\nwhere = "w"\nfindings = "a"', "findings: give a list"),
        ('quote = "q"\nwhere = "w"\nwhy = "y"\nnote = "n"', "note: this key is not known"),
    ],
)
def test_a_sentence_that_says_too_little_is_refused(tmp_path, entry, told):
    path = tmp_path / "findings.toml"
    path.write_text(f"[[sentence]]\n{entry}\n")
    with pytest.raises(ValueError, match=told):
        read_sentences(path, FINDINGS)


def test_the_page_lists_what_a_run_reads_of_other_folders():
    scene = load_scene(ROOT / "cases" / "single_deflate", "smoke")
    files = dict(statements(scene, 0.5, 0.2))["Files"]
    assert "../single_finger/scene.toml, " in files
    assert files.endswith("../single_finger/kinematics/states.h5.")
