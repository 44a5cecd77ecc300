"""A real Slurm of one node: a scene by make that meets its time limit and goes on; a study.

Opt-in: make test-slurm (Debian's slurm-wlm, root). The log goes to docs/cluster_log.txt.
"""

import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

from pipeline.openfoam.case_folder import Case
from pipeline.scene.scene import load_scene
from pipeline.solve.checkpoint import last_checkpoint
from piv.files.record import read_record
from tests.conftest import ROOT, TINY
from tests.inner_make import inner_environment

pytestmark = [
    pytest.mark.slurm,
    pytest.mark.skipif(shutil.which("slurmctld") is None, reason="slurm-wlm is not installed"),
    pytest.mark.skipif(os.geteuid() != 0, reason="slurmd starts jobs as root only"),
]

CONTROL = Path(__file__).with_name("slurmctl.sh")
LOG = ROOT / "docs" / "cluster_log.txt"
# Four runs, and one that must be refused; the two at level draft differ in their ranks only.
COLUMNS = (
    "run, level, until, ranks, may_fail, numerics.time_step, fluid.turbulence, motion.end_time,"
    " numerics.max_courant"
)
STUDY = f"""{COLUMNS}
base, tiny, vortices_cfd, 1, , 0.5e-3, , 0.1,
les, tiny, solve, 1, , 1e-3, WALE, 0.1,
one_rank, draft, run, 1, , , , 0.02,
two_ranks, draft, run, 2, , , , 0.02,
edge, tiny, solve, 1, yes, 1e-3, , 0.1, 0.01
"""
# this Slurm keeps no accounts with the states of jobs
FLAGS = "--latency-wait 30 --slurm-status-command squeue"
FLAGS += " --slurm-init-seconds-before-status-checks 10"
# Cells for two ranks, and minutes of the solver; images and PIV are small.
LONG = """
[levels.draft]
numerics = { time_step = 2.5e-4, write_interval = 0.02 }
camera = { columns = 320, rows = 256, scale_mm_per_px = 0.35 }
piv = { every = 5, preset = "fast" }
"""
FOLDER = ROOT / "cases" / "slurm_test"


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A running Slurm, with SLURM_CONF set."""
    folder = tmp_path_factory.mktemp("slurm")
    done = subprocess.run(["sh", CONTROL, "start", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"Slurm does not start here: {done.stderr.strip()}")
    os.environ["SLURM_CONF"] = done.stdout.strip()
    # Snakemake's jobs lose SLURM_CONF, and no /etc/slurm names this cluster
    (folder / "bin").mkdir()
    for name in ("srun", "sbatch", "squeue", "scancel", "scontrol", "sinfo"):
        program = folder / "bin" / name
        configuration = f"SLURM_CONF={done.stdout.strip()}"
        program.write_text(f'#!/bin/sh\n{configuration} exec {shutil.which(name)} "$@"\n')
        program.chmod(0o755)
    os.environ["PATH"] = f"{folder / 'bin'}:{os.environ['PATH']}"
    version = f"{datetime.now(UTC):%Y-%m-%d} {subprocess.getoutput('sinfo --version')}"
    LOG.write_text(f"{version}, one node of {os.cpu_count()} cores\n")
    yield folder
    subprocess.run(["sh", CONTROL, "stop", folder], check=False)
    del os.environ["SLURM_CONF"]


@pytest.fixture(scope="module")
def scene():
    """A case in the project's tree, where jobs on other nodes would find it."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    text = TINY.format(parent="../single_finger", kind="2d", more="", numerics="") + LONG
    (FOLDER / "scene.toml").write_text(text, encoding="utf-8")
    for name in ("kinematics", "reference"):
        (FOLDER / name).symlink_to(f"../single_finger/{name}")
    yield load_scene(Path("cases/slurm_test"), "draft")
    shutil.rmtree(FOLDER)


def softfinger(log: Path, *words: str) -> subprocess.Popen[bytes]:
    """Start a user's command as batch jobs, with its output in `log`."""
    command = [".venv/bin/softfinger", *words, "--slurm", "--snakemake", FLAGS]
    with log.open("wb") as file:
        return subprocess.Popen(
            command, cwd=ROOT, env=inner_environment(), stdout=file, stderr=file
        )


