"""Whether the results of a study's run are those that its plan asks for: all there, and made with the plan's numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py

from fileio.json_text import flat, given, parse_json
from fileio.stages import STAGES
from postprocess.evidence.stage_files import StageFiles

UNRECORDED = {
    "images": {"truth"}
}  # whether there is a file beside the images: it changes nothing of them
# record the scene's sections and nothing but
SECTIONS = [stage.name for stage in STAGES if stage.sections and stage.shared and not stage.piv]
# names of files
UNASKED = {f"motion.{key}" for key in ("states", "recording", "shapes", "pressure_csv", "path_csv")}
AGAIN = "delete it and run the study again"


def files_of(row: dict[str, Any]) -> StageFiles:
    """Where the results of one run of a plan lie."""
    return StageFiles(Path(row["folder"]), row["level"])


def unfinished(plan: dict[str, Any], row: dict[str, Any]) -> str | None:
    """Why a run's results are not those that the plan asks for; None where they are.

    A job that fails takes its own result away but not what was made of it before: so every file that is wanted of the run
    must be there, and where a stage's file says what it was made with, that must be what the plan says. Of a bending
    analysis and of the outcome of a run that may fail only the file is looked for.
    """
    for name in row["wanted"]:
        if not (Path(row["folder"]) / name).exists():
            return f"{name.removeprefix('out/' + row['level'] + '/')} is not there"
    for stage in row["stages"]:
        path = files_of(row).out / plan["files"][stage]
        if not path.exists():  # and is not wanted: images of a PIV that is done
            continue
        changed = differing(stage, row["settings"].get(stage, {}), made_with(path))
        if changed:
            return f"{plan['files'][stage]} was made with another {changed}; {AGAIN}"
    return None


def missing_runs(plan: dict[str, Any]) -> dict[str, str]:
    """By name the runs whose results are not those that the plan asks for, and why."""
    reasons = {row["run"]: unfinished(plan, row) for row in plan["runs"]}
    return {run: why for run, why in reasons.items() if why is not None}


def missing_sentence(missing: dict[str, str], total: int, command: str) -> str:
    """What is missing of `total` runs, and what to do: `command` makes them."""
    reasons_listed = "; ".join(f"{run}: {why}" for run, why in missing.items())
    return f"{len(missing)} of {total} runs are not there as the study asks for them ({reasons_listed}): run {command} to make them"


def made_with(path: Path) -> dict[str, Any]:
    """The settings that a result records; empty where it records none. ValueError where it cannot be read."""
    text: str | bytes = "{}"
    try:
        if path.suffix == ".h5":
            with h5py.File(path, "r") as file:
                text = file.attrs.get("settings", text)
        if path.suffix == ".csv":
            with path.open(encoding="utf-8") as table:
                head = table.readline()
            if head.startswith("# {"):
                text = parse_json(head[1:], f"{path}: first line", AGAIN).get("settings", text)
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not readable ({error}); {AGAIN}") from error
    return parse_json(text, f"{path}: settings", AGAIN)


def differing(stage: str, wanted: dict[str, Any], recorded: dict[str, Any]) -> str | None:
    """The first key in which what a stage's result was made with is not what is `wanted`; None where there is none.

    Keys are compared by their path; those of images by their last part, for they are recorded in groups.
    """
    if isinstance(recorded.get("files"), dict):  # by name, which differs from folder to folder
        recorded = recorded | {"files": sorted(recorded["files"].values())}
    values = given if stage in SECTIONS else flat
    had, asked = values(recorded), values(wanted)
    if stage == "images":
        had = {key.rsplit(".", 1)[-1]: value for key, value in had.items()}
    for key, value in asked.items():
        if key not in had and key not in UNRECORDED.get(stage, ()):
            return f"{key} (none is recorded, not {json.dumps(value)})"
        if had.get(key, value) != value:
            return f"{key} ({json.dumps(had[key])}, not {json.dumps(value)})"
    if stage in SECTIONS:  # the plan leaves out some keys that have their default
        for key in sorted(had.keys() - asked.keys() - UNASKED):
            return f"{key} ({json.dumps(had[key])}, which the plan does not ask for)"
    return None
