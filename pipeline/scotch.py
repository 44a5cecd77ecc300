"""Cutting a graph of columns by scotch's own program gpart: real where OpenFOAM's library of that name is a dummy, as Debian's."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.errors import StageError

PROGRAMS = ("gpart", "scotch_gpart")  # scotch's own name, and Debian's


def scotch_program() -> str | None:
    """Path of scotch's graph partitioner, None where it is not installed."""
    return next((path for name in PROGRAMS if (path := shutil.which(name))), None)


def partition_scotch(load: np.ndarray, pairs: np.ndarray, faces: np.ndarray, ranks: int) -> np.ndarray:
    """Rank (column,) of equal `load` (column,) and few shared `faces` (edge,) of neighbouring `pairs` (edge, 2).

    Columns without cells are left to rank 0. Raises StageError where scotch is missing or fails.
    """
    program = scotch_program()
    if program is None:
        raise StageError("scotch is not installed (no gpart on the path); run: sudo apt-get install scotch")
    columns = np.flatnonzero(load > 0)
    number = np.full(len(load), -1)
    number[columns] = np.arange(len(columns))
    shared = faces > 0
    env = os.environ | {
        "SCOTCH_PTHREAD_NUMBER": "1",
        "SCOTCH_DETERMINISTIC": "1",
    }  # equal meshes, equal parts
    with tempfile.TemporaryDirectory() as folder:
        graph, mapping = Path(folder) / "columns.grf", Path(folder) / "columns.map"
        graph.write_text(
            graph_text(load[columns].astype(int), number[pairs[shared]], faces[shared].astype(int))
        )
        done = subprocess.run(
            [program, str(ranks), str(graph), str(mapping), "/dev/null"],
            env=env,
            capture_output=True,
            text=True,
        )
        if done.returncode != 0 or not mapping.exists():
            raise StageError(f"{program} failed: {(done.stderr or done.stdout).strip()[-300:]}")
        found = np.loadtxt(mapping, int, skiprows=1, ndmin=2)
    rank = np.zeros(len(load), int)
    rank[columns[found[:, 0]]] = found[:, 1]
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
