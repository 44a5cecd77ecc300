"""A study: runs of a table, each a scene that extends another and says only what differs.

Command: python -m pipeline.study.plan cases/single_finger/studies/tradeoff.csv (what the Snakefile does first)
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.command import guarded
from fileio.errors import StageError
from fileio.provenance import digest, versions
from pipeline.openfoam.base_case import templates_digest
from pipeline.openfoam.environment import foam_version
from pipeline.scene.read_toml import FILE_KEYS
from pipeline.scene.scene import Scene, load_scene
from pipeline.stage_settings import run as write_settings
from pipeline.stage_settings import settings_of
from pipeline.study.estimate import estimates
from pipeline.study.outcome import NAME as ENDING
from pipeline.study.table import Row, read_study

# What each stage is made from, besides its own settings. `ranks` belongs to the case: a run writes into its folder.
BEFORE = {
    "kinematics": None,
    "mesh": "kinematics",
    "case": "mesh",
    "run": "case",
    "sheet": "run",
    "images": "sheet",
    "piv": "images",
    "vortices_cfd": "sheet",
    "vortices_piv": "piv",
}
# What each stage leaves behind when it is done.
RESULT = {
    "kinematics": "kinematics.h5",
    "mesh": "planform.h5",
    "case": "sweep.h5",
    "run": "run/run.json",
    "sheet": "sheet.h5",
    "images": "images.h5",
    "piv": "piv.h5",
    "vortices_cfd": "vortices_cfd.csv",
    "vortices_piv": "vortices_piv.csv",
    "compare": "comparison.json",
    "report": "report.html",
}
MAY_GO = "images"  # large, and nothing but PIV reads them
STATES = "kinematics/states.h5"  # of a run whose bending is analysed first
ASKED = "asked.json"  # of a run that may fail: what its ending depends on


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
    return row.until == "fea" or any(key.split(".")[0] in ("actuator", "fea") for key in row.overrides)


def write_scene(scene: Path, study: str, row: Row) -> Path:
    """Write a run's scene.toml where its text changed, and the way to the findings of its scene; returns its folder."""
    folder, parent = folder_of(scene, study, row), parent_of(scene, row)
    if folder == parent:
        if needs_fea(row):
            raise StageError(
                f"run {row.run}: until = 'fea' would write over the states of {parent}; leave the cell scene empty"
            )
        return folder
    path, text = folder / "scene.toml", scene_text(os.path.relpath(parent, folder), row)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    reference = folder / "reference"
    if (parent / "reference").is_dir() and not reference.exists():
        reference.symlink_to(os.path.relpath(parent / "reference", folder))
    return folder


def write_scenes(scene: Path, study: str, rows: list[Row]) -> list[Scene | StageError]:
    """Write each run's scene and stage settings; of one that may fail and is refused, why."""
    found: list[Scene | StageError] = []
    for row in rows:
        folder = write_scene(scene, study, row)
        try:
            loaded = load_scene(folder, row.level)
        except StageError as error:
            if not row.may_fail:
                raise StageError(f"run {row.run}: {error}") from None
            found.append(error)
            continue
        # refused while another make is at work there with other numbers, or where the states are another actuator's
        try:
            write_settings(loaded, quiet=True, fea_follows=needs_fea(row))
        except StageError as error:
            raise StageError(f"run {row.run}: {error}") from None
        found.append(loaded)
    return found


def write_asked(folder: Path, level: str, scene: Scene | StageError) -> None:
    """Note what the ending of a run that may fail depends on, where it changed: the scene, the base case, and what computes."""
    asked = {
        "scene": scene.digest() if isinstance(scene, Scene) else str(scene),
        "templates": templates_digest(),
        "versions": {"OpenFOAM": foam_version()} | versions(),
    }
    path, text = folder / "out" / level / ASKED, json.dumps(asked, indent=1) + "\n"
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def owners(rows: list[Row], scenes: list[Scene | StageError]) -> list[dict[str, str]]:
    """For each run the run that computes each of its stages: the first with the same settings up to that stage.

    A run that may fail shares nothing: how it ended is its own.
    """
    first: dict[str, str] = {}
    found: list[dict[str, str]] = []
    for row, scene in zip(rows, scenes, strict=True):
        if row.may_fail or not isinstance(scene, Scene):
            found.append({})
            continue
        keys: dict[str | None, Any] = {None: row.run if needs_fea(row) else ""}
        mine = {}
        for stage, before in BEFORE.items():
            name = "vortices" if stage.startswith("vortices") else stage
            own = _without_names(settings_of(scene, name)) if name != "run" else {}
            more = row.ranks if stage == "case" else row.piv_chunks if stage == "piv" else None
            keys[stage] = digest([stage, keys[before], own, more])
            mine[stage] = first.setdefault(str(keys[stage]), row.run)
        # a case is shared with its run or not at all
        found.append(mine)
    return found


