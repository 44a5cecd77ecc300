"""Sweeping a planform along z into an OpenFOAM mesh: prisms and hexahedra in exact columns."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import xarray as xr
from numpy import ndarray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from pipeline.geometry.quality import planform_edges
from pipeline.openfoam.foamfile import END, header, write_bytes, write_list
from pipeline.scene.obstacle import OBSTACLE_PATCHES


@dataclass(frozen=True)
class PolyMesh:
    """Topology of a swept mesh in OpenFOAM's order."""

    node: ndarray  # (point,) planform node of each point
    level: ndarray  # (point,)
    face_offset: ndarray
    face_points: ndarray
    owner: ndarray
    neighbour: ndarray
    patches: tuple[tuple[str, int, int], ...]  # name, first face, number of faces
    cell_column: ndarray  # (cell,) planform cell (triangles, then quads)
    cell_layer: ndarray

    def points(self, nodes: ndarray, levels: ndarray) -> ndarray:
        """Point coordinates (point, 3) for planform nodes (node, 2)."""
        return np.column_stack([nodes[self.node], levels[self.level]])


def sweep_mesh(planform: xr.Dataset, side_of_edge: ndarray) -> PolyMesh:
    """A mesh of planform.h5 swept through its levels; bodies have no cells.

    side_of_edge (edge,): index into OUTER_PATCHES of edges with one cell.
    """
    triangles, quads, levels = (planform[n].values for n in ("triangles", "quads", "levels"))
    model = planform.attrs["model"]
    columns, layers = len(triangles) + len(quads), len(levels) - 1
    middle = 0.5 * (levels[1:] + levels[:-1])
    reach = np.array([-1.0, *planform["body_half_width"].values[1:]])
    filled = np.abs(middle)[None, :] < reach[:, None]  # (body, layer)
    if model == "2d":
        filled[1:] = True
    body = np.concatenate([planform["body"].values, np.zeros(len(quads), int)])
    exists = ~filled[body]
    walls = planform["body_name"].values[1:]
    patch_of = np.array([-1, *(_PATCHES.index(name) for name in walls)])[body]
    edges = planform_edges(triangles, quads)
    number = _cell_numbers(exists, edges.left, edges.right, columns)

    nodes_of = np.full((columns, 4), -1)
    nodes_of[: len(triangles), :3] = triangles
    nodes_of[len(triangles) :] = quads
    used = np.zeros((int(nodes_of.max()) + 1, layers + 1), bool)
    for k in range(layers):
        corner = nodes_of[exists[:, k]]
        corner = np.unique(corner[corner >= 0])
        used[corner, k] = used[corner, k + 1] = True
    point = np.full(used.shape, -1)
    point[used] = np.arange(used.sum())  # node by node: a column's points lie together
    faces = [
        *_lateral(edges, exists, number, point, patch_of, side_of_edge),
        *_across(nodes_of, exists, number, point, patch_of, model),
    ]
    corner = np.concatenate([f[0] for f in faces])
    own = np.concatenate([f[1] for f in faces])
    other = np.concatenate([f[2] for f in faces])
    patch = np.concatenate([f[3] for f in faces])
    flip = (other >= 0) & (other < own)
    corner[flip] = _reversed(corner[flip])
    own, other = np.where(flip, other, own), np.where(flip, own, other)
    order = np.lexsort((other, own, np.where(other >= 0, -1, patch)))
    corner, own, other, patch = corner[order], own[order], other[order], patch[order]
    inner = int((other >= 0).sum())
    counts = [int((patch[inner:] == k).sum()) for k in range(len(_PATCHES))]
    starts = inner + np.concatenate([[0], np.cumsum(counts)[:-1]])
    size = (corner >= 0).sum(1)
    column, layer = np.nonzero(exists)
    by_number = np.argsort(number[exists])
    node, level = np.nonzero(used)
    return PolyMesh(
        node=node,
        level=level,
        face_offset=np.concatenate([[0], np.cumsum(size)]),
        face_points=corner[corner >= 0],
        owner=own,
        neighbour=other[:inner],
        patches=tuple(
            (n, int(s), c) for n, s, c in zip(_PATCHES, starts, counts, strict=True) if c
        ),
        cell_column=column[by_number],
        cell_layer=layer[by_number],
    )


# Walls and bottom; free surface; symmetry plane between two fingers; gap at the waterline, which
# takes up the volume by which a finger swells, as the rigid lid cannot rise; in place of gap and
# end walls the ends where a current enters and leaves.
OUTER_PATCHES = ("tank", "top", "mirror", "gap", "upstream", "downstream")
BODY_PATCHES = ("finger", "mirrored_finger", "object", "support", *OBSTACLE_PATCHES)
_PATCHES = (*BODY_PATCHES, *OUTER_PATCHES, "back", "sheet", "front")


