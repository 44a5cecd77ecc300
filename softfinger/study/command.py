"""Commands of studies: the runs of a table, scheduled by Snakemake, here or as batch jobs."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from piv.files.errors import StageError
from softfinger.options import CORES, SceneFolder, Slurm, SnakemakeFlags, open_session

_PACKAGE = Path(__file__).resolve().parents[1]
_ENVIRONMENT = _PACKAGE.parent / ".venv-study"
_OF_MAKE = ("TYPED", "MAKEFLAGS", "MAKELEVEL", "MFLAGS")  # values of make are not those of its jobs
_RETRIES = "5"  # of a job that reaches its time limit; it resumes


def study(
    table: Annotated[Path, Parameter(help="Runs (.csv), as cases/single_finger/studies/x.csv.")],
    *,
    scene: Annotated[Path | None, Parameter(help="Another scene than the table's.")] = None,
    only: Annotated[str, Parameter(help="Names of some of its runs.")] = "",
    slurm: Slurm = False,
    snakemake: SnakemakeFlags = "",
) -> Path:
    """Make the runs of a table, equal stages once, and tabulate them."""
    if table.is_dir():
        raise StageError("give STUDY=table.csv, as cases/single_finger/studies/tradeoff.csv")
    from piv.files.atomic import write_text
    from softfinger.study.machine_speed import probe
    from softfinger.study.plan import plan_study
    from softfinger.study.rows import read_study
    from softfinger.study.table import write_table

    home = scene or Path(os.path.relpath(table.parent.parent))
    chosen = only.replace(",", " ").split()
    plan = plan_study(home, table.stem, read_study(table), chosen)
    if not (speed := plan.with_name("probe.json")).exists():
        write_text(speed, json.dumps(probe()) + "\n")
    code = schedule(plan, slurm, snakemake)
    print(f"table: {write_table(plan)}")
    if code:
        raise SystemExit(code)
    return plan


def plot(
    table: Annotated[Path, Parameter(help="table.csv of a study.")],
    x: Annotated[str, Parameter(help="A column, as mesh.tip_cell.")],
    y: Annotated[str, Parameter(help="Another, as peak_force_N.")],
    *,
    output: Annotated[Path, Parameter(["--output", "-o"], help=".png, .pdf or .svg")],
) -> None:
    """Draw a column of a study's table over another: a point for each run, by level a line."""
    import numpy as np

    from piv.files.errors import suggestion
    from piv.formats.user_tables import UserTable, read_columns
    from postprocess.draw.style import HEIGHT, WIDTH, new_figure, save

    if output.suffix not in (".png", ".pdf", ".svg"):
        raise StageError(f"--output {output}: give a name that ends in .png, .pdf or .svg")
    if not table.is_file():
        raise StageError(f"{table}: no such table; softfinger study writes it")
    runs = read_columns(table, ["run", "level"], None)
    for name in (x, y):
        if name not in runs.names:
            near = suggestion(name, runs.names)
            raise StageError(f"{table}: no column {name}{near}; it has {', '.join(runs.names)}")
    both = [k for k, cells in enumerate(zip(runs.text(x), runs.text(y), strict=True)) if all(cells)]
    if not both:
        raise StageError(f"{table}: no run has both {x} and {y}; run the study again")
    known = UserTable(
        table, runs.names, [runs.rows[k] for k in both], [runs.lines[k] for k in both]
    )
    points = known.numbers([x, y])
    levels = np.array(known.text("level"))
    figure, ax = new_figure(WIDTH, HEIGHT)
    for level in dict.fromkeys(levels):
        line = points[levels == level]
        ax.plot(*line[np.argsort(line[:, 0], kind="stable")].T, "o-", label=level)
    for run, place in zip(known.text("run"), points, strict=True):
        ax.annotate(run, place, xytext=(4, 4), textcoords="offset points", size=7)
    ax.set(xlabel=x, ylabel=y)
    ax.legend()
    print(f"plot: {save(figure, output, dpi=300)}")


def tradeoff(
    scene: SceneFolder = Path("cases/single_finger"),
    *,
    only: Annotated[str, Parameter(help="Names of some of its runs.")] = "",
) -> None:
    """Measure the cost of accuracy, which ACCURACY and BUDGET need; hours.

    A scene without a studies/tradeoff.csv takes that of the scene that it extends.
    """
    from softfinger.study.accuracy import study_table
    from softfinger.study.tradeoff import write_tradeoff

    plan = study(study_table(open_session(scene, "coarse").scene), scene=scene, only=only)
    write_tradeoff(plan, only.replace(",", " ").split())


def job(plan: Path, name: str, stage: str, *, threads: int = 1) -> None:
    """Make one stage of a run of a plan (Snakemake)."""
    from softfinger.study.plan import run_job

    run_job(plan, name, stage, threads)


def schedule(plan: Path, slurm: bool, flags: str = "") -> int:
    """Let Snakemake make the jobs of a plan, with `flags` of its own; returns its exit code."""
    from softfinger.study.plan import clear_records, has_jobs

    if not has_jobs(plan):
        return 0
    if slurm and shutil.which("sbatch") is None:
        raise StageError("SLURM=1: there is no sbatch here; leave it out, or load Slurm")
    environment = {name: value for name, value in os.environ.items() if name not in _OF_MAKE}
    program = _snakemake(environment)
    words = [program, "-s", str(_PACKAGE / "study" / "Snakefile"), *shlex.split(flags)]
    if slurm:
        words += ["--executor", "slurm", "--slurm-requeue", "-j100"]
        words += [] if "--retries" in words else ["--retries", _RETRIES]
    else:
        words += [f"-j{os.environ.get('NP') or CORES}"]
    words += ["--config", f"plan={plan}", f"python={sys.executable}"]
    if not {"-n", "--dry-run", "--dryrun"} & set(words):
        clear_records(plan)
    return subprocess.run(words, check=False, env=environment).returncode


def _snakemake(environment: dict[str, str]) -> str:
    """The program Snakemake; a clone installs the one of its lock first. StageError without one."""
    if (_PACKAGE.parent / "Makefile").is_file():
        ready = f"{_ENVIRONMENT.name}/.ready"
        words = ["make", "--no-print-directory", "-C", str(_PACKAGE.parent), ready]
        if subprocess.run(words, check=False, env=environment).returncode:
            raise StageError(f"Snakemake cannot be installed; run make {ready} to see why")
        return str(_ENVIRONMENT / "bin" / "snakemake")
    if (program := shutil.which("snakemake")) is None:
        raise StageError("Snakemake is missing; install it")
    return program
