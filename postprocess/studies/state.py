"""Whether a study's runs are finished: all files are there, made with the plan's numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
from fileio.stages import STAGES

from fileio.json_text import flat, given, parse_json
from postprocess.evidence.stage_files import StageFiles

_UNRECORDED = {"images": {"truth"}}  # a file beside the images changes nothing of them
# Stages that record the scene's sections and nothing else.
_SECTIONS = [stage.name for stage in STAGES if stage.sections and stage.shared and not stage.piv]
# Names of files, which differ from folder to folder.
UNASKED = {f"motion.{key}" for key in ("states", "recording", "shapes", "pressure_csv", "path_csv")}
_AGAIN = "delete it and run the study again"


def files_of(row: dict[str, Any]) -> StageFiles:
    """Where the results of one run of a plan lie."""
    return StageFiles(Path(row["folder"]), row["level"])


def unfinished(plan: dict[str, Any], row: dict[str, Any]) -> str | None:
    """Why a run's results are not those that the plan asks for; None where they are.

    A failed job removes its own result but not what was made of it before, so every file is
    looked for, and its record is compared with the plan where it has one.
    """
    for name in row["wanted"]:
        if not (Path(row["folder"]) / name).exists():
            return f"{name.removeprefix('out/' + row['level'] + '/')} is not there"
    for stage in row["stages"]:
        path = files_of(row).out / plan["files"][stage]
        if not path.exists():  # images may be deleted when PIV is done
            continue
        changed = differing(stage, row["settings"].get(stage, {}), _made_with(path))
        if changed:
            return f"{plan['files'][stage]} was made with another {changed}; {_AGAIN}"
    return None


def missing_runs(plan: dict[str, Any]) -> dict[str, str]:
    """The unfinished runs by name, and why each is."""
    reasons = {row["run"]: unfinished(plan, row) for row in plan["runs"]}
    return {run: why for run, why in reasons.items() if why is not None}


def missing_sentence(missing: dict[str, str], total: int, command: str) -> str:
    """Which of `total` runs are missing, and the `command` that makes them."""
    reasons = "; ".join(f"{run}: {why}" for run, why in missing.items())
    return (
        f"{len(missing)} of {total} runs are not there as the study asks for them ({reasons}):"
        f" run {command} to make them"
    )


def _made_with(path: Path) -> dict[str, Any]:
    """The settings that a result records, if any; ValueError where it cannot be read."""
    text: str | bytes = "{}"
    try:
        if path.suffix == ".h5":
            with h5py.File(path, "r") as file:
                text = file.attrs.get("settings", text)
        if path.suffix == ".csv":
            with path.open(encoding="utf-8") as table:
                head = table.readline()
            if head.startswith("# {"):
                text = parse_json(head[1:], f"{path}: first line", _AGAIN).get("settings", text)
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not readable ({error}); {_AGAIN}") from error
    return parse_json(text, f"{path}: settings", _AGAIN)


def differing(stage: str, wanted: dict[str, Any], recorded: dict[str, Any]) -> str | None:
    """The first key in which a result's record is not what is `wanted`; None where there is none.

    Keys are compared by path; those of images, which are recorded in groups, by their last part.
    """
    if isinstance(recorded.get("files"), dict):  # digests by name of file
        recorded = recorded | {"files": sorted(recorded["files"].values())}
    values = given if stage in _SECTIONS else flat
    had, asked = values(recorded), values(wanted)
    if stage == "images":
        had = {key.rsplit(".", 1)[-1]: value for key, value in had.items()}
    for key, value in asked.items():
        if key not in had and key not in _UNRECORDED.get(stage, ()):
            return f"{key} (none is recorded, not {json.dumps(value)})"
        if had.get(key, value) != value:
            return f"{key} ({json.dumps(had[key])}, not {json.dumps(value)})"
    if stage in _SECTIONS:  # the plan leaves out some keys at their default
        for key in sorted(had.keys() - asked.keys() - UNASKED):
            return f"{key} ({json.dumps(had[key])}, which the plan does not ask for)"
    return None