def job_lines(log: Path) -> list[str]:
    """Lines of Snakemake's log about jobs."""
    words = ("submitted", "rror in rule", "steps (")
    return [line for line in log.read_text().splitlines() if any(word in line for word in words)]


def note(title: str, text: str) -> None:
    """Add to the log, without the paths of this machine, and show."""
    text = text.replace(f"{ROOT}/", "")
    with LOG.open("a", encoding="utf-8") as file:
        file.write(f"\n== {title}\n{text.rstrip()}\n")
    print(f"\n== {title}\n{text}")


def job_of(rule: str) -> str | None:
    """Number of the job of a rule that Slurm is running, or None."""
    lines = squeue("--states=R", "--format=%i %k").splitlines()
    return next((line.split()[0] for line in lines if f"rule_{rule}_" in line), None)


def squeue(*options: str) -> str:
    command = ["squeue", "--noheader", *options]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def minutes_run(job: str) -> int:
    """Whole minutes for which a job has run."""
    parts = [int(part) for part in re.split("[-:]", squeue("--format=%M", f"--jobs={job}"))]
    return ([0, 0, *parts][-3] * 60) + parts[-2]


def wait_until(what: Callable[[], bool], seconds: float) -> None:
    """Wait for a condition; AssertionError where it does not come."""
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.5)


def test_a_scene_that_meets_its_time_limit_is_submitted_again_and_ends(slurm, scene):
    """`make slurm_test SLURM=1`: a job for each stage.

    Once the solver has a checkpoint its limit becomes the next full minute: Slurm ends it,
    Snakemake submits it again, it resumes, and the later stages go on to the report.
    """
    begin, log = time.monotonic(), slurm / "make.log"
    process = softfinger(log, "run", "cases/slurm_test", "--level", "draft", "--ranks", "2")
    case = Case(scene.out / "case" / "interval_0", 2)
    wait_until(lambda: last_checkpoint(case) is not None or process.poll() is not None, 3000)
    solver = job_of("solve")
    assert solver is not None, log.read_text()[-3000:]
    near = minutes_run(solver) + 1
    subprocess.run(["scontrol", "update", f"JobId={solver}", f"TimeLimit={near}"], check=True)
    wait_until(lambda: job_of("solve") != solver, 240)
    ended = f"{datetime.now(UTC):%H:%M:%S} job {solver}: ended at its limit of {near} min"
    code = process.wait(5400)
    note("make slurm_test LEVEL=draft NP=2 SLURM=1", "\n".join([ended, *job_lines(log)]))
    assert code == 0, log.read_text()[-3000:]
    record = json.loads((scene.out / "run" / "run.json").read_text())
    kept = ("level", "cells", "steps", "ranks", "resumed", "wall_time")
    minutes = (time.monotonic() - begin) / 60
    note(f"its run.json (all in {minutes:.0f} min)", json.dumps({k: record[k] for k in kept}))
    assert record["ranks"] == 2
    assert record["resumed"], "the solver began anew instead of resuming"
    assert (scene.out / "report.html").exists()


def test_a_study_of_four_runs(slurm, scene):
    """One job for each stage and run; the table has a row for each run, also the refused one."""
    table = FOLDER / "studies" / "four.csv"
    table.parent.mkdir(exist_ok=True)
    table.write_text(STUDY)
    begin, log = time.monotonic(), slurm / "study.log"
    code = softfinger(log, "study", "cases/slurm_test/studies/four.csv").wait(3600)
    note(f"a study of four runs ({time.monotonic() - begin:.0f} s)", "\n".join(job_lines(log)))
    assert code == 0, log.read_text()[-3000:]
    study = FOLDER / "out" / "studies" / "four"
    result = pd.read_csv(study / "table.csv").set_index("run")
    columns = ["ranks", "time_step_s", "cells", "steps", "peak_force_N", "cpu_solve_s"]
    note("its table", result[columns].to_string())
    assert list(result.index) == ["base", "les", "one_rank", "two_ranks", "edge"]
    assert result["peak_force_N"].drop("edge").notna().all()
    assert read_record(study / "edge", "outcome")["ended"] == "refused"
    assert result.loc["two_ranks", "ranks"] == 2
    # the same run on two ranks: early ends of the pressure's iterations
    one, two = result.loc[["one_rank", "two_ranks"], "peak_force_N"]
    assert two == pytest.approx(one, rel=1e-3)
