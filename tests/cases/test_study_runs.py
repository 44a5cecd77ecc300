"""A study through Snakemake on this machine: equal stages once, a refusal as a result, another scene's own run, a kill."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pandas as pd
import pytest

from tests.conftest import ROOT, TINY

SNAKEMAKE = ROOT / ".venv-study" / "bin" / "snakemake"
pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(shutil.which("pimpleFoam") is None, reason="OpenFOAM is not installed"),
    pytest.mark.skipif(
        not SNAKEMAKE.exists(), reason="Snakemake is not installed; make study installs it"
    ),
]
SHORT = (
    "[motion]\nstrokes = [{ pressure_kpa = 6.0, start = 0.002, duration = 0.2 }]\nend_time = 0.02\n"
)
COSTS = "cpu|wall|time_s|memory|made|date|_mb|seconds"  # columns of what a run took, which a kill changes
TABLE = """run, scene, level, until, ranks, may_fail, numerics.max_courant, fluid.kinematic_viscosity
itself, ., tiny, run, , , ,
thick, , tiny, run, , , , 1e-5
edge, , tiny, run, , yes, 0.01,
"""


def copy_of_project(folder: Path) -> Path:
    """With one small scene and a study of it."""
    for part in ("fileio", "pipeline", "piv", "postprocess"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    for part in ("_base", "single_finger"):
        shutil.copytree(
            ROOT / "cases" / part, folder / "cases" / part, ignore=shutil.ignore_patterns("out")
        )
    (folder / ".venv").symlink_to(ROOT / ".venv")
    scene = folder / "cases" / "small"
    (scene / "studies").mkdir(parents=True)
    (scene / "scene.toml").write_text(
        TINY.format(parent="../single_finger", kind="2d", more=SHORT, numerics="")
    )
    (scene / "kinematics").symlink_to("../single_finger/kinematics")
    (scene / "studies" / "trial.csv").write_text(TABLE)
    return folder


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """A project whose study has run to its end, undisturbed; only to be looked at."""
    folder = copy_of_project(tmp_path_factory.mktemp("studied"))
    study(folder)
    return folder


@pytest.fixture
def project(studied, tmp_path):
    """A copy of it for one test, files as old as they are."""
    return shutil.copytree(studied, tmp_path / "project", symlinks=True)


def result(project: Path) -> pd.DataFrame:
    """The study's table."""
    return pd.read_csv(
        project / "cases" / "small" / "out" / "studies" / "trial" / "table.csv"
    ).set_index("run")


def snakemake(project: Path, *more: str) -> subprocess.Popen[str]:
    command = [
        SNAKEMAKE,
        "-s",
        "pipeline/study/Snakefile",
        "-j2",
        *more,
        "--config",
        "study=cases/small/studies/trial.csv",
    ]
    return subprocess.Popen(
        command,
        cwd=project,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def study(project: Path) -> None:
    """Run the study to its end."""
    process = snakemake(project)
    said = process.communicate(timeout=600)[0]
    assert process.returncode == 0, said[-3000:]


def planned_jobs(project: Path) -> dict[str, int]:
    """Jobs by rule that Snakemake would run now."""
    process = snakemake(project, "-n", "-q", "host")
    said = process.communicate(timeout=120)[0]
    assert process.returncode == 0, said[-3000:]
    assert ("Nothing to be done" in said) != ("Job stats" in said)
    return {rule: int(count) for rule, count in re.findall(r"(?m)^(\w+) +(\d+)$", said)}


def killed_at(project: Path, reached: Path) -> None:
    """Start the study and end all of it, -9, where a file is there; nobody is left to clean up."""
    process = snakemake(project)
    deadline = time.monotonic() + 300
    while not reached.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    assert process.poll() is None, (
        f"the study ended before it was killed: {process.communicate()[0][-3000:]}"
    )
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1)


def test_a_study_killed_three_times_ends_with_the_table_of_an_undisturbed_one(studied, tmp_path):
    project = copy_of_project(tmp_path)
    out = project / "cases" / "small" / "out"
    thick = out / "studies" / "trial" / "thick" / "out" / "tiny"
    solving = Path("case") / "interval_0" / "log.pimpleFoam"
    for reached in (out / "tiny" / "planform.h5", out / "tiny" / solving, thick / solving):
        killed_at(project, reached)
    study(project)
    table, undisturbed = result(project), result(studied)
    assert list(table.index) == ["itself", "thick", "edge"]
    assert table["peak_force_N"].notna().to_dict() == {"itself": True, "thick": True, "edge": False}
    assert table.loc["edge", "ended"] == "refused"
    assert table.loc["thick", "peak_force_N"] != table.loc["itself", "peak_force_N"]
    physical = [name for name in table.columns if not re.search(COSTS, name)]
    assert {"peak_force_N", "ended"} <= set(physical)
    pd.testing.assert_frame_equal(table[physical], undisturbed[physical], check_exact=True)


def test_the_runs_lie_where_the_table_says(studied):
    """What changes nothing is the scene's own run, as make would have made it; what is equal is taken over."""
    scene = studied / "cases" / "small"
    own, thick = (
        scene / "out" / "tiny",
        scene / "out" / "studies" / "trial" / "thick" / "out" / "tiny",
    )
    assert (own / "run" / "run.json").exists()
    # a mesh made anew would have a date of its own in its attributes and costs
    assert (thick / "planform.h5").read_bytes() == (own / "planform.h5").read_bytes()
    assert (thick / "costs" / "mesh.json").read_bytes() == (
        own / "costs" / "mesh.json"
    ).read_bytes()
    assert (thick / "run" / "run.json").read_bytes() != (own / "run" / "run.json").read_bytes()
    edge = scene / "out" / "studies" / "trial" / "edge" / "out" / "tiny"
    outcome = json.loads((edge / "outcome.json").read_text())
    assert outcome["ended"] == "refused"
    assert "time_step of at most" in outcome["reason"]


def test_what_is_lost_on_the_way_to_a_result_is_made_again(project):
    """Else the result would not pass for made (postprocess.studies.state), and nothing would make it."""
    out = project / "cases" / "small" / "out" / "studies" / "trial" / "thick" / "out" / "tiny"
    (out / "planform.h5").unlink()
    assert planned_jobs(project).get("mesh") == 1


def test_what_is_taken_over_again_leaves_its_owner_alone(project):
    """Snakemake dates what it makes: the owner's own files must not seem new, or all that follows them is made again."""
    scene = project / "cases" / "small"
    thick = scene / "out" / "studies" / "trial" / "thick" / "out" / "tiny"
    made = [
        scene / "out" / "tiny" / name
        for name in ("kinematics.h5", "planform.h5", "sweep.h5", "run/run.json")
    ]
    own = {path: path.stat().st_mtime_ns for path in made}
    (thick / "kinematics.h5").unlink()
    study(project)
    assert (thick / "kinematics.h5").exists()
    assert {path: path.stat().st_mtime_ns for path in own} == own
    assert planned_jobs(project) == {}


def test_nothing_is_run_again_until_a_number_changes(project):
    assert planned_jobs(project) == {}
    (project / "pipeline" / "case.py").touch()
    (project / "pipeline" / "study" / "Snakefile").write_text(
        (project / "pipeline" / "study" / "Snakefile")
        .read_text()
        .replace("rule sheet:", "# a remark\nrule sheet:")
    )
    assert planned_jobs(project) == {}
    table = project / "cases" / "small" / "studies" / "trial.csv"
    table.write_text(TABLE.replace("1e-5", "2e-5"))
    assert planned_jobs(project) == {"all": 1, "case": 1, "run": 1, "table": 1, "total": 4}
