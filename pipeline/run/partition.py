"""Decomposition of the mesh for several ranks: whole columns only, equal load, few shared faces, every rank in one piece."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fileio.errors import StageError

REPAIRS = 10  # rounds of handing stray pieces over; two were enough for 64 ranks on every level


def partition_columns(centres: np.ndarray, load: np.ndarray, ranks: int, pairs: np.ndarray | None = None,
                      method: str = "auto") -> np.ndarray:  # fmt: skip
    """Rank of each column of cells: by scotch where its program is installed, else by recursive bisection.

    centres (column, 2) m; load (column,) cells of each, zero where a column has none; pairs (edge, 2) columns that are
    neighbours: needed by scotch, and for ranks in one piece. StageError where scotch is asked for but missing.
    """
    if pairs is not None and (method == "scotch" or (method == "auto" and scotch_program())):
        rank = partition_scotch(load, pairs, shared_faces(load, pairs), ranks)
    else:
        rank = np.zeros(len(centres), int)
        _bisect(centres, load, np.arange(len(centres)), 0, ranks, rank)
    return rank if pairs is None else whole_pieces(rank, load, pairs)


def shared_faces(load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Faces (edge,) between neighbouring columns: over the finger's footprint only the layers that both have."""
    return np.minimum(load[pairs[:, 0]], load[pairs[:, 1]])


def pieces(rank: np.ndarray, load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Connected piece (column,) that each column belongs to, within its rank; -1 where it has no cells."""
    inside = (rank[pairs[:, 0]] == rank[pairs[:, 1]]) & (shared_faces(load, pairs) > 0)
    a, b = pairs[inside].T
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(len(rank), len(rank)))
    return np.where(load > 0, connected_components(graph, directed=False)[1], -1)


def whole_pieces(rank: np.ndarray, load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Hand stray pieces of ranks that lie in several over to the neighbour with which they share most faces."""
    rank, faces = rank.copy(), shared_faces(load, pairs)
    for _ in range(REPAIRS):
        piece = pieces(rank, load, pairs)
        size = np.bincount(piece[piece >= 0], load[piece >= 0])
        kept: dict[int, int] = {}  # the largest piece of each rank stays
        for name in np.unique(piece[piece >= 0]):
            owner = int(rank[np.argmax(piece == name)])
            if owner not in kept or size[name] > size[kept[owner]]:
                kept[owner] = int(name)
        stray = np.setdiff1d(np.unique(piece[piece >= 0]), list(kept.values()))
        if not stray.size:
            break
        for name in stray:
            sides = piece[pairs] == name
            edge = sides.any(1) & ~sides.all(1) & (faces > 0)
            other = np.where(sides[edge, 0], pairs[edge, 1], pairs[edge, 0])
            if other.size:
                rank[piece == name] = np.argmax(np.bincount(rank[other], faces[edge]))
    return rank


def _bisect(centres: np.ndarray, load: np.ndarray, members: np.ndarray, first: int, ranks: int,
            rank: np.ndarray) -> None:  # fmt: skip
    if ranks == 1:
        rank[members] = first
        return
    lower = ranks // 2
    # Across the direction in which the cells, not the tank, spread more: short cuts, few shared faces.
    axis = int(
        np.argmax(np.average((centres[members] - np.median(centres[members], 0)) ** 2, axis=0))
    )
    ordered = members[np.argsort(centres[members, axis], kind="stable")]
    share = np.cumsum(load[ordered])
    cut = int(np.searchsorted(share, share[-1] * lower / ranks))
    _bisect(centres, load, ordered[:cut], first, lower, rank)
    _bisect(centres, load, ordered[cut:], first + lower, ranks - lower, rank)


PROGRAMS = ("gpart", "scotch_gpart")  # scotch's own name, and Debian's


def scotch_program() -> str | None:
    """Path of scotch's graph partitioner, None where it is not installed."""
    return next((path for name in PROGRAMS if (path := shutil.which(name))), None)


def partition_scotch(
    load: np.ndarray, pairs: np.ndarray, faces: np.ndarray, ranks: int
) -> np.ndarray:
    """Rank (column,) of equal `load` (column,) and few shared `faces` (edge,) of neighbouring `pairs` (edge, 2).

    Columns without cells are left to rank 0. Raises StageError where scotch is missing or fails.
    """
    program = scotch_program()
    if program is None:
        raise StageError(
            "scotch is not installed (no gpart on the path); run: sudo apt-get install scotch"
        )
    columns = np.flatnonzero(load > 0)
    number = np.full(len(load), -1)
    number[columns] = np.arange(len(columns))
    shared = faces > 0
    # equal meshes, equal parts
    env = os.environ | {"SCOTCH_PTHREAD_NUMBER": "1", "SCOTCH_DETERMINISTIC": "1"}
    with tempfile.TemporaryDirectory() as folder:
        graph, mapping = Path(folder) / "columns.grf", Path(folder) / "columns.map"
        text = graph_text(
            load[columns].astype(int), number[pairs[shared]], faces[shared].astype(int)
        )
        graph.write_text(text)
        command = [program, str(ranks), str(graph), str(mapping), "/dev/null"]
        done = subprocess.run(command, env=env, capture_output=True, text=True)
        if done.returncode != 0 or not mapping.exists():
            raise StageError(f"{program} failed: {(done.stderr or done.stdout).strip()[-300:]}")
        assigned = np.loadtxt(mapping, int, skiprows=1, ndmin=2)
    rank = np.zeros(len(load), int)
    rank[columns[assigned[:, 0]]] = assigned[:, 1]
    return rank


def graph_text(load: np.ndarray, pairs: np.ndarray, faces: np.ndarray) -> str:
    """A graph in scotch's format 0 (base 0, flags 011: weights of vertices and of edges); its manual, section 5.1."""
    ends = np.vstack([pairs, pairs[:, ::-1]])
    order = np.argsort(ends[:, 0], kind="stable")
    ends, weight = ends[order], np.tile(faces, 2)[order]
    begin = np.searchsorted(ends[:, 0], np.arange(len(load) + 1))
    text = io.StringIO()
    text.write(f"0\n{len(load)} {len(ends)}\n0 011\n")
    for vertex, (a, b) in enumerate(pairwise(begin)):
        arcs = " ".join(f"{w} {v}" for w, v in zip(weight[a:b], ends[a:b, 1], strict=True))
        text.write(f"{load[vertex]} {b - a} {arcs}\n")
    return text.getvalue()
