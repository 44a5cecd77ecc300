"""The runs of the study: rows of the studies' own tables (docs/formats.md), named `<axis>_<value>`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from pipeline.study import Row, read_study, scene_text


@dataclass(frozen=True)
class Run:
    """A row, and the scene (folder) that it differs from."""

    scene: Path
    row: Row

    @property
    def axis(self) -> str:
        return self.row.run.partition("_")[0]

    @property
    def value(self) -> str:
        return self.row.run.partition("_")[2]

    @property
    def folder(self) -> Path:
        return self.scene / "out" / "studies" / "stability" / self.row.run

    @property
    def text(self) -> str:
        """Its scene.toml."""
        return scene_text(os.path.relpath(self.scene, self.folder), self.row)


def read_table(path: Path) -> list[Run]:
    """The runs of `cases/<scene>/studies/<study>.csv`.

    `make study` would plan them as well, but ends where a scene is refused: here that is a result.
    """
    return [Run(path.parent.parent, row) for row in read_study(path)]
