"""Rows of a study's table: runs that are a scene at a level with overrides."""

import json
import re
import tomllib
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.runs.stages import FEA, TARGETS
from piv.files.errors import StageError
from piv.files.record import NAME
from piv.formats.user_tables import read_columns

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
    table = read_columns(path, ["run"], None, ragged=True)
    header = table.names
    unknown = [c for c in header if c not in _OWN_COLUMNS and not re.fullmatch(r"\w+(\.\w+)+", c)]
    if unknown:
        raise StageError(
            f"{path}: column {unknown[0]!r}: the header must be run,"
            f" {', '.join(sorted(_OWN_COLUMNS - {'run'}))} and dotted keys of the scene, as"
            " numerics.time_step"
        )
    cells = table.plain(table.rows)
    rows = [_row(path, dict(zip(header, row, strict=True))) for row in cells]
    seen: set[str] = set()
    for row in rows:
        if row.run in seen:
            raise StageError(f"{path}: run {row.run!r} occurs twice; rename one")
        seen.add(row.run)
    return rows


def _row(path: Path, record: dict[str, str]) -> Row:
    name = record["run"]
    check_name(name, f"{path}: run")
    cells = {key: value for key, value in record.items() if value}
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
    if not re.fullmatch(NAME, name):
        raise StageError(f"{key} = {name!r}: give a name of letters, digits, '_', '-' and '.'")


def parse_cell(text: str) -> Any:
    """The value of a cell as in JSON or in scene.toml, or its text where it is neither."""
    for parse in (json.loads, lambda value: tomllib.loads(f"value = {value}")["value"]):
        with suppress(ValueError):
            return parse(text)
    return text