def stages_until(last: str) -> list[str]:
    """Stages up to `last` (a cell `until`), each after those that it is made from; none of a bending analysis."""
    if last == "fea":
        return []
    both = ["vortices_cfd", "vortices_piv"]
    wanted = both if last in ("vortices", "compare", "report") else [last]
    needed: list[str] = []
    for stage in wanted:
        chain: list[str] = []
        at: str | None = stage
        while at is not None:
            chain.insert(0, at)
            at = BEFORE[at]
        needed += [name for name in chain if name not in needed]
    return needed + {"compare": ["compare"], "report": ["compare", "report"]}.get(last, [])


def wanted_of(row: Row) -> list[str]:
    """Files that a run is to leave behind, relative to its folder: one of every stage, for what is lost on the way must not
    pass for made, but for the images of a PIV that is done; the ending alone of a run that may fail."""
    out = f"out/{row.level}"
    if row.may_fail:
        return [f"{out}/{ENDING}"]
    if row.until == "fea":
        return [STATES]
    stages = stages_until(row.until)
    return [f"{out}/{RESULT[stage]}" for stage in stages if stage != MAY_GO or stage == row.until]


def settings_by_stage(scene: Scene, stages: list[str]) -> dict[str, dict[str, Any]]:
    """By stage the numbers that its result is to be made with, without names of files."""
    names = {stage: "vortices" if stage.startswith("vortices") else stage for stage in stages}
    given = {stage: _without_names(settings_of(scene, names[stage])) for stage in stages if stage in BEFORE}
    return {stage: settings for stage, settings in given.items() if settings}


def _without_names(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings with the digests of the files that they name, but not the names: those differ from folder to folder."""
    if "files" not in settings:
        return settings
    motion = {key: value for key, value in settings["motion"].items() if key not in FILE_KEYS}
    return settings | {"motion": motion, "files": sorted(settings["files"].values())}


def plan(table: Path, scene: Path | None = None) -> Path:
    """Read the study, write its scenes and `plan.json` (docs/formats.md); returns the plan's path."""
    rows = read_study(table)
    home = scene or table.parent.parent
    study = table.stem
    scenes = write_scenes(home, study, rows)
    runs = []
    for row, loaded, mine in zip(rows, scenes, owners(rows, scenes), strict=True):
        folder = folder_of(home, study, row)
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
                "stages": [] if row.may_fail else stages_until(row.until),
                "settings": settings_by_stage(loaded, stages_until(row.until))
                if isinstance(loaded, Scene) and not row.may_fail
                else {},
                "estimates": estimates(loaded, row.ranks, parent_of(home, row))
                if isinstance(loaded, Scene)
                else {},
            }
        )
    _one_place_each(runs)
    path = home / "out" / "studies" / study / "plan.json"
    content = {"format": "study-plan", "format_version": 4, "scene": home.name, "folder": str(home),
               "study": study, "files": RESULT, "runs": runs}  # fmt: skip
    write_text(path, json.dumps(content, indent=1) + "\n")
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


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.study.plan", description=__doc__)
    parser.add_argument("table", type=Path, help="study table (.csv)")
    parser.add_argument(
        "--scene", type=Path, help="folder of the scene (default: the one that the table lies in)"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    args = parser.parse_args()

    def action() -> None:
        path = plan(args.table, args.scene)
        if not args.quiet:
            print(path)

    guarded("study", action)


if __name__ == "__main__":
    main()
