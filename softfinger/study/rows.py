"""Rows of a study's table: runs that are a scene at a level with overrides."""

import csv
import json
import re
import tomllib
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.runs.stages import FEA, TARGETS
from piv.files.errors import StageError

_OWN_COLUMNS = {"run", "scene", "level", "ranks", "until", "may_fail"}


@dataclass(frozen=True)
class Row:
    """One run of a study.

    overrides: values by dotted keys of the scene; until: the last stage; scene: folder of another
    scene, relative to that of the study; may_fail: a refusal or a stop by a guard is a result.
    """

    run: str
    level: str
    ranks: int = 1
    until: str = "vortices"
    overrides: dict[str, Any] = field(default_factory=dict)
    scene: str = "."
    may_fail: bool = False


def read_study(path: Path) -> list[Row]:
    """Rows of a study table (docs/formats.md). Raises StageError with file, row and key."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise StageError(
            f"{path}: no such study; give a table, as cases/single_finger/studies/tradeoff.csv"
        ) from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(lines, skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = header
    if twice := next((name for name in header if header.count(name) > 1), None):
        raise StageError(f"{path}: column {twice!r} occurs twice; remove one")
    unknown = [c for c in header if c not in _OWN_COLUMNS and not re.fullmatch(r"\w+(\.\w+)+", c)]
    if "run" not in header or unknown:
        raise StageError(
            f"{path}: column {(unknown or ['run'])[0]!r}: the header must be run,"
            f" {', '.join(sorted(_OWN_COLUMNS - {'run'}))} and dotted keys of the scene, as"
            " numerics.time_step"
        )
    rows = [_row(path, record) for record in reader]
    names = [row.run for row in rows]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice or not rows:
        raise StageError(
            f"{path}: "
            + (f"run {twice!r} occurs twice; rename one" if twice else "no rows; add runs")
        )
    return rows


def _row(path: Path, record: dict[str | None, Any]) -> Row:
    name = (record.get("run") or "").strip()
    check_name(name, f"{path}: run")
    if record.get(None):
        raise StageError(
            f"{path}: run {name}: more cells than columns; put a cell with a comma in quotes"
        )
    cells = {key: value.strip() for key, value in record.items() if key and value and value.strip()}
    ranks = cells.get("ranks", "1")
    if not ranks.isdecimal() or int(ranks) < 1:
        raise StageError(f"{path}: run {name}: ranks = {ranks!r}: give a whole number, 1 or more")
    until, may_fail = cells.get("until", "vortices"), cells.get("may_fail", "no")
    if until not in (FEA.name, *TARGETS):
        raise StageError(f"{path}: run {name}: until = {until!r}: give one of {', '.join(TARGETS)}")
    if may_fail not in ("yes", "no"):
        raise StageError(f"{path}: run {name}: may_fail = {may_fail!r}: give yes or no")
    overrides = {key: parse_cell(text) for key, text in cells.items() if key not in _OWN_COLUMNS}
    return Row(
        name,
        cells.get("level", "coarse"),
        int(ranks),
        until,
        overrides,
        cells.get("scene", "."),
        may_fail == "yes",
    )


def check_name(name: str, key: str) -> None:
    """StageError where a name could be no folder of its own."""
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise StageError(f"{key} = {name!r}: give a name of letters, digits, '_', '-' and '.'")


def parse_cell(text: str) -> Any:
    """The value of a cell as in JSON or in scene.toml, or its text where it is neither."""
    for parse in (json.loads, lambda value: tomllib.loads(f"value = {value}")["value"]):
        with suppress(ValueError):
            return parse(text)
    return text
