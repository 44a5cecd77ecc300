"""A study: runs of a table, each a scene that extends another and says only what differs.

Command: python -m pipeline plan cases/single_finger/studies/tradeoff.csv (what the Snakefile does first)
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from fileio.atomic import update_text
from fileio.errors import StageError
from fileio.formats.records import STUDY_PLAN
from fileio.provenance import digest, versions
from fileio.stages import FEA, STAGES, Stage, until
from pipeline.openfoam.base_case import templates_digest
from pipeline.openfoam.environment import foam_version
from pipeline.scene.read_toml import FILE_KEYS
from pipeline.scene.scene import Scene, load_scene
from pipeline.stage_settings import settings_of, update_settings
from pipeline.study.estimate import estimates
from pipeline.study.outcome import NAME as OUTCOME
from pipeline.study.table import Row, read_study

STATES = FEA.done  # of a run whose bending is analysed first
ASKED = "asked.json"  # of a run that may fail: what its outcome depends on


def parent_of(scene: Path, row: Row) -> Path:
    """Folder of the scene that a row varies."""
    return Path(os.path.normpath(scene / row.scene)) if row.scene else scene


def folder_of(scene: Path, study: str, row: Row) -> Path:
    """Folder of a run's own scene.

    A row that names a scene and changes nothing of it runs where that scene itself does; any other beneath the study.
    """
    if row.scene and not row.overrides:
        return parent_of(scene, row)
    return scene / "out" / "studies" / study / row.run


def scene_text(parent: str, row: Row) -> str:
    """The scene.toml of one run: `parent` is the folder of the scene that it extends, relative to its own."""
    overrides = dict(row.overrides)
    if needs_fea(row):
        overrides.setdefault("motion.source", "fea")
        overrides["motion.states"] = STATES
    lines = [f"extends = {json.dumps(parent)}", "", f"[levels.{row.level}]"]
    lines += [f"{key} = {toml(value)}" for key, value in sorted(overrides.items())]
    return "\n".join(lines) + "\n"


def toml(value: Any) -> str:
    """A cell's value as TOML: JSON's text, but for tables (a stroke), which take = for a colon."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def needs_fea(row: Row) -> bool:
    """Whether the run bends another finger than its scene's, so that its states must be computed first."""
    return row.until == "fea" or any(
        key.split(".")[0] in ("actuator", "fea") for key in row.overrides
    )


def write_scene(scene: Path, study: str, row: Row) -> Path:
    """Write a run's scene.toml where its text changed, and the way to the findings of its scene; returns its folder."""
    folder, parent = folder_of(scene, study, row), parent_of(scene, row)
    if folder == parent:
        if needs_fea(row):
            raise StageError(
                f"run {row.run}: until = 'fea' would write over the states of {parent}; leave the cell scene empty"
            )
        return folder
    update_text(folder / "scene.toml", scene_text(os.path.relpath(parent, folder), row))
    reference = folder / "reference"
    if (parent / "reference").is_dir() and not reference.exists():
        reference.symlink_to(os.path.relpath(parent / "reference", folder))
    return folder


def write_scenes(scene: Path, study: str, rows: list[Row]) -> list[Scene | StageError]:
    """Write each run's scene and stage settings; of one that may fail and is refused, why."""
    scenes: list[Scene | StageError] = []
    for row in rows:
        folder = write_scene(scene, study, row)
        try:
            loaded = load_scene(folder, row.level)
        except StageError as error:
            if not row.may_fail:
                raise StageError(f"run {row.run}: {error}") from None
            scenes.append(error)
            continue
        # refused while another make is at work there with other numbers, or where the states are another actuator's
        try:
            update_settings(loaded, quiet=True, fea_follows=needs_fea(row))
        except StageError as error:
            raise StageError(f"run {row.run}: {error}") from None
        scenes.append(loaded)
    return scenes


def write_asked(folder: Path, level: str, scene: Scene | StageError) -> None:
    """Note what the outcome of a run that may fail depends on, where it changed: the scene, the base case, and what computes."""
    asked = {
        "scene": scene.digest() if isinstance(scene, Scene) else str(scene),
        "templates": templates_digest(),
        "versions": {"OpenFOAM": foam_version()} | versions(),
    }
    update_text(folder / "out" / level / ASKED, json.dumps(asked, indent=1) + "\n")


def owners(rows: list[Row], scenes: list[Scene | StageError]) -> list[dict[str, str]]:
    """For each run the run that computes each of its stages: the first with the same settings up to that stage.

    A run that may fail shares nothing: how it ended is its own.
    """
    first: dict[str, str] = {}
    stage_owners: list[dict[str, str]] = []
    for row, scene in zip(rows, scenes, strict=True):
        if row.may_fail or not isinstance(scene, Scene):
            stage_owners.append({})
            continue
        begin = row.run if needs_fea(row) else ""
        keys: dict[str, str] = {}
        for stage in (stage for stage in STAGES if stage.shared):
            before = [keys[name] for name in stage.inputs] or begin
            more = [getattr(row, column) for column in stage.columns]
            keys[stage.name] = digest([stage.name, before, _settings(scene, stage), more])
        stage_owners.append({name: first.setdefault(key, row.run) for name, key in keys.items()})
    return stage_owners


