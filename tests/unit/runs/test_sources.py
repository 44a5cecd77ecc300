"""Results know the code that they were made by."""

import shutil
from functools import partial
from pathlib import Path

import pytest

from docs.evidence.sources import present, recorded
from pipeline.runs import run as runs
from pipeline.runs.run import Run
from pipeline.runs.sources import sources, sources_digest
from pipeline.runs.stages import BY_NAME, COUPLED
from piv.files.record import write_record
from tests.conftest import ROOT, write_scene

MEASURES = "postprocess/compare/quantities.py"
FORMULA = 'lambda p: float(_dominant(p)["tip_distance"].mean())'
DOUBLED = FORMULA.replace("float(", "2 * float(")


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the project's sources, that may be changed."""
    for package in ("piv", "pipeline", "postprocess"):
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / "copy" / package, ignore=skip)
    return tmp_path / "copy"


def change(root: Path, file: str, old: str, new: str) -> None:
    text = (root / file).read_text(encoding="utf-8")
    assert old in text
    (root / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    sources_digest.cache_clear()


def stale(root: Path) -> set[str]:
    """The stages whose sources in `root` are not those of the project."""
    modules = {name: stage.module for name, stage in BY_NAME.items()}
    return {n for n, one in modules.items() if sources_digest(one, root) != sources_digest(one)}


def test_comments_docstrings_and_formatting_do_not_count(copy: Path) -> None:
    change(copy, MEASURES, '"""', '"""Other words. ')
    change(copy, MEASURES, FORMULA, FORMULA.replace("float(", "(  # of all\n        float)("))
    assert stale(copy) == set()


@pytest.mark.parametrize(
    "file, old, new, stages",
    [
        ("postprocess/report/templates/head.html", "<html", "<html id='a'", {"report"}),
        ("postprocess/compare/agreement.toml", "0.", "1.", {"compare"}),
        ("pipeline/structure/energy.py", "\ndef ", "\nNEW = 1\n\n\ndef ", {"loads"}),
        ("piv/vortices/criteria.py", "\ndef ", "\nNEW = 1\n\n\ndef ",
         {"vortices_cfd", "vortices_piv"}),
    ],
)  # fmt: skip
def test_a_change_of_code_counts_for_the_stages_that_import_it(
    copy: Path, file: str, old: str, new: str, stages: set[str]
) -> None:
    change(copy, file, old, new)
    assert {name for name in stale(copy) if BY_NAME[name].by_sources} >= stages


def test_a_doubled_formula_makes_the_comparison_stale(
    copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its result passed for fresh: a stage knew its code by a version alone."""
    run = Run(write_scene(tmp_path / "scene"))
    for stage in ("compare", "vortices_cfd"):
        about = {"digest": run.digest(stage), "made_from": run.made_from(stage)}
        write_record(run.out, stage, about, [])
    change(copy, MEASURES, FORMULA, DOUBLED)
    monkeypatch.setattr(runs, "sources_digest", partial(sources_digest, root=copy))
    later = Run(run.scene)
    assert later.why_stale("compare") == "its code changed"
    assert later.why_stale("vortices_cfd") is None


def test_stages_never_import_each_other() -> None:
    """Files are the interface, so that a change of one stage makes no other stale."""
    modules = {stage.module for stage in (*BY_NAME.values(), *COUPLED.values())}
    files = {module: ROOT / f"{module.replace('.', '/')}.py" for module in modules}
    for module in modules:
        assert {*files.values()} & {*sources(module)} == {files[module]}, module


def test_where_results_outlive_a_change_of_code_someone_has_looked() -> None:
    code, known = present(), recorded()
    names = " ".join(name for name in code if code[name] != known.get(name))
    assert not names, (
        f"the code of {names}, or code that it imports, changed or is new. Raise versions in"
        " pipeline/runs/stages.py where results differ, then run python -m docs.evidence.sources"
        f" {names}; a new stage that is cheap gets by_sources=True there instead"
    )
    assert known.keys() == code.keys()
