"""A study table: one run per row, each a scene that extends another and says only what differs.

Columns: run (`<axis>_<value>`), level, until, ranks, and dotted keys of the scene with values as JSON; empty: as the scene
says; lines starting with # are comments.
"""

from __future__ import annotations

import csv
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

OWN = ("run", "level", "until", "ranks")


@dataclass(frozen=True)
class Row:
    """One run: `overrides` are dotted keys of the scene."""

    scene: Path
    run: str
    level: str
    until: str
    ranks: int
    overrides: dict[str, Any] = field(default_factory=dict)

    @property
    def axis(self) -> str:
        return self.run.partition("_")[0]

    @property
    def value(self) -> str:
        return self.run.partition("_")[2]

    @property
    def folder(self) -> Path:
        return self.scene / "out" / "studies" / "stability" / self.run


def read_table(path: Path) -> list[Row]:
    """The runs of `cases/<scene>/studies/<study>.csv`."""
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and line[0] != "#"
    ]
    rows = []
    for record in csv.DictReader(lines):
        given = {key: text for key, text in record.items() if text}
        overrides = {key: _cell(text) for key, text in given.items() if key not in OWN}
        own = given["run"], given["level"], given["until"], int(given.get("ranks", 1))
        rows.append(Row(path.parent.parent, *own, overrides))
    return rows


def _cell(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def toml(value: Any) -> str:
    """A value as TOML: JSON's but for tables, which take = for a colon."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def scene_text(row: Row) -> str:
    """The scene.toml of a run."""
    lines = [f"extends = {json.dumps(os.path.relpath(row.scene, row.folder))}", "", f"[levels.{row.level}]"]
    lines += [f"{key} = {toml(value)}" for key, value in sorted(row.overrides.items())]
    return "\n".join(lines) + "\n"
