"""A study through Snakemake on this machine: equal stages once, a refusal as a result, kills."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from piv.files.record import read_record
from tests.conftest import CASES, ROOT, TINY

SNAKEMAKE = ROOT / ".venv-study" / "bin" / "snakemake"
pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(not SNAKEMAKE.exists(), reason="make study installs Snakemake"),
]
SHORT = """[motion]
strokes = [{ pressure_kpa = 6.0, start = 0.002, duration = 0.2 }]
end_time = 0.02
"""
COSTS = "cpu|wall|time_s|memory|made|date|_mb|seconds"  # columns that a kill changes
TABLE = """\
run, scene, level, until, ranks, may_fail, numerics.max_courant, fluid.kinematic_viscosity
itself, ., tiny, solve, , , ,
thick, , tiny, solve, , , , 1e-5
edge, , tiny, solve, , yes, 0.01,
"""


def copy_of_project(folder: Path) -> Path:
    """With one small scene and a study of it; returns the folder of the study's runs."""
    for part in ("pipeline", "piv", "postprocess", "softfinger"):
        (folder / part).symlink_to(ROOT / part)
    for part in ("_base", "single_finger"):
        (folder / "cases").mkdir(exist_ok=True)
        (folder / "cases" / part).symlink_to(CASES / part)
    scene = folder / "cases" / "small"
    (scene / "studies").mkdir(parents=True)
    text = TINY.format(parent="../single_finger", kind="2d", more=SHORT, numerics="")
    (scene / "scene.toml").write_text(text)
    (scene / "kinematics").symlink_to("../single_finger/kinematics")
    (scene / "studies" / "trial.csv").write_text(TABLE)
    return scene / "out" / "studies" / "trial"


def start(runs: Path) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "softfinger", "study", "cases/small/studies/trial.csv"]
    return subprocess.Popen(
        words, cwd=runs.parents[4], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True, env=os.environ | {"NP": "2"},
    )  # fmt: skip


def study(runs: Path) -> str:
    process = start(runs)
    text = process.communicate(timeout=600)[0]
    assert process.returncode == 0, text[-3000:]
    return text


def killed_at(runs: Path, reached: Path) -> None:
    """Start the study and end all of it, -9, where a file is there; nobody is left to clean up."""
    process = start(runs)
    deadline = time.monotonic() + 300
    while not reached.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    assert process.poll() is None, f"it ended before: {process.communicate()[0][-3000:]}"
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1)


def result(runs: Path) -> pd.DataFrame:
    return pd.read_csv(runs / "table.csv").set_index("run")


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    runs = copy_of_project(tmp_path_factory.mktemp("studied"))
    study(runs)
    return runs


def test_equal_stages_are_one_file_and_a_refusal_is_a_result(studied):
    thick, edge = read_record(studied / "thick", "solve"), read_record(studied / "edge", "outcome")
    assert (studied / "thick" / "planform.h5").samefile(studied / "itself" / "planform.h5")
    assert thick["digest"] != read_record(studied / "itself", "solve")["digest"]
    assert edge["ended"] == "refused"
    assert "time_step of at most" in edge["reason"]


def test_a_second_start_computes_nothing_and_a_lost_file_is_made_again(studied):
    assert "localrule" not in study(studied)
    (studied / "thick" / "run" / "forces.csv").unlink()
    kept = read_record(studied / "itself", "solve")
    assert re.findall(r"(?m)^localrule (\w+):", study(studied)) == ["solve", "all"]
    assert read_record(studied / "itself", "solve") == kept


def test_a_killed_study_ends_with_the_table_of_an_undisturbed_one(studied, tmp_path):
    runs = copy_of_project(tmp_path)
    solving = Path("case") / "interval_0" / "log.pimpleFoam"
    killed_at(runs, runs / "thick" / solving)  # one run has ended, one is half made
    study(runs)
    table, undisturbed = result(runs), result(studied)
    assert list(table.index) == ["itself", "thick", "edge"]
    assert table["peak_force_N"].notna().to_dict() == {"itself": True, "thick": True, "edge": False}
    assert table.loc["edge", "ended"] == "refused"
    assert table.loc["thick", "peak_force_N"] != table.loc["itself", "peak_force_N"]
    physical = [name for name in table.columns if not re.search(COSTS, name)]
    assert {"peak_force_N", "ended"} <= set(physical)
    pd.testing.assert_frame_equal(table[physical], undisturbed[physical], check_exact=True)
