"""Reading constant/polyMesh: which points and cells each face has, and the patches."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray

from pipeline.openfoam.foamfile import labels_of


@dataclass(frozen=True)
class Faces:
    """Faces as OpenFOAM numbers them, inner ones first.

    `corners` (face, 4): points, a triangle's last one twice; `owner` (face,), `neighbour` (inner
    face,): cells; `patches`: the faces of each patch.
    """

    corners: ndarray
    owner: ndarray
    neighbour: ndarray
    patches: dict[str, slice]


def read_faces(folder: Path) -> Faces:
    """The faces of a mesh of triangles and quadrilaterals, from its binary files."""
    content = (folder / "faces").read_bytes()
    offset = labels_of(content)
    end = content.index(b"(", content.index(b"}")) + 1 + 4 * len(offset)
    opening = content.index(b"(", end)
    points = np.frombuffer(content, "<i4", int(content[end + 1 : opening]), opening + 1)
    size = np.diff(offset)
    corners = points[offset[:-1, None] + np.minimum(np.arange(4), size[:, None] - 1)]
    owner, neighbour = (labels_of((folder / name).read_bytes()) for name in ("owner", "neighbour"))
    entries = re.findall(
        r"(\w+)\s*\{[^}]*?nFaces\s+(\d+);\s*startFace\s+(\d+);", (folder / "boundary").read_text()
    )
    patches = {name: slice(int(start), int(start) + int(count)) for name, count, start in entries}
    return Faces(corners, owner, neighbour, patches)
