"""A study: a table of runs of one scene, each a scene of its own that extends it and says only what differs.

Command: python -m pipeline.study cases/single_finger/studies/tradeoff.csv (what the Snakefile does first)
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.errors import StageError
from pipeline.estimate import estimates
from pipeline.scene import Scene, digest, load_scene, write_settings
from pipeline.stage import guarded, write_text

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
LAST = ("fea", *BEFORE, "vortices", "compare", "report")
OWN_COLUMNS = {"run", "level", "ranks", "until", "piv_chunks"}


@dataclass(frozen=True)
class Row:
    """One run of a study: `overrides` are dotted keys of the scene; `until` is the last stage wanted."""

    run: str
    level: str
    ranks: int = 1
    until: str = "vortices"
    piv_chunks: int = 1
    overrides: dict[str, Any] = field(default_factory=dict)


def read_study(path: Path) -> list[Row]:
    """Rows of a study table (docs/formats.md). Raises StageError with file, row and key."""
    try:
        text = path.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError):
        raise StageError(
            f"{path}: no such study; give a table, as cases/single_finger/studies/tradeoff.csv"
        ) from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(lines, skipinitialspace=True)
    unknown = [
        c for c in reader.fieldnames or () if c not in OWN_COLUMNS and not re.fullmatch(r"\w+(\.\w+)+", c)
    ]
    if "run" not in (reader.fieldnames or ()) or unknown:
        raise StageError(
            f"{path}: column {(unknown or ['run'])[0]!r}: the header must be run, level, ranks, until, piv_chunks"
            " and dotted keys of the scene, as numerics.time_step"
        )
    rows = [_row(path, record) for record in reader]
    names = [row.run for row in rows]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice or not rows:
        raise StageError(
            f"{path}: " + (f"run {twice!r} occurs twice; rename one" if twice else "no rows; add runs")
        )
    return rows


def _row(path: Path, record: dict[str, str | None]) -> Row:
    given = {key: value.strip() for key, value in record.items() if key and value and value.strip()}
    name = given.get("run", "")
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise StageError(f"{path}: run = {name!r}: give a name of letters, digits, '_', '-' and '.'")
    counts = {}
    for key in ("ranks", "piv_chunks"):
        if not given.get(key, "1").isdecimal() or int(given.get(key, "1")) < 1:
            raise StageError(f"{path}: run {name}: {key} = {given[key]!r}: give a whole number, 1 or more")
        counts[key] = int(given.get(key, "1"))
    until = given.get("until", "vortices")
    if until not in LAST:
        raise StageError(f"{path}: run {name}: until = {until!r}: give one of {', '.join(LAST)}")
    overrides = {key: parse_cell(text) for key, text in given.items() if key not in OWN_COLUMNS}
    return Row(name, given.get("level", "coarse"), until=until, overrides=overrides, **counts)


def parse_cell(text: str) -> Any:
    """A cell as JSON where it is (numbers, true, lists), as text otherwise."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def scene_text(parent: str, row: Row) -> str:
    """The scene.toml of one run: `parent` is the folder of the scene that it extends, relative to its own."""
    overrides = dict(row.overrides)
    if needs_fea(row):
        overrides.setdefault("motion.source", "fea")
        overrides["motion.states"] = "kinematics/states.h5"
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


def write_scenes(scene: Path, study: str, rows: list[Row]) -> list[Scene]:
    """Write `<scene>/out/studies/<study>/<run>/scene.toml` where its text changed, and each run's stage settings."""
    scenes = []
    for row in rows:
        folder = scene / "out" / "studies" / study / row.run
        path, text = folder / "scene.toml", scene_text(os.path.relpath(scene, folder), row)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            write_text(path, text)
        reference = folder / "reference"
        if (scene / "reference").is_dir() and not reference.exists():
            reference.symlink_to(os.path.relpath(scene / "reference", folder))
        try:
            loaded = load_scene(folder, row.level)
        except StageError as error:
            raise StageError(f"run {row.run}: {error}") from None
        write_settings(loaded)
        scenes.append(loaded)
    return scenes


def owners(rows: list[Row], scenes: list[Scene]) -> list[dict[str, str]]:
    """For each run the run that computes each of its stages: the first with the same settings up to that stage."""
    first: dict[str, str] = {}
    found = []
    for row, scene in zip(rows, scenes, strict=True):
        keys: dict[str | None, Any] = {None: row.run if needs_fea(row) else ""}
        mine = {}
        for stage, before in BEFORE.items():
            name = "vortices" if stage.startswith("vortices") else stage
            own = scene.settings(name) if name != "run" else {}
            more = row.ranks if stage == "case" else row.piv_chunks if stage == "piv" else None
            keys[stage] = digest([stage, keys[before], own, more])
            mine[stage] = first.setdefault(str(keys[stage]), row.run)
        # a case is shared with its run or not at all
        found.append(mine)
    return found


def plan(table: Path, scene: Path | None = None) -> Path:
    """Read the study, write its scenes and `plan.json` (docs/formats.md); returns the plan's path."""
    rows = read_study(table)
    folder = scene or table.parent.parent
    study = table.stem
    scenes = write_scenes(folder, study, rows)
    runs = [
        {
            "run": row.run,
            "level": row.level,
            "ranks": row.ranks,
            "until": row.until,
            "piv_chunks": row.piv_chunks,
            "fea": needs_fea(row),
            "overrides": row.overrides,
            "folder": str(loaded.folder),
            "owners": mine,
            "estimates": estimates(loaded, row.ranks, folder),
        }
        for row, loaded, mine in zip(rows, scenes, owners(rows, scenes), strict=True)
    ]
    path = folder / "out" / "studies" / study / "plan.json"
    content = {"format": "study-plan", "format_version": 1, "scene": folder.name, "folder": str(folder),
               "study": study, "runs": runs}  # fmt: skip
    write_text(path, json.dumps(content, indent=1) + "\n")
    return path


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.study", description=__doc__)
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