def _cell_numbers(exists: ndarray, left: ndarray, right: ndarray, columns: int) -> ndarray:
    """Numbers of cells, column by column in an order of small bandwidth for the linear solver."""
    pair = right >= 0
    a, b = left[pair], right[pair]
    graph = sp.coo_matrix((np.ones(len(a)), (a, b)), shape=(columns, columns)).tocsr()
    order = reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)
    number, ranked = np.full((2, *exists.shape), -1)
    ranked[exists[order]] = np.arange(exists.sum())
    number[order] = ranked
    return number


def _lateral(edges, exists, number, point, patch_of, side_of_edge):
    """Faces standing on planform edges: corners, owner, neighbour (-1 at a boundary), patch."""
    for k in range(exists.shape[1]):
        left = exists[edges.left, k]
        right = (edges.right >= 0) & exists[edges.right, k]
        a, b = edges.nodes.T
        quad = np.column_stack([point[a, k], point[b, k], point[b, k + 1], point[a, k + 1]])
        own, other = number[edges.left, k], number[edges.right, k]
        both = left & right
        none = np.full(len(a), -1)
        yield quad[both], own[both], other[both], none[both]
        alone = left & ~right
        patch = np.where(edges.right >= 0, patch_of[edges.right], len(BODY_PATCHES) + side_of_edge)
        yield quad[alone], own[alone], none[alone], patch[alone]
        alone = right & ~left
        yield _reversed(quad[alone]), other[alone], none[alone], patch_of[edges.left[alone]]


def _across(nodes_of, exists, number, point, patch_of, model):
    """Faces that lie in the levels: between layers, at both ends, and the ends of the bodies."""
    layers = exists.shape[1]
    blank = nodes_of < 0
    for k in range(layers + 1):
        below = exists[:, k - 1] if k > 0 else np.zeros(len(exists), bool)
        above = exists[:, k] if k < layers else np.zeros(len(exists), bool)
        corner = np.where(blank, -1, point[nodes_of, k])
        none = np.full(len(exists), -1)
        both = below & above
        if both.any():
            yield corner[both], number[both, k - 1], number[both, k], none[both]
        ends = {0: "back", layers: "front" if model == "full" else "sheet"}
        end = np.full(len(exists), _PATCHES.index(ends[k])) if k in ends else patch_of
        up, down = below & ~above, above & ~below
        if up.any():
            yield corner[up], number[up, k - 1], none[up], end[up]
        if down.any():
            yield _reversed(corner[down]), number[down, k], none[down], end[down]


def _reversed(corner: ndarray) -> ndarray:
    """Corners in the opposite sense; the blank fourth corner of a triangle stays last."""
    triangle = corner[:, 3] < 0
    turned = corner[:, ::-1].copy()
    turned[triangle] = np.column_stack([corner[triangle][:, [2, 1, 0]], corner[triangle][:, 3]])
    return turned


def write_polymesh(
    mesh: PolyMesh,
    points: ndarray,
    folder: Path,
    patch_types: dict[str, str],
    face_zones: dict[str, ndarray],
    cell_zones: dict[str, ndarray],
) -> None:
    """Write constant/polyMesh (binary) with its patches and zones."""
    place = "constant/polyMesh"
    note = (
        f"nPoints: {len(points)} nCells: {len(mesh.cell_column)}"
        f" nFaces: {len(mesh.owner)} nInternalFaces: {len(mesh.neighbour)}"
    )
    write_list(folder / "points", "vectorField", place, points)
    write_list(folder / "faces", "faceCompactList", place, mesh.face_offset, mesh.face_points)
    write_list(folder / "owner", "labelList", place, mesh.owner, note=note)
    write_list(folder / "neighbour", "labelList", place, mesh.neighbour, note=note)
    patches = "".join(
        f"    {name}\n    {{\n        type            {patch_types[name]};\n"
        f"        nFaces          {count};\n        startFace       {start};\n    }}\n"
        for name, start, count in mesh.patches
    )
    body = f"{len(mesh.patches)}\n(\n{patches})\n".encode()
    write_bytes(
        folder / "boundary",
        header("polyBoundaryMesh", place, "boundary", binary=False) + body + END,
    )
    _write_zones(folder / "faceZones", "faceZone", "faceLabels", face_zones)
    _write_zones(folder / "cellZones", "cellZone", "cellLabels", cell_zones)


def _write_zones(path: Path, kind: str, labels: str, zones: dict[str, ndarray]) -> None:
    text = f"{len(zones)}\n(\n"
    for name, members in zones.items():
        listed = " ".join(map(str, members.tolist()))
        text += (
            f"{name}\n{{\n    type {kind};\n    {labels} List<label> {len(members)} ({listed});\n"
        )
        if kind == "faceZone":
            text += f"    flipMap List<bool> {len(members)} ({' '.join('0' * len(members))});\n"
        text += "}\n"
    place = "constant/polyMesh"
    write_bytes(
        path, header("regIOobject", place, path.name, binary=False) + text.encode() + b")\n" + END
    )
