"""The folder of a case, and the folders and files of its MPI ranks."""

from dataclasses import dataclass
from pathlib import Path

from piv.files.errors import StageError

LEAST_CELLS = 5000  # of a rank: with fewer, ranks wait for each other longer than they work


@dataclass(frozen=True)
class Case:
    """The folder of a case, and the MPI ranks of its solver."""

    folder: Path
    ranks: int = 1

    @property
    def folders(self) -> list[Path]:
        """Folders in which times are written."""
        if self.ranks == 1:
            return [self.folder]
        return [self.folder / f"processor{rank}" for rank in range(self.ranks)]

    def contents(self, name: str) -> list[bytes]:
        """Content of the file `name`, rank by rank; StageError where one is missing."""
        paths = [folder / name for folder in self.folders]
        for path in paths:
            if not path.exists():
                raise StageError(f"{path}: missing; delete the case folder and run make again")
        return [path.read_bytes() for path in paths]
