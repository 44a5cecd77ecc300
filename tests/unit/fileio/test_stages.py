"""The table of stages: what make and Snakemake read of it is what it says, and a new stage is known to both."""

import ast
import shutil
import subprocess
from dataclasses import replace
from importlib import import_module

import pytest

from fileio.stages import BY_NAME, FEA, STAGES, Stage, make_variables, until
from tests.conftest import ROOT
from tests.inner_make import inner_environment

# A stage between the sheet and the comparison, as one would add it to the table.
NEW = Stage(
    "pressure",
    "pipeline.pressure",
    "pressure on the finger",
    ("sheet",),
    ("pressure.csv",),
    {"sheet": True},
)


def with_new():
    after = next(i for i, stage in enumerate(STAGES) if stage.name == "compare")
    compare = replace(STAGES[after], inputs=(*STAGES[after].inputs, NEW.name))
    return (*STAGES[:after], NEW, compare, *STAGES[after + 1 :])


def test_what_make_reads_is_the_table():
    written = (ROOT / "fileio" / "stages.mk").read_text(encoding="utf-8")
    assert written == make_variables(), "run: python -m fileio.stages > fileio/stages.mk"


def test_stages_read_what_stages_before_them_write():
    files = [file for stage in (FEA, *STAGES) for file in stage.outputs]
    assert len(set(files)) == len(files)
    for number, stage in enumerate(STAGES):
        assert set(stage.inputs) <= {earlier.name for earlier in STAGES[:number]}, stage.name


@pytest.mark.parametrize("stage", BY_NAME.values(), ids=lambda stage: stage.name)
def test_every_stage_is_a_module_that_runs(stage):
    name = f"piv.commands.{stage.piv}" if stage.piv else stage.module
    assert callable(import_module(name).run)


def test_stages_up_to_a_target():
    assert [stage.name for stage in until("vortices_cfd")] == [
        "kinematics", "mesh", "case", "run", "sheet", "vortices_cfd",
    ]  # fmt: skip
    assert [stage.name for stage in until("vortices")] == [stage.name for stage in STAGES[:9]]
    assert until("report") == list(STAGES)
    assert until("fea") == []


def test_the_table_needs_nothing_but_the_standard_library():
    """The Snakefile reads it in an environment of its own."""
    tree = ast.parse((ROOT / "fileio" / "stages.py").read_text(encoding="utf-8"))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules == {"__future__", "dataclasses", "typing"}


@pytest.fixture
def project(tmp_path):
    """The makefiles, a scene, and the table with a new stage."""
    for name in ("fileio", "pipeline", "postprocess/lab", "cases/small"):
        (tmp_path / name).mkdir(parents=True)
    for name in (
        "Makefile",
        "pipeline/names.sh",
        "pipeline/setup.sh",
        "pipeline/command.sh",
        "postprocess/lab/compare.mk",
        "requirements.lock",
    ):
        shutil.copy2(ROOT / name, tmp_path / name)
    (tmp_path / "fileio" / "stages.mk").write_text(make_variables(with_new()), encoding="utf-8")
    (tmp_path / "cases" / "small" / "scene.toml").touch()
    (tmp_path / "Makefile").touch()  # stands for what is set up: newer than what that is made of
    return tmp_path


def test_a_new_stage_is_known_to_make_and_its_help(project):
    """Adding a stage touches the table, its package and its settings: no rule is written by hand."""

    def make(*words):
        command = ["make", "-n", "READY=Makefile", "LEVEL=smoke", *words]
        return subprocess.run(
            command,
            cwd=project,
            capture_output=True,
            text=True,
            check=True,
            env=inner_environment(),
        ).stdout

    lines = make("small").splitlines()
    order = [
        name
        for line in lines
        for name in BY_NAME | {"pressure": NEW}
        if f"-m pipeline {name} " in line
    ]
    assert "pressure" in order
    assert order.index("sheet") < order.index("pressure") < order.index("compare")
    assert "piv" not in " ".join(make("small.pressure").split("-m pipeline ")[1:])
    assert "pressure on the finger" in make("help")
