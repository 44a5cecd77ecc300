"""The folders and files of a case for its MPI ranks."""

from dataclasses import dataclass
from pathlib import Path

from piv.files.errors import StageError

LEAST_CELLS = 5000  # of a rank: with fewer, ranks wait for each other longer than they work


@dataclass(frozen=True)
class Ranks:
    """MPI ranks of a solver."""

    count: int = 1

    def __str__(self) -> str:
        return f"{self.count} rank{'s' if self.count > 1 else ''}"

    def folders(self, case: Path) -> list[Path]:
        """Folders of `case` in which times are written."""
        if self.count == 1:
            return [case]
        return [case / f"processor{rank}" for rank in range(self.count)]

    def contents(self, case: Path, name: str) -> list[bytes]:
        """Content of the file `name`, rank by rank; StageError where one is missing."""
        paths = [folder / name for folder in self.folders(case)]
        for path in paths:
            if not path.exists():
                raise StageError(f"{path}: missing; delete the case folder and run make again")
        return [path.read_bytes() for path in paths]