def wanted_of(row: Row) -> list[str]:
    """Files that a run is to leave behind, relative to its folder: one of every stage, for what is lost on the way must not
    pass for made, but for the images of a PIV that is done; the outcome alone of a run that may fail."""
    out = f"out/{row.level}"
    if row.may_fail:
        return [f"{out}/{OUTCOME}"]
    if row.until == "fea":
        return [STATES]
    return [
        f"{out}/{stage.done}"
        for stage in until(row.until)
        if not stage.temporary or stage.name == row.until
    ]


def settings_by_stage(scene: Scene, stages: list[Stage]) -> dict[str, dict[str, Any]]:
    """By stage the numbers that its result is to be made with, without names of files."""
    given = {stage.name: _settings(scene, stage) for stage in stages if stage.shared}
    return {stage: settings for stage, settings in given.items() if settings}


def _settings(scene: Scene, stage: Stage) -> dict[str, Any]:
    return _without_names(settings_of(scene, stage.target)) if stage.sections else {}


def _without_names(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings with the digests of the files that they name, but not the names: those differ from folder to folder."""
    if "files" not in settings:
        return settings
    motion = {key: value for key, value in settings["motion"].items() if key not in FILE_KEYS}
    return settings | {"motion": motion, "files": sorted(settings["files"].values())}


def plan(table: Path, scene: Path | None = None) -> Path:
    """Read the study, write its scenes and `plan.json` (docs/formats.md); returns the plan's path."""
    return write_plan(scene or table.parent.parent, table.stem, read_study(table))


def plan_run(scene: Path, level: str, ranks: int) -> Path:
    """The plan of one scene as it is, to its report; returns its path."""
    row = Row(scene.name, level, ranks, until="report", scene=".")
    return write_plan(scene, f"run_{level}", [row])


def write_plan(home: Path, study: str, rows: list[Row]) -> Path:
    """Write the scenes and the plan of a study of the scene `home`."""
    scenes = write_scenes(home, study, rows)
    runs = []
    for row, loaded, mine in zip(rows, scenes, owners(rows, scenes), strict=True):
        folder = folder_of(home, study, row)
        stages = [] if row.may_fail else until(row.until)
        if row.may_fail:
            write_asked(folder, row.level, loaded)
        runs.append(
            {
                "run": row.run,
                "scene": str(parent_of(home, row)),
                "level": row.level,
                "ranks": row.ranks,
                "until": row.until,
                "piv_chunks": row.piv_chunks,
                "may_fail": row.may_fail,
                "fea": needs_fea(row),
                "overrides": row.overrides,
                "folder": str(folder),
                "owners": mine,
                "wanted": wanted_of(row),
                "stages": [stage.name for stage in stages],
                "settings": settings_by_stage(loaded, stages) if isinstance(loaded, Scene) else {},
                "estimates": estimates(loaded, row.ranks, parent_of(home, row))
                if isinstance(loaded, Scene)
                else {},
            }
        )
    _one_place_each(runs)
    path = home / "out" / "studies" / study / "plan.json"
    content = {"scene": home.name, "folder": str(home), "study": study, "files": {stage.name: stage.done for stage in STAGES}, "runs": runs}  # fmt: skip
    STUDY_PLAN.write(path, content)
    return path


def _one_place_each(runs: list[dict[str, Any]]) -> None:
    """StageError where two rows would write into the same folder."""
    seen: dict[tuple[str, str], str] = {}
    for run in runs:
        place = run["folder"], run["level"]
        if place in seen:
            raise StageError(
                f"runs {seen[place]} and {run['run']}: both are {place[0]} at level {place[1]}; remove one"
            )
        seen[place] = run["run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `plan`."""
    parser.add_argument("table", type=Path, nargs="?", help="study table (.csv)")
    parser.add_argument(
        "--scene", type=Path, help="folder of the scene (default: that of the table)"
    )
    parser.add_argument(
        "--run", type=Path, metavar="SCENE", help="one scene to its report, in place of a table"
    )
    parser.add_argument("--level", default="coarse", help="with --run (default: %(default)s)")
    parser.add_argument("--ranks", type=int, default=1, help="with --run (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def run(args: argparse.Namespace) -> None:
    """Command `plan`."""
    if (args.table is None) == (args.run is None):
        raise StageError("plan: give either a study table or --run SCENE")
    path = plan_run(args.run, args.level, args.ranks) if args.run else plan(args.table, args.scene)
    if not args.quiet:
        print(path)
