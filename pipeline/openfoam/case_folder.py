"""A case and its MPI ranks: a folder of files for each, or one folder of collated files.

Collated files are OpenFOAM's decomposedBlockData: a header, then for each rank its size and its
bytes in brackets. The header of the blocks' content stands in the first one only.
"""

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from pipeline.openfoam.foamfile import header, is_complete, write_bytes
from piv.files.errors import StageError

LEAST_CELLS = 5000  # of a rank: with fewer, ranks wait for each other longer than they work
COLLATED = b"decomposedBlockData"
HEAD = 2000  # bytes within which a file's header lies
_MESH_PAST = ("V0", "meshPhi")
FIRST = re.compile(rb"// [Pp]rocessor0\s")  # with a small letter from later versions than v1912
BLOCK = re.compile(rb"\s*// [Pp]rocessor\d+\s+(\d+)\s*\(")


@dataclass(frozen=True)
class Case:
    """The folder of a case, its MPI ranks, and whether their files are collated (never of one)."""

    folder: Path
    ranks: int = 1
    collated: bool = False

    @property
    def layout(self) -> str:
        """Ranks and files in words."""
        return f"{self.ranks} ranks" + (" and collated files" if self.collated else "")

    @property
    def folders(self) -> list[Path]:
        """Folders in which times are written."""
        if self.ranks == 1:
            return [self.folder]
        if self.collated:
            return [self.folder / f"processors{self.ranks}"]
        return [self.folder / f"processor{rank}" for rank in range(self.ranks)]

    def announce(self, time: str) -> None:
        """Let a resumed run find the old volumes and the mesh fluxes in collated files.

        v1912 reads them only where it sees their names in each rank's own folder: empty files stand
        there until `withdraw`. Without them it would go on as if the mesh had stood still.
        """
        if self.collated:
            for name in _MESH_PAST:
                for rank in range(self.ranks):
                    if (self.folders[0] / time / name).exists():
                        write_bytes(self.folder / f"processor{rank}" / time / name, b"")

    def withdraw(self) -> None:
        """Remove the files of `announce`, also after a run that was killed."""
        if self.collated:
            for rank in range(self.ranks):
                shutil.rmtree(self.folder / f"processor{rank}", ignore_errors=True)

    def is_whole(self, path: Path) -> bool:
        """Whether OpenFOAM finished writing a file, for all ranks where it is collated."""
        if not self.collated:
            return is_complete(path)
        content = path.read_bytes()
        if COLLATED not in content[:HEAD]:
            return is_complete(path)  # written by one rank for all
        return len(read_blocks(content)) == self.ranks

    def contents(self, name: str) -> list[bytes]:
        """Content of the file `name`, rank by rank; StageError where it is missing or cut off."""
        paths = [folder / name for folder in self.folders]
        for path in paths:
            if not path.exists():
                raise StageError(f"{path}: missing; delete the case folder and run make again")
        contents = [path.read_bytes() for path in paths]
        if not self.collated or self.ranks == 1:
            return contents
        blocks = read_blocks(contents[0])
        if len(blocks) != self.ranks:
            raise StageError(
                f"{paths[0]}: {len(blocks)} of {self.ranks} ranks are in it; delete {self.folder}"
                " and run make again"
            )
        return blocks


def read_blocks(content: bytes) -> list[bytes]:
    """The whole blocks of a collated file, in order."""
    blocks: list[bytes] = []
    first = FIRST.search(content)
    at = first.start() if first else len(content)
    while block := BLOCK.match(content, at):
        end = block.end() + int(block.group(1))
        if content[end : end + 1] != b")":
            break  # cut off
        blocks.append(content[block.end() : end])
        at = end + 1
    return blocks


def collated_content(name: str, blocks: list[bytes]) -> bytes:
    """A collated file of one block per rank, the first with the header of their content."""
    parts = [
        b"\n// Processor%d\n\n%d\n(%b)\n" % (rank, len(block), block)
        for rank, block in enumerate(blocks)
    ]
    return header(COLLATED.decode(), "", name, binary=True) + b"".join(parts)
