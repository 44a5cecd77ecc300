"""The batch script of the solver, word for word: what an administrator reads; and what is asked of Slurm where nothing is said."""

import argparse
import os
import subprocess
from pathlib import Path

import pytest

from fileio.errors import StageError
from pipeline.scene.scene import load_scene
from pipeline.study import slurm as batch
from pipeline.study.slurm import Request, asked, scripts, slurm_time
from tests.conftest import write_scene

GOLDEN = Path(__file__).with_name("run.sbatch")


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A scene in cases/pinch of a project, from whose folder the scripts run."""
    write_scene(tmp_path / "cases" / "pinch")
    monkeypatch.chdir(tmp_path)
    return load_scene(Path("cases/pinch"), "tiny")


def arguments(**given):
    nothing = {
        "ranks": None,
        "nodes": None,
        "minutes": None,
        "partition": None,
        "account": None,
        "quiet": False,
        "collated": False,
    }
    return argparse.Namespace(**nothing | given)


def test_run_script(scene):
    request = Request(ranks=64, minutes=2000, memory_mb=40000, nodes=2, partition="batch", account="fluids")
    assert scripts(scene, request, "make", ".venv/bin/python")["run"] == GOLDEN.read_text(encoding="utf-8")


def test_stages_before_and_after_are_small_jobs_by_make(scene):
    texts = scripts(scene, Request(ranks=64, minutes=60, memory_mb=1000), "make", "python")
    assert "make pinch.case LEVEL=tiny" in texts["before"]
    assert texts["after"].rstrip().endswith("QUIET=1 SLURM=")
    assert "--signal" not in texts["after"]
    assert "--nodes" not in texts["run"]  # not asked for: Slurm's choice


def test_jobs_do_not_submit_themselves_again(scene, tmp_path):
    """sbatch hands on the environment of `make pinch SLURM=1`, in which MAKEFLAGS says SLURM=1 to every make."""
    texts = scripts(scene, Request(ranks=2, minutes=60, memory_mb=1000), str(tmp_path / "make"), "python")
    (tmp_path / "Makefile").write_text("pinch:\n\t@echo $(if $(SLURM),submitted again,computed)\n")
    (tmp_path / "make").write_text('#!/bin/sh\nexec make -f "$(dirname "$0")/Makefile" "$@"\n')
    (tmp_path / "make").chmod(0o755)
    (tmp_path / "after.sh").write_text(texts["after"])
    env = os.environ | {"MAKEFLAGS": "j2 -- SLURM=1 LEVEL=tiny", "SLURM": "1"}
    done = subprocess.run(
        ["bash", tmp_path / "after.sh"], env=env, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["computed"]


def test_scenes_that_lie_elsewhere_are_found_by_the_jobs(tmp_path):
    """As those of a setting that was asked for by its accuracy."""
    scene = write_scene(tmp_path / "asked" / "draft")
    texts = scripts(scene, Request(ranks=2, minutes=60, memory_mb=1000), "make", "python")
    assert f"make draft.case CASES={tmp_path / 'asked'} LEVEL=tiny" in texts["before"]
    assert f"make draft CASES={tmp_path / 'asked'} LEVEL=tiny" in texts["after"]


def test_ranks_not_asked_for_are_those_of_a_node_and_said(scene, monkeypatch, capsys):
    monkeypatch.setattr(batch, "node_cores", lambda: 48)
    assert asked(scene, arguments()).ranks == 48
    assert "48 ranks: as many as a node has cores" in capsys.readouterr().out
    assert asked(scene, arguments(ranks=96)).nodes == 2


def test_ranks_that_pay_are_taken_once_there_is_a_mesh(scene, monkeypatch, capsys):
    scene.out.mkdir(parents=True)
    (scene.out / "sweep.h5").touch()
    monkeypatch.setattr(batch, "size", lambda scene: (600_000, 30_000))
    monkeypatch.setattr(batch, "node_cores", lambda: 48)
    request = asked(scene, arguments())
    assert 8 <= request.ranks <= 120  # no fewer than 5,000 cells each
    assert "as many as pay for 600000 cells" in capsys.readouterr().out


def test_nothing_is_guessed_where_nobody_knows(scene, monkeypatch):
    monkeypatch.setattr(batch, "node_cores", lambda: None)
    with pytest.raises(StageError, match="how many ranks"):
        asked(scene, arguments())


def test_times():
    assert slurm_time(90) == "0-01:30:00"
    assert slurm_time(2 * 24 * 60 + 5) == "2-00:05:00"
