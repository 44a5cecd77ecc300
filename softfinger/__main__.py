"""The program `softfinger`: runs of a scene and their results."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from piv.files import __version__
from piv.files.command import guarded, importing, working
from piv.files.errors import StageError

PROJECT = Path(__file__).resolve().parents[1]
SNAKEMAKE = PROJECT / ".venv-study" / "bin" / "snakemake"
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
# values that make hands on by the environment
MAKE_VALUES = ["LEVEL", "NP", "HOSTS", "COLLATED", "QUIET", "COUPLED", "ACCURACY", "BUDGET"]
MAKE_VALUES += ["SLURM", "NODES", "MINUTES", "PARTITION", "ACCOUNT", "RETRIES", "STUDIES"]
MAKE_VALUES += ["WHOLE", "SNAKEFLAGS", "DPIV", "INPUTS", "QUICK"]
SLURM_VALUES = {"NODES", "MINUTES", "PARTITION", "ACCOUNT", "RETRIES"}
DEFAULT_RANKS = min(4, CORES)  # more ranks rarely pay

app = App(
    "softfinger", help=__doc__, version=__version__, default_parameter=Parameter(show_env_var=False)
)

Scene = Annotated[Path, Parameter(help="Folder of the scene, as cases/single_finger.")]
Level = Annotated[str, Parameter(env_var="LEVEL", help="Level of the scene.")]
Ranks = Annotated[int, Parameter(["--ranks", "-n"], env_var="NP", help="MPI ranks.")]
Quiet = Annotated[bool, Parameter(env_var="QUIET", negative="", help="Print errors only.")]
Overrides = Annotated[
    list[str],
    Parameter(
        "--set", negative="", help="KEY=VALUE of the scene, as mesh.tip_cell=0.001; once for each."
    ),
]
Switch = Annotated[bool, Parameter(negative="")]
Coupled = Annotated[bool, Parameter(env_var="COUPLED", negative="")]
Accuracy = Annotated[str, Parameter(env_var="ACCURACY", help="Largest error, as 12%.")]
Budget = Annotated[str, Parameter(env_var="BUDGET", help="Longest time, as 10min.")]
RunNames = Annotated[str, Parameter(env_var="STUDIES", help="Names of some of its runs.")]


@app.command
def run(
    scene: Scene,
    *,
    until: Annotated[str, Parameter(help="Last stage: see softfinger stages.")] = "report",
    level: Level = "coarse",
    set_: Overrides = [],  # noqa: B006
    name: Annotated[str, Parameter(help="Folder of the results of a run with --set.")] = "",
    ranks: Ranks = DEFAULT_RANKS,
    hosts: Annotated[Path | None, Parameter(env_var="HOSTS", help="MPI host file.")] = None,
    collated: Annotated[bool, Parameter(env_var="COLLATED", negative="")] = False,
    coupled: Coupled = False,
    accuracy: Accuracy = "",
    budget: Budget = "",
    slurm: Annotated[bool, Parameter(env_var="SLURM", negative="")] = False,
    dry_run: Switch = False,
    quiet: Quiet = False,
) -> None:
    """Make the stale results of a scene, up to a stage.

    Parameters
    ----------
    collated
        One file for all ranks, not one for each.
    coupled
        Pressure and water make the motion together.
    slurm
        As batch jobs.
    dry_run
        Print what would be made and why; make nothing.
    """
    from pipeline.runs.estimate import duration, estimate
    from pipeline.scene.predicted import predicted
    from softfinger.make import Machine, make

    machine = Machine(ranks, min(ranks, CORES), hosts, collated)
    chosen = {"COUPLED": coupled, "SLURM": slurm, "ACCURACY": accuracy, "BUDGET": budget}
    modes = [name for name, value in chosen.items() if value]
    others = {" and ".join(modes[1:]): len(modes) > 1, "--set": bool(set_), "--name": bool(name)}
    others |= {"HOSTS": hosts is not None}
    others |= {"LEVEL, which it chooses": bool(accuracy or budget) and level != "coarse"}
    if not coupled:  # which is one run of its own
        others |= {"one stage": until != "report", "--dry-run": dry_run}
    if modes and (other := next((name for name, value in others.items() if value), "")):
        raise StageError(f"{modes[0]} goes with a whole scene, not with {other}")
    if accuracy or budget:
        from softfinger.study.accuracy import make_cheapest

        made = make_cheapest(scene, accuracy, budget, machine, quiet)
    elif slurm:
        from softfinger.study.plan import plan_scene

        if code := _snakemake(plan_scene(scene, level, ranks), slurm=True, collated=collated):
            raise SystemExit(code)
        made = _open(scene, level)
    else:
        made = _coupled(scene, level) if coupled else _open(scene, level, set_, name)
        if dry_run:
            made.check(until)
            stale = made.stale(until)
            for stage, why in stale.items():
                print(f"{stage}: {why}")
            seconds = sum(estimate(made, stage)[0] for stage in stale)
            print(f"about {duration(seconds)} of CPU time" if stale else "nothing to do")
            if "solve" in stale:
                print(f"the flow: {predicted(made.scene)}")
            return
        make(made, until, machine, quiet)
    if until == "report" and not quiet:
        from postprocess.report.stage import outcome

        computed, shown = outcome(made.scene)
        print(f"computed: {computed}\nresult: {shown}\nreport: {made.path('report').resolve()}")


@app.command
def stages(scene: Annotated[Path | None, Parameter()] = None, *, level: Level = "coarse") -> None:
    """List the stages; of a scene, whether each is made or why not."""
    from pipeline.runs.stages import STAGES

    made = _open(scene, level) if scene else None
    for stage in STAGES:
        text = (made.why_stale(stage.name) or "made") if made else f"{stage.done:20s} {stage.about}"
        print(f"{stage.name:14s} {text}")


@app.command
def study(
    table: Annotated[Path, Parameter(help="Runs (.csv), as cases/single_finger/studies/x.csv.")],
    *,
    scene: Annotated[Path | None, Parameter(help="Another scene than the table's.")] = None,
    only: RunNames = "",
    slurm: Annotated[bool, Parameter(env_var="SLURM", negative="", help="As batch jobs.")] = False,
    collated: Annotated[bool, Parameter(env_var="COLLATED", negative="")] = False,
) -> Path:
    """Make the runs of a table, equal stages once, and tabulate them.

    Parameters
    ----------
    collated
        One file for all ranks, not one for each.
    """
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
    code = _snakemake(plan, slurm, collated)
    print(f"table: {write_table(plan)}")
    if code:
        raise SystemExit(code)
    return plan


@app.command
def tradeoff(scene: Scene = Path("cases/single_finger")) -> None:
    """Measure the cost of accuracy, which ACCURACY and BUDGET need; hours.

    A scene without a studies/tradeoff.csv takes that of the scene that it extends.
    """
    from softfinger.study.accuracy import study_table
    from softfinger.study.tradeoff import write_tradeoff

    write_tradeoff(study(study_table(_open(scene, "coarse").scene), scene=scene))


@app.command
def fea(
    scene: Scene,
    *,
    level: Level = "coarse",
    processes: Annotated[int, Parameter(env_var="NP", help="Parallel processes.")] = 2,
    quiet: Quiet = False,
) -> None:
    """Analyse the actuator of a scene: kinematics/states.h5 beside its scene.toml."""
    from pipeline.fea.stage import run as analyse

    if processes < 1:
        raise StageError(f"NP={processes}: give 1 or more")
    analyse(_open(scene, level).scene, quiet, processes=processes)


@app.command
def predict(scene: Scene, *, level: Level = "coarse", quiet: Quiet = False) -> None:
    """Predict the time of a run on 1 to 256 ranks, and how many ranks pay."""
    from softfinger.make import Machine, make
    from softfinger.study.predict import report

    run_ = _open(scene, level)
    make(run_, "case", Machine(), quiet)
    print(report(run_.scene))


@app.command
def view(
    scene: Scene,
    *,
    level: Level = "coarse",
    ranks: Ranks = DEFAULT_RANKS,
    quiet: Quiet = False,
    coupled: Coupled = False,
    whole: Annotated[bool, Parameter(env_var="WHOLE", negative="")] = False,
) -> None:
    """Write a run as a time series for ParaView.

    Parameters
    ----------
    coupled
        The run in which pressure and water make the motion together.
    whole
        Mirror at the planes of symmetry: the whole tank.
    """
    from pipeline.paraview.command import view as write
    from softfinger.make import Machine, make

    made = _coupled(scene, level) if coupled else _open(scene, level)
    make(made, "solve", Machine(ranks, min(ranks, CORES)), quiet)
    write(made.scene, whole, quiet)


@app.command
def new(
    folder: Annotated[Path, Parameter(help="The new scene: a name in cases/, or a folder.")],
    *,
    length: Annotated[str, Parameter(help="Of an own finger, as 50mm.")] = "",
    width: Annotated[str, Parameter(help="Of the finger, as 20mm.")] = "",
    pressure: Annotated[Path | None, Parameter(help="Table t,p (s, Pa), as p.csv.")] = None,
    tank: Annotated[str, Parameter(help="Length x height x depth, as 400x250x250 (mm).")] = "",
    extends: Annotated[Path | None, Parameter(help="The scene that it extends.")] = None,
) -> None:
    """Write the scene.toml of an own finger in which everything fits, or a template.

    With length, width, pressure and tank, the scene extends cases/single_finger, and the file
    names what it assumes. With extends alone it holds that line; with nothing all keys.
    """
    from piv.files.atomic import write_text
    from softfinger.new_scene import PARENT, Own, advice, lengths, write_scene
    from softfinger.scene_reference import scene_template

    if len(folder.parts) == 1 and Path("cases").is_dir():
        folder = Path("cases") / folder
    given = {"--length": length, "--width": width, "--pressure": pressure, "--tank": tank}
    if missing := [name for name, value in given.items() if not value]:
        if len(missing) < len(given):
            raise StageError(f"give {' and '.join(missing)}, too: softfinger new --help")
    else:
        assert pressure is not None
        (long,), (wide,) = lengths(length, "--length", 1), lengths(width, "--width", 1)
        x, y, z = lengths(tank, "--tank", 3, "mm")
        own = Own(long, wide, pressure, (x, y, z))
        scene = write_scene(folder, own, extends or PARENT)
        print("\n".join([*scene.remarks(), advice(scene)]))
        return
    path = folder / "scene.toml"
    if path.exists():
        raise StageError(f"{path}: exists already; give another folder, or edit it")
    if extends is not None and not (extends / "scene.toml").is_file():
        raise StageError(f"{extends}: holds no scene.toml; give the folder of a scene")
    parent = extends and os.path.relpath(extends, folder)
    write_text(path, f'extends = "{parent}"\n' if parent else scene_template())
    print(path)


@app.command
def compare(
    scene: Scene,
    dpiv: Annotated[Path | None, Parameter(env_var="DPIV", help="Folder of dpiv.toml.")] = None,
    *,
    level: Level = "coarse",
    inputs: Annotated[bool, Parameter(env_var="INPUTS", help="Vary uncertain inputs.")] = True,
    quick: Annotated[bool, Parameter(env_var="QUICK", negative="")] = False,
    coupled: Coupled = False,
    ranks: Ranks = DEFAULT_RANKS,
    quiet: Quiet = False,
) -> None:
    """Compare a scene with the recording of a laboratory.

    Parameters
    ----------
    quick
        Compare the motion only; nothing is solved.
    coupled
        Compare the motion that pressure and water make together.
    """
    from softfinger.laboratory import compare_with
    from softfinger.make import Machine

    if dpiv is None:
        raise StageError("give DPIV=folder of dpiv.toml: docs/comparison.md")
    machine = Machine(ranks, min(ranks, CORES))
    run_ = _coupled(scene, level) if coupled else _open(scene, level)
    page = compare_with(run_, dpiv, machine, inputs=inputs, quick=quick, quiet=quiet)
    print(f"report: {page.resolve()}")


@app.command
def new_dpiv(
    data: Annotated[Path | None, Parameter(help="Folder of the recording.")] = None,
) -> None:
    """Print a template of dpiv.toml, filled in from the files of a folder."""
    from postprocess.lab.dpiv_toml import dpiv_template

    print(dpiv_template(data), end="")


@app.command
def openfoam() -> None:
    """Print the version of OpenFOAM."""
    from pipeline.openfoam.environment import foam_version

    print(f"OpenFOAM {foam_version()}")


@app.command
def completion(shell: Literal["bash", "zsh", "fish"]) -> None:
    """Print the completion of a shell: eval "$(softfinger completion bash)"."""
    print(app.generate_completion(shell=shell))


@app.command(show=False)
def target(name: str) -> None:
    """Make SCENE.STAGE or SCENE.view, for the Makefile."""
    from pipeline.runs.stages import TARGETS
    from piv.files.errors import suggestion

    scene, _, stage = name.rpartition(".")
    known = [path.parent.name for path in Path("cases").glob("*/scene.toml")]
    if scene in known and stage == "view":
        _call(["view", f"cases/{scene}"])
    elif scene in known and stage in TARGETS:
        _call(["run", f"cases/{scene}", "--until", stage])
    else:
        words = [f"{one}.{stage_}" for one in known for stage_ in (*TARGETS, "view")]
        near = suggestion(name, [*known, *words])
        raise StageError(f"{name}: no such scene or target{near}; make help lists them")


@app.command(show=False)
def job(plan: Path, name: str, stage: str, *, threads: int = 1, collated: Switch = False) -> None:
    """Make one stage of a run of a plan (Snakemake)."""
    from softfinger.study.plan import run_job

    run_job(plan, name, stage, threads, collated)


def _open(scene: Path, level: str, values: list[str] = [], name: str = "") -> Any:  # noqa: B006
    """The run of a scene; one with overrides (KEY=VALUE) has its own folder."""
    from pipeline.runs.run import open_run
    from piv.files.provenance import digest
    from softfinger.study.rows import check_name, parse_cell

    if not (scene / "scene.toml").is_file():
        from piv.files.errors import suggestion

        known = sorted(path.parent.name for path in Path("cases").glob("*/scene.toml"))
        raise StageError(
            f"{scene}: no such scene{suggestion(scene.name, known)}; make help lists them"
        )
    if wrong := [text for text in values if not all(text.partition("=")[:2])]:
        raise StageError(f"--set {wrong[0]}: give KEY=VALUE, as mesh.tip_cell=0.001")
    if name and not values:
        raise StageError("--name needs --set: a run without overrides has its own folder")
    if name:
        check_name(name, "--name")
    keys = [text.partition("=")[0].strip() for text in values]
    if twice := next((key for key in keys if keys.count(key) > 1), None):
        raise StageError(f"--set {twice}: occurs twice; give it once")
    overrides = {k.strip(): parse_cell(v.strip()) for k, _, v in (t.partition("=") for t in values)}
    place = name or digest([level, overrides])[:8]
    out = scene / "out" / "variations" / place if overrides else None
    return open_run(scene, level, overrides, out)


def _coupled(scene: Path, level: str) -> Any:
    """The run of a scene in which pressure and water make the motion; it has its own folder."""
    from pipeline.runs.run import coupled_out, open_run

    plain = _open(scene, level).scene
    overrides = {"motion.source": "structure", "title": f"{plain.title}, coupled"}
    return open_run(scene, level, overrides, coupled_out(plain.out))


def _snakemake(plan: Path, slurm: bool, collated: bool = False) -> int:
    """Schedule a plan's jobs by Snakemake; returns its exit code."""
    from softfinger.study.plan import clear_records, has_jobs

    if not has_jobs(plan):
        return 0
    program = str(SNAKEMAKE) if SNAKEMAKE.exists() else shutil.which("snakemake")
    if program is None:
        raise StageError("Snakemake is missing; run make .venv-study/.ready, or install it")
    words = [program, "-s", str(Path(__file__).parent / "study" / "Snakefile")]
    flags = shlex.split(os.environ.get("SNAKEFLAGS", ""))
    words += flags
    if slurm:
        if shutil.which("sbatch") is None:
            raise StageError("SLURM=1: there is no sbatch here; leave it out, or load Slurm")
        words += ["--executor", "slurm", "--slurm-requeue", "-j100"]
        words += ["--retries", os.environ.get("RETRIES", "5"), *_slurm_place()]
    else:
        words += [f"-j{os.environ.get('NP') or CORES}"]
    config = {"plan": plan, "python": sys.executable, "collated": collated or ""}
    words += ["--config", *(f"{key}={value}" for key, value in config.items() if value)]
    if not {"-n", "--dry-run", "--dryrun"} & set(flags):
        clear_records(plan)
    return subprocess.run(words, check=False).returncode


