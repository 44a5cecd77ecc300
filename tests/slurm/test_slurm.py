"""A real Slurm of one node, started here: a scene by make, cut off at its limit and submitted again; a study.

Opt-in: make test-slurm (Debian's slurm-wlm, root). The log goes to docs/cluster_log.txt.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

from pipeline.openfoam.ranks import Ranks
from pipeline.run.checkpoint import last_checkpoint
from pipeline.scene.scene import load_scene
from tests.conftest import ROOT, TINY

pytestmark = [
    pytest.mark.slurm,
    pytest.mark.skipif(shutil.which("slurmctld") is None, reason="slurm-wlm is not installed"),
    pytest.mark.skipif(os.geteuid() != 0, reason="slurmd starts jobs as root only"),
]

CONTROL = Path(__file__).with_name("slurmctl.sh")
LOG = ROOT / "docs" / "cluster_log.txt"
# Four runs, and one that is meant to be refused; the two on the draft are the same but for their ranks.
STUDY = """run, level, until, ranks, may_fail, numerics.time_step, fluid.turbulence, motion.end_time, numerics.max_courant
base, tiny, vortices_cfd, 1, , 0.5e-3, , 0.1,
les, tiny, run, 1, , 1e-3, WALE, 0.1,
one_rank, draft, run, 1, , , , 0.02,
two_ranks, draft, run, 2, , , , 0.02,
edge, tiny, run, 1, yes, 1e-3, , 0.1, 0.01
"""
# Slurm here keeps no accounts to ask for the state of a job
FLAGS = (
    "--latency-wait 30 --slurm-status-command squeue --slurm-init-seconds-before-status-checks 10"
)
# Enough cells for two ranks, enough steps that the solver is at work for minutes; images and PIV are small.
LONG = """
[levels.draft]
numerics = { time_step = 5e-4, write_interval = 0.02 }
camera = { columns = 320, rows = 256, centre = [0.01, 0.185] }
piv = { every = 10, preset = "fast" }
"""
FOLDER = ROOT / "cases" / "slurm_test"


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """Start a Slurm and stop it again; SLURM_CONF is set meanwhile."""
    folder = tmp_path_factory.mktemp("slurm")
    done = subprocess.run(["sh", CONTROL, "start", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"Slurm does not start here: {done.stderr.strip()}")
    os.environ["SLURM_CONF"] = done.stdout.strip()
    # Snakemake's jobs lose SLURM_CONF, and no /etc/slurm names this cluster: the programs are told by what stands before them
    (folder / "bin").mkdir()
    for name in ("srun", "sbatch", "squeue", "scancel", "scontrol", "sinfo"):
        program = folder / "bin" / name
        program.write_text(
            f'#!/bin/sh\nSLURM_CONF={done.stdout.strip()} exec {shutil.which(name)} "$@"\n'
        )
        program.chmod(0o755)
    os.environ["PATH"] = f"{folder / 'bin'}:{os.environ['PATH']}"
    LOG.write_text(
        f"{datetime.now(UTC):%Y-%m-%d} {subprocess.getoutput('sinfo --version')}, one node of {os.cpu_count()} cores\n"
    )
    yield folder
    subprocess.run(["sh", CONTROL, "stop", folder], check=False)
    del os.environ["SLURM_CONF"]


@pytest.fixture(scope="module")
def scene():
    """A case in the project's tree, where jobs on other nodes would find it."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    (FOLDER / "scene.toml").write_text(
        TINY.format(parent="../single_finger", kind="2d", more="", numerics="") + LONG,
        encoding="utf-8",
    )
    for name in ("kinematics", "reference"):
        (FOLDER / name).symlink_to(f"../single_finger/{name}")
    yield load_scene(Path("cases/slurm_test"), "draft")
    shutil.rmtree(FOLDER)


def make(*words: str, seconds: float) -> subprocess.CompletedProcess[str]:
    """A make as a user types it, not as a part of the one that runs the tests."""
    env = {
        key: value
        for key, value in os.environ.items()
        if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    }
    command = ["make", "--no-print-directory", *words]
    return subprocess.run(
        command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=seconds
    )


def note(title: str, text: str) -> None:
    """Add to the log, without the paths of this machine, and show."""
    text = text.replace(f"{ROOT}/", "")
    with LOG.open("a", encoding="utf-8") as file:
        file.write(f"\n== {title}\n{text.rstrip()}\n")
    print(f"\n== {title}\n{text}")


