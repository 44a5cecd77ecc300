"""Where a run's files are, and reading them with one-sentence errors."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.runs.stages import FILMED
from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class StageFiles:
    """Paths of a run; `numbers` is its scene."""

    numbers: Scene

    @property
    def scene(self) -> str:
        return self.numbers.name

    @property
    def scene_folder(self) -> Path:
        return self.numbers.folder

    @property
    def level(self) -> str:
        return self.numbers.level

    @property
    def out(self) -> Path:
        return self.numbers.out

    @property
    def figures(self) -> Path:
        return self.out / "figures"

    @property
    def findings(self) -> Path:
        return self.scene_folder / "reference" / "findings.toml"

    def required(self, name: str, stage: str) -> Path:
        """Path of a file of the run; FileNotFoundError that names the stage to run."""
        path = self.out / name
        if not path.exists():
            raise FileNotFoundError(
                f"{path} is missing; run the stage '{stage}' of {self.scene} at level {self.level}"
                " first"
            )
        return path

    def optional(self, name: str) -> Path | None:
        """Path of a file of the run, or None where the stage that makes it was not run."""
        path = self.out / name
        left_over = not self.numbers.filmed and path.stem in FILMED
        return path if path.exists() and not left_over else None


def scene_numbers(files: StageFiles) -> dict[str, Any]:
    """The sections of the run's scene as plain values."""
    own = {"name", "title", "level", "folder", "parents", "out", "notes"}
    return files.numbers.model_dump(mode="json", exclude=own)
