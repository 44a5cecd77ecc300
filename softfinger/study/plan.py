"""plan.json: the stale stages of a study's runs, as jobs for Snakemake."""

import os
import re
from pathlib import Path
from typing import Any

from pipeline.formats.records import STUDY_PLAN
from pipeline.openfoam.environment import check_openfoam
from pipeline.runs.estimate import estimate
from pipeline.runs.run import Run, open_run, run_of
from pipeline.runs.stages import BY_NAME
from piv.files.errors import StageError
from piv.files.record import check_own, forget, record_path
from softfinger.make import Machine, make
from softfinger.study.outcome import OUTCOME, outcome_digest, outcome_is_there, write_outcome
from softfinger.study.rows import Row

_MARGIN = 2.0  # on the estimates of time and memory
_LEAST_MINUTES, _LEAST_MB = 5, 1000
_THREADS = 8  # at most
_PATH = r"[\w./-]+"  # in others Snakemake sees its own patterns, and a shell commands


def plan_study(home: Path, study: str, rows: list[Row], only: list[str]) -> Path:
    """Write the plan of a study's runs, with the jobs of some of them; returns its path.

    `only`: names of runs; empty: all. StageError where a run is refused or unknown.
    """
    names = [row.run for row in rows]
    if unknown := [name for name in only if name not in names]:
        raise StageError(f"{study}: no run {unknown[0]!r}; the runs are {', '.join(names)}")
    runs: list[dict[str, Any]] = []
    jobs: dict[str, dict[str, Any]] = {}
    made_by: dict[str, str] = {}  # record of the first run with these numbers, by digest
    compared = len({row.ranks for row in rows}) > 1
    for row in rows:
        about = describe(home, study, row, compared)
        runs.append(about)
        if only and row.run not in only:
            continue
        if row.may_fail:
            if not outcome_is_there(about):
                jobs[str(record_path(Path(about["out"]), OUTCOME))] = _outcome_job(about)
            continue
        try:
            run = run_of(about)
            run.check(row.until)
        except StageError as error:
            raise StageError(f"run {row.run}: {error}") from None
        _add_jobs(jobs, made_by, run, about)
    return _write(home, study, runs, jobs)


def plan_scene(folder: Path, level: str, ranks: int) -> Path:
    """Write the plan of one scene as it is, up to its report; returns its path."""
    run = open_run(folder, level)
    run.check("report")
    row = Row(folder.name, level, ranks, "report")
    about = describe(folder, "", row) | {"out": str(run.out)}
    jobs: dict[str, dict[str, Any]] = {}
    _add_jobs(jobs, {}, run, about)
    return _write(folder, f"run_{level}", [about], jobs)


def has_jobs(plan: Path) -> bool:
    """Whether anything is left to make of a plan; StageError where OpenFOAM is missing for it."""
    jobs = STUDY_PLAN.read(plan)["jobs"].values()
    if solved := [job["ranks"] for job in jobs if job["stage"] in ("solve", OUTCOME)]:
        check_openfoam(max(solved))
    return bool(jobs)


def clear_records(plan: Path) -> None:
    """Remove the stale records of a plan: Snakemake makes what is missing."""
    for record, job in STUDY_PLAN.read(plan)["jobs"].items():
        forget(Path(record).parents[1], Path(record).stem, job["digest"])


def run_job(plan: Path, name: str, stage: str, threads: int) -> None:
    """Make one stage of a run of a plan, or its outcome."""
    about = next(run for run in STUDY_PLAN.read(plan)["runs"] if run["run"] == name)
    machine = Machine(about["ranks"], threads)
    if stage == OUTCOME:
        write_outcome(about, machine)
    else:
        run = run_of(about)
        if stage == "mesh":
            run.check(about["until"])  # once the motion is known
        make(run, stage, machine, quiet=True, alone=True)


def describe(home: Path, study: str, row: Row, compared: bool = False) -> dict[str, Any]:
    """The row of a study of the scene in `home`, with its folders; `compared`: by its ranks too."""
    out = home / "out" / "studies" / study / row.run
    folder = os.path.normpath(home / row.scene)
    about = {key: value for key, value in vars(row).items() if key != "scene"}
    about |= {"compared_ranks": row.ranks if compared else None}
    return about | {"folder": folder, "out": str(out)}


def _add_jobs(
    jobs: dict[str, dict[str, Any]], made_by: dict[str, str], run: Run, about: dict[str, Any]
) -> None:
    for stage in run.stale(about["until"]):
        record, digest = str(record_path(run.out, stage)), run.digest(stage)
        first = made_by.setdefault(digest, record)
        before = [str(record_path(run.out, name)) for name in run.inputs(stage)]
        inputs = [name for name in before if name in jobs] + [first] * (first != record)
        ranks = about["ranks"] if BY_NAME[stage].ranks else 1
        threads = _THREADS if BY_NAME[stage].threads else ranks
        job = _job(about["run"], stage, digest, ranks, *_cost(run, stage, ranks))
        jobs[record] = job | {"inputs": inputs, "threads": threads}


def _outcome_job(about: dict[str, Any]) -> dict[str, Any]:
    try:
        run = run_of(about)
        costs = [_cost(run, stage, about["ranks"]) for stage in run.stale(about["until"])]
    except StageError:
        costs = []  # its outcome is a refusal
    seconds, memory = sum(cost[0] for cost in costs), max([0.0, *(cost[1] for cost in costs)])
    return _job(about["run"], OUTCOME, outcome_digest(about), about["ranks"], seconds, memory)


def _cost(run: Run, stage: str, ranks: int) -> tuple[float, float]:
    """Wall time (s) and memory (MB) of a stage, which only the solver's shares among ranks."""
    seconds, memory = estimate(run, stage)
    return seconds / (ranks if BY_NAME[stage].ranks else 1), memory


def _job(
    name: str, stage: str, digest: str, ranks: int, seconds: float, memory: float
) -> dict[str, Any]:
    """A job of Snakemake: a stage of the run `name`; `seconds` of wall time, `memory` in MB."""
    return {
        "run": name,
        "stage": stage,
        "digest": digest,
        "inputs": [],
        "ranks": ranks,
        "threads": ranks,
        "minutes": max(_LEAST_MINUTES, round(_MARGIN * seconds / 60)),
        "memory_mb": max(_LEAST_MB, round(_MARGIN * memory)),
    }


def _write(home: Path, study: str, runs: list[dict[str, Any]], jobs: dict[str, Any]) -> Path:
    path = home / "out" / "studies" / study / "plan.json"
    check_own(path.parent)
    if odd := next((name for name in (str(path), *jobs) if not re.fullmatch(_PATH, name)), None):
        raise StageError(
            f"{odd}: a study's jobs need paths of letters, digits, '_', '-' and '.'; rename the"
            " folder"
        )
    STUDY_PLAN.write(path, {"study": study, "home": str(home), "runs": runs, "jobs": jobs})
    return path