def _slurm_place() -> list[str]:
    """Options of Snakemake for PARTITION, ACCOUNT, and NODES and MINUTES of the solver."""
    env = os.environ
    place = {"slurm_partition": env.get("PARTITION"), "slurm_account": env.get("ACCOUNT")}
    solver = {"nodes": env.get("NODES"), "runtime": env.get("MINUTES")}
    default = [f"{key}={value}" for key, value in place.items() if value]
    of_solver = [f"solve:{key}={value}" for key, value in solver.items() if value]
    return (["--default-resources", *default] if default else []) + (
        ["--set-resources", *of_solver] if of_solver else []
    )


def _call(words: list[str] | None) -> None:
    """Run a command; a value of make that it does not use is an error."""
    command: Callable[..., Any]
    try:
        command, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise StageError(" ".join(str(error).split())) from None
    working()
    slurm = bool(bound.arguments.get("slurm"))
    used = {name for hint in _hints(command) for name in hint.env_var or ()}
    used |= {"NP", "SNAKEFLAGS"} if slurm or command in (study, tradeoff) else set()
    used |= SLURM_VALUES if slurm else set()
    typed = [name for name in os.environ.get("TYPED", "").split() if name in MAKE_VALUES]
    if command is not target and (unused := [name for name in typed if name not in used]):
        remedy = "add SLURM=1" if set(unused) <= SLURM_VALUES and "SLURM" in used else "omit it"
        raise StageError(f"{command.__name__} does not use {' and '.join(unused)}; {remedy}")
    command(*bound.args, **bound.kwargs)


def _hints(command: Callable[..., Any]) -> list[Parameter]:
    """The Parameter of each argument of a command."""
    hints = getattr(command, "__annotations__", {}).values()
    return [note for hint in hints for note in getattr(hint, "__metadata__", ())]


def main(words: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    importing()
    # only make's own, which passes omitted values as empty ones
    for name in [*MAKE_VALUES, "TYPED"]:
        if "MAKELEVEL" not in os.environ or not os.environ.get(name):
            os.environ.pop(name, None)

    def action() -> int:
        _call(words)
        return 0

    return guarded("", action, strict=True)


if __name__ == "__main__":
    sys.exit(main())
