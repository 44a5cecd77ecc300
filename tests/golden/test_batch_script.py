"""The batch script of the solver, word for word: what an administrator reads."""

from pathlib import Path

from pipeline.batch import Request, scripts, slurm_time
from tests.conftest import write_scene

GOLDEN = Path(__file__).with_name("run.sbatch")


def test_run_script(tmp_path):
    scene = write_scene(tmp_path / "pinch")
    request = Request(ranks=64, minutes=2000, memory_mb=40000, nodes=2, partition="batch", account="fluids")
    text = scripts(scene, request, "make", ".venv/bin/python")["run"].replace(str(tmp_path), "cases")
    assert text == GOLDEN.read_text(encoding="utf-8")


def test_stages_before_and_after_are_small_jobs_by_make(tmp_path):
    scene = write_scene(tmp_path / "pinch")
    texts = scripts(scene, Request(ranks=64, minutes=60, memory_mb=1000), "make", "python")
    assert "make pinch.case LEVEL=tiny" in texts["before"]
    assert texts["after"].rstrip().endswith("QUIET=1")
    assert "--signal" not in texts["after"]
    assert "--nodes" not in texts["run"]  # not asked for: Slurm's choice


def test_times():
    assert slurm_time(90) == "0-01:30:00"
    assert slurm_time(2 * 24 * 60 + 5) == "2-00:05:00"
