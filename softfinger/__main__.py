"""The program `softfinger`: runs of a scene and their results."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from piv.files import __version__
from piv.files.command import guarded, importing, working
from piv.files.errors import StageError
from softfinger.identify import identify
from softfinger.options import (
    CORES,
    DEFAULT_RANKS,
    Coupled,
    Filmed,
    Level,
    Overrides,
    Quiet,
    RankCount,
    SceneFolder,
    Slurm,
    SnakemakeFlags,
    Switch,
    open_moved,
    open_session,
)
from softfinger.show import figures, view
from softfinger.study.command import job, plot, schedule, study, tradeoff

# values that make hands on by the environment
MAKE_VALUES = ("LEVEL", "NP", "COUPLED", "PIV", "ACCURACY", "BUDGET", "SLURM", "DPIV")

_UNTIL = "Last stage: see softfinger stages; with --accuracy: when it no longer counts, as 0.2s."
app = App(
    "softfinger", help=__doc__, version=__version__, default_parameter=Parameter(show_env_var=False)
)
app.command(figures)
app.command(identify)
app.command(view)
app.command(study)
app.command(plot)
app.command(tradeoff)
app.command(job, show=False)


@app.command
def run(
    scene: SceneFolder,
    *,
    until: Annotated[str, Parameter(help=_UNTIL)] = "report",
    level: Level = "coarse",
    set_: Overrides = [],  # noqa: B006
    name: Annotated[str, Parameter(help="Folder of the results of a run with --set.")] = "",
    ranks: RankCount = DEFAULT_RANKS,
    hosts: Annotated[Path | None, Parameter(help="MPI host file.")] = None,
    coupled: Coupled = None,
    piv: Filmed = None,
    accuracy: Annotated[str, Parameter(env_var="ACCURACY", help="Largest error, as 12%.")] = "",
    budget: Annotated[str, Parameter(env_var="BUDGET", help="Longest time, as 10min.")] = "",
    slurm: Slurm = False,
    snakemake: SnakemakeFlags = "",
    dry_run: Switch = False,
    quiet: Quiet = False,
) -> None:
    """Make the stale results of a scene, up to a stage.

    Parameters
    ----------
    coupled
        Pressure and water make the motion together, or it is prescribed; absent: as the scene.
    piv
        A virtual camera films the flow for PIV, or the page is of the flow alone.
    dry_run
        Print what would be made and why; make nothing.
    """
    from pipeline.runs.estimate import duration, estimate
    from pipeline.runs.stages import TARGETS
    from pipeline.scene.predicted import predicted
    from softfinger.make import Machine, make

    part = until if (accuracy or budget) and until not in TARGETS else ""  # of the stroke
    until = "report" if part else until
    machine = Machine(ranks, min(ranks, CORES), hosts)
    moved = coupled is not None or piv is not None
    chosen: dict[str, Any] = {"PIV" if coupled is None else "COUPLED": moved, "SLURM": slurm}
    chosen |= {"ACCURACY": accuracy, "BUDGET": budget}
    modes = [name for name, value in chosen.items() if value]
    others = {" and ".join(modes[1:]): len(modes) > 1, "--set": bool(set_), "--name": bool(name)}
    others |= {"--hosts": hosts is not None}
    others |= {"LEVEL, which it chooses": bool(accuracy or budget) and level != "coarse"}
    if not moved:  # else it is one run of its own
        others |= {"one stage": until != "report", "--dry-run": dry_run}
    if modes and (other := next((name for name, value in others.items() if value), "")):
        raise StageError(f"{modes[0]} goes with a whole scene, not with {other}")
    if accuracy or budget:
        from softfinger.study.accuracy import make_cheapest

        made = make_cheapest(scene, accuracy, budget, part, machine, quiet)
    elif slurm:
        from softfinger.study.plan import plan_scene

        if code := schedule(plan_scene(scene, level, ranks), slurm, snakemake):
            raise SystemExit(code)
        made = open_session(scene, level)
    else:
        made = (
            open_session(scene, level, set_, name)
            if not moved
            else open_moved(scene, level, coupled, piv)
        )
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

    made = open_session(scene, level) if scene else None
    for stage in STAGES:
        text = (made.why_stale(stage.name) or "made") if made else f"{stage.done:20s} {stage.about}"
        print(f"{stage.name:14s} {text}")


@app.command
def fea(
    scene: SceneFolder,
    *,
    level: Level = "coarse",
    processes: Annotated[int, Parameter(env_var="NP", help="Parallel processes.")] = 2,
    quiet: Quiet = False,
) -> None:
    """Analyse the actuator of a scene: kinematics/states.h5 beside its scene.toml."""
    from pipeline.structure.fea_stage import run as analyse

    if processes < 1:
        raise StageError(f"NP={processes}: give 1 or more")
    analyse(open_session(scene, level).scene, quiet, processes=processes)


@app.command
def new(
    folder: Annotated[Path, Parameter(help="The new scene: a name in cases/, or a folder.")],
    *,
    length: Annotated[str, Parameter(help="Of an own finger, as 50mm.")] = "",
    width: Annotated[str, Parameter(help="Of the finger, as 20mm.")] = "",
    pressure: Annotated[Path | None, Parameter(help="Table t,p (s, Pa), as p.csv.")] = None,
    tank: Annotated[str, Parameter(help="Length x height x depth, as 400x250x250 (mm).")] = "",
    thickness: Annotated[str, Parameter(help="If not the paper's 14.5 mm, as 6mm.")] = "",
    extends: Annotated[Path | None, Parameter(help="The scene that it extends.")] = None,
) -> None:
    """Write the scene.toml of an own finger in which everything fits, or a template.

    With length, width, pressure and tank, the scene extends cases/single_finger, and the file
    names what it assumes. With extends alone it holds that line; with nothing all keys.
    """
    from piv.files.atomic import write_text
    from softfinger.lengths import lengths
    from softfinger.new_scene import PARENT, Own, advice, write_scene
    from softfinger.scene_reference import scene_template

    if len(folder.parts) == 1 and Path("cases").is_dir():
        folder = Path("cases") / folder
    given = {"--length": length, "--width": width, "--pressure": pressure, "--tank": tank}
    if missing := [name for name, value in given.items() if not value]:
        if len(missing) < len(given) or thickness:
            raise StageError(f"give {' and '.join(missing)}, too: softfinger new --help")
    else:
        assert pressure is not None
        (long,), (wide,) = lengths(length, "--length", 1), lengths(width, "--width", 1)
        x, y, z = lengths(tank, "--tank", 3, "mm")
        thick = lengths(thickness, "--thickness", 1)[0] if thickness else None
        own = Own(long, wide, pressure, (x, y, z), thick)
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
    scene: SceneFolder,
    dpiv: Annotated[
        str | None, Parameter(env_var="DPIV", help="Folder of dpiv.toml; of repeats several.")
    ] = None,
    *,
    level: Level = "coarse",
    inputs: Annotated[bool, Parameter(help="Vary uncertain inputs.")] = True,
    quick: Switch = False,
    coupled: Coupled = None,
    ranks: RankCount = DEFAULT_RANKS,
    quiet: Quiet = False,
) -> None:
    """Compare a scene with the recording of a laboratory.

    Parameters
    ----------
    quick
        Compare the motion only; nothing is solved.
    coupled
        Compare the motion that pressure and water make together, or the prescribed one.
    """
    from softfinger.laboratory import compare_with
    from softfinger.make import Machine

    if dpiv is None:
        raise StageError("give DPIV=folder of dpiv.toml: docs/comparison.md")
    machine = Machine(ranks, min(ranks, CORES))
    run_ = open_moved(scene, level, coupled)
    folders = [Path(dpiv)] if Path(dpiv).exists() else [Path(part) for part in dpiv.split()]
    page = compare_with(run_, folders, machine, inputs=inputs, quick=quick, quiet=quiet)
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


# values that a recipe, or Snakemake, hands to commands in another way
_IN_RECIPES: dict[str, tuple[Callable[..., Any], ...]] = {
    "NP": (study, tradeoff),
    "SCENE": (study, tradeoff, fea, compare),
    "STUDY": (study,),
    "DOCS": (),
}


def _call(words: list[str] | None) -> None:
    """Run a command; a value of make that it does not use is an error."""
    command: Callable[..., Any]
    try:
        command, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        text = " ".join(str(error).split())
        raise StageError(text.replace(" into bool.", ": give 1 or 0")) from None
    working()
    used = {name for hint in _hints(command) for name in hint.env_var or ()}
    used |= {name for name, commands in _IN_RECIPES.items() if command in commands}
    known = (*MAKE_VALUES, *_IN_RECIPES)
    typed = [name for name in os.environ.get("TYPED", "").split() if name in known]
    if command is not target and (unused := [name for name in typed if name not in used]):
        raise StageError(f"{command.__name__} does not use {' and '.join(unused)}; omit it")
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
