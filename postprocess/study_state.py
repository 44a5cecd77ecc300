"""Whether the results of a study's run are those that its plan asks for: all there, and made with the plan's numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py

from piv.json_file import flat, parse_json
from postprocess.stagefiles import StageFiles

MAY_GO = "images"  # large, and nothing but PIV reads them
AGAIN = "delete it and run the study again"


def files_of(row: dict[str, Any]) -> StageFiles:
    """Where the results of one run of a plan lie."""
    return StageFiles(Path(row["folder"]), row["level"])


def unfinished(plan: dict[str, Any], row: dict[str, Any]) -> str | None:
    """Why a run's results are not those that the plan asks for; None where they are.

    A job that fails takes its own result away but not what was made of it before: so every file up to the last stage
    must be there, and where a file says what it was made with, that must be what the plan says.
    """
    out = files_of(row).out
    for stage in row["stages"]:
        path = out / plan["files"][stage]
        if not path.exists():
            if stage == MAY_GO and stage != row["stages"][-1]:
                continue
            return f"{plan['files'][stage]} is not there"
        changed = differing(row["settings"].get(stage, {}), made_with(path))
        if changed:
            return f"{plan['files'][stage]} was made with another {changed}"
    return None


def missing_runs(plan: dict[str, Any]) -> dict[str, str]:
    """By name the runs whose results are not those that the plan asks for, and why."""
    reasons = {row["run"]: unfinished(plan, row) for row in plan["runs"]}
    return {run: why for run, why in reasons.items() if why is not None}


def missing_sentence(missing: dict[str, str], total: int, command: str) -> str:
    """What is missing of `total` runs, and what to do: `command` makes them."""
    said = "; ".join(f"{run}: {why}" for run, why in missing.items())
    return f"{len(missing)} of {total} runs are not there as the study asks for them ({said}): run {command} to make them"


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


def differing(wanted: dict[str, Any], found: dict[str, Any]) -> str | None:
    """The first key of `wanted` that `found` has with another value; None where there is none.

    Keys are compared by their path, or by their last part where a file keeps flags in groups of its own (images).
    """
    if isinstance(found.get("files"), dict):  # by name, which differs from folder to folder
        found = found | {"files": sorted(found["files"].values())}
    had = flat(found)
    by_last = {key.rsplit(".", 1)[-1]: value for key, value in had.items()}
    for key, value in flat(wanted).items():
        was = had.get(key, by_last.get(key, value))
        if was != value:
            return f"{key} ({json.dumps(was)}, not {json.dumps(value)})"
    return None