def job_of(rule: str) -> str | None:
    """Number of the job of a rule that Slurm is running, or None."""
    shown = subprocess.run(
        ["squeue", "--noheader", "--states=R", "--format=%i %k"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    jobs = [line.split()[0] for line in shown.splitlines() if f"rule_{rule}_" in line]
    return jobs[0] if jobs else None


def minutes_run(job: str) -> int:
    """Whole minutes for which a job has run."""
    shown = subprocess.run(
        ["squeue", "--noheader", "--format=%M", f"--jobs={job}"],
        capture_output=True,
        text=True,
        check=True,
    )
    parts = [int(part) for part in re.split("[-:]", shown.stdout.strip())]
    return ([0, 0, *parts][-3] * 60) + parts[-2]


def wait_until(what: Callable[[], bool], seconds: float) -> None:
    """Look every half second; AssertionError where it does not happen."""
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.5)


def test_a_scene_cut_off_by_its_limit_is_submitted_again_and_ends(slurm, scene):
    """`make slurm_test SLURM=1`: a job for each stage. Once the solver has a checkpoint its limit is set to the next full
    minute: Slurm ends it, Snakemake submits it again, it resumes, and the later stages go on to the report."""
    begin = time.monotonic()
    command = [
        "make",
        "--no-print-directory",
        "slurm_test",
        "LEVEL=draft",
        "NP=2",
        "SLURM=1",
        "MINUTES=60",
        f"SNAKEFLAGS={FLAGS}",
    ]
    env = {
        key: value
        for key, value in os.environ.items()
        if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    }
    with (slurm / "make.log").open("w+") as log:
        make_ = subprocess.Popen(command, cwd=ROOT, env=env, stdout=log, stderr=log)
        case = scene.out / "case" / "interval_0"
        wait_until(
            lambda: last_checkpoint(case, Ranks(2)) is not None or make_.poll() is not None, 3000
        )
        solver = job_of("run")
        assert solver is not None, (slurm / "make.log").read_text()[-3000:]
        near = minutes_run(solver) + 1
        subprocess.run(["scontrol", "update", f"JobId={solver}", f"TimeLimit={near}"], check=True)
        wait_until(lambda: job_of("run") != solver, 240)
        told = f"{datetime.now(UTC):%H:%M:%S} job {solver}: ended at its limit of {near} min"
        code = make_.wait(5400)
    text = (slurm / "make.log").read_text()
    lines = [
        line
        for line in text.splitlines()
        if "submitted" in line or "rror in rule" in line or "steps (" in line
    ]
    note("make slurm_test LEVEL=draft NP=2 SLURM=1", "\n".join([told, *lines]))
    assert code == 0, text[-3000:]
    record = json.loads((scene.out / "run" / "run.json").read_text())
    kept = ("level", "cells", "steps", "ranks", "resumed", "wall_time")
    note(
        f"its run.json (all in {(time.monotonic() - begin) / 60:.0f} min)",
        json.dumps({k: record[k] for k in kept}),
    )
    assert record["ranks"] == 2
    assert record["resumed"], "the solver began anew instead of resuming"
    assert (scene.out / "report.html").exists()


def test_a_study_of_four_runs(slurm, scene):
    """Snakemake's Slurm executor, one job a stage and run; the table has a row for each run, the refused one included."""
    table = FOLDER / "studies" / "four.csv"
    table.parent.mkdir(exist_ok=True)
    table.write_text(STUDY)
    begin = time.monotonic()
    done = make(
        "study",
        "STUDY=cases/slurm_test/studies/four.csv",
        "SLURM=1",
        f"SNAKEFLAGS={FLAGS}",
        seconds=3600,
    )
    lines = [
        line
        for line in done.stderr.splitlines()
        if "submitted" in line or "steps (" in line or "rror" in line
    ]
    note(f"a study of four runs ({time.monotonic() - begin:.0f} s)", "\n".join(lines))
    assert done.returncode == 0, done.stderr[-3000:]
    study = FOLDER / "out" / "studies" / "four"
    result = pd.read_csv(study / "table.csv").set_index("run")
    columns = ["ranks", "time_step_s", "cells", "steps", "peak_force_N", "cpu_run_s"]
    note("its table", result[columns].to_string())
    assert list(result.index) == ["base", "les", "one_rank", "two_ranks", "edge"]
    assert result["peak_force_N"].drop("edge").notna().all()
    assert (
        json.loads((study / "edge" / "out" / "tiny" / "outcome.json").read_text())["ended"]
        == "refused"
    )
    assert result.loc["two_ranks", "ranks"] == 2
    # the same run on two ranks: what is left of stopping the pressure's iterations early
    assert result.loc["two_ranks", "peak_force_N"] == pytest.approx(
        result.loc["one_rank", "peak_force_N"], rel=1e-3
    )


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s"]))
