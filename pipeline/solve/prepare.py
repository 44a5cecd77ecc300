"""Preparation of an interval's case: decomposition, mapped fields, files of the motion."""

import json
import re
import shutil
from collections.abc import Sequence

import numpy as np
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.formats.mesh_intervals import IntervalMesh
from pipeline.geometry.quality import cell_centres, neighbours, planform_edges
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.displacement_files import frames_laid, time_name
from pipeline.openfoam.environment import run_tool
from pipeline.openfoam.foamfile import set_number, write_list
from pipeline.solve.checkpoint import PROGRESS, STATE, case_state, has_ended, prepared_for
from pipeline.solve.interval import KnownMotion, SolverInterval
from pipeline.solve.map_fields import map_fields
from piv.files.atomic import write_text

_REPAIRS = 10  # rounds of moving stray pieces; two were enough for 64 ranks on every level


def prepare(parts: Sequence[SolverInterval], k: int, motion: KnownMotion, quiet: bool) -> None:
    """Decompose the case of part `k`, map its first fields and write its motion, unless done.

    Done counts only for the same mesh, ranks and version of OpenFOAM.
    """
    case, mesh = parts[k].case, parts[k].mesh
    folder, wanted = case.folder, case_state(case)
    done = prepared_for(folder) == wanted
    # the frames are removed after an interval: one that is solved again needs them
    if done and (has_ended(folder, mesh.interval) or frames_laid(case)):
        return
    if not done:
        # interrupted from here on, this interval and those after it start from the beginning
        for later in reversed(parts[k:]):
            for stale in (STATE, PROGRESS):
                (later.case.folder / stale).unlink(missing_ok=True)
        for old in folder.iterdir():
            time = re.fullmatch(r"[0-9.e-]+", old.name) and old.name != "0"
            if old.is_dir() and (time or old.name.startswith(("processor", "postProcessing"))):
                shutil.rmtree(old)
        if k:
            map_fields(parts[k - 1].case, parts[k - 1].mesh, case, mesh, parts[k].steps.first)
        if case.ranks > 1:
            _decompose(case, mesh)
    motion.write_frames(quiet)
    if not done:
        write_text(folder / STATE, json.dumps(wanted))


def _decompose(case: Case, mesh: IntervalMesh) -> None:
    planform, column, folder = mesh.planform, mesh.sweep["cell_column"].values, case.folder
    cells = planform["triangles"].values, planform["quads"].values
    centres = cell_centres(planform["points"].values[0], *cells)
    pairs = neighbours(planform_edges(*cells))
    load = np.bincount(column, minlength=len(centres)).astype(float)
    rank = partition_columns(centres, load, case.ranks, pairs)[column]
    write_list(folder / "constant" / "cellDecomposition", "labelList", "constant", rank)
    set_number(folder, "startTime", time_name(mesh.interval.begin))
    set_number(folder, "numberOfSubdomains", str(case.ranks), "decomposeParDict")
    run_tool(["decomposePar", "-force", "-noFunctionObjects"], folder)


def partition_columns(centres: ndarray, load: ndarray, ranks: int, pairs: ndarray) -> ndarray:
    """Rank of each column of cells, by recursive bisection: every rank in one piece.

    centres (column, 2) m; load (column,): cells of each, zero where a column has none; pairs
    (edge, 2): neighbouring columns.
    """
    rank = np.zeros(len(centres), int)
    _bisect(centres, load, np.arange(len(centres)), 0, ranks, rank)
    return _whole_pieces(rank, load, pairs)


def _whole_pieces(rank: ndarray, load: ndarray, pairs: ndarray) -> ndarray:
    """Give each rank's stray pieces to the neighbour with which they share most faces."""
    rank, faces = rank.copy(), np.minimum(load[pairs[:, 0]], load[pairs[:, 1]])
    for _ in range(_REPAIRS):
        inside = (rank[pairs[:, 0]] == rank[pairs[:, 1]]) & (faces > 0)
        a, b = pairs[inside].T
        graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(len(rank), len(rank)))
        connected = connected_components(graph, directed=False)[1]
        piece = np.where(load > 0, connected, -1)  # of each column within its rank
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


def _bisect(centres: ndarray, load: ndarray, members: ndarray, first: int, ranks: int,
            rank: ndarray) -> None:  # fmt: skip
    if ranks == 1:
        rank[members] = first
        return
    lower = ranks // 2
    # across the direction in which the cells spread more: few shared faces
    axis = int(
        np.argmax(np.average((centres[members] - np.median(centres[members], 0)) ** 2, axis=0))
    )
    ordered = members[np.argsort(centres[members, axis], kind="stable")]
    share = np.cumsum(load[ordered])
    cut = int(np.searchsorted(share, share[-1] * lower / ranks))
    _bisect(centres, load, ordered[:cut], first, lower, rank)
    _bisect(centres, load, ordered[cut:], first + lower, ranks - lower, rank)
