"""Options that several commands share, and the run that they describe."""

import os
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from piv.files.errors import StageError

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
DEFAULT_RANKS = min(4, CORES)  # more ranks rarely pay

SceneFolder = Annotated[Path, Parameter(help="Folder of the scene, as cases/single_finger.")]
Level = Annotated[str, Parameter(env_var="LEVEL", help="Level of the scene.")]
RankCount = Annotated[int, Parameter(["--ranks", "-n"], env_var="NP", help="MPI ranks.")]
Quiet = Annotated[bool, Parameter(negative="", help="Print errors only.")]
Overrides = Annotated[
    list[str],
    Parameter(
        "--set", negative="", help="KEY=VALUE of the scene, as mesh.tip_cell=0.001; once for each."
    ),
]
Switch = Annotated[bool, Parameter(negative="")]
Coupled = Annotated[bool | None, Parameter(env_var="COUPLED", negative="--prescribed")]
Filmed = Annotated[bool | None, Parameter("--piv", env_var="PIV", negative="--no-piv")]
Slurm = Annotated[bool, Parameter(env_var="SLURM", negative="", help="As batch jobs.")]
SnakemakeFlags = Annotated[
    str, Parameter("--snakemake", help="Options of Snakemake, with --slurm and in studies.")
]


def open_session(scene: Path, level: str, values: list[str] = [], name: str = "") -> Any:  # noqa: B006
    """Open the run of a scene; one with overrides (KEY=VALUE) has a folder of its own. StageError.

    `name`: of that folder; without it, it follows from the overrides.
    """
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


def open_moved(
    scene: Path,
    level: str,
    coupled: bool | None,
    filmed: bool | None = None,
) -> Any:
    """Open the run of a scene, coupled or prescribed, with camera and PIV or without them.

    It has a folder of its own where the scene's file says otherwise. None: as the file.
    """
    from pipeline.runs.run import open_run, other_films, other_motion

    run = open_session(scene, level)
    if coupled not in (None, run.scene.coupled):
        run = open_run(scene, level, *other_motion(run.scene))
    if filmed not in (None, run.scene.filmed):
        more, out = other_films(run.scene)
        run = open_run(scene, level, dict(run.overrides) | more, out)
    return run
