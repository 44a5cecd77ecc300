"""Prediction of a run's time on n ranks, and of the useful number of ranks.

    python -m docs.evidence.ranks

writes docs/record/ranks.txt.

Time of a step of N cells on n ranks, with the constants below:

    t(n) = f + s N + w N/n · b(n) · i(n) + messages + sums

b: slowdown of ranks that share a node's memory; i: imbalance, because each rank has whole columns
of cells. Halo messages and global sums are counted from PISO with GAMG.
"""

import math

import numpy as np

from docs.evidence.small_scene import ROOT
from pipeline.formats.mesh_intervals import read_intervals, read_sweep
from pipeline.openfoam.case_folder import LEAST_CELLS
from pipeline.runs.estimate import duration
from pipeline.runs.run import open_run
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene
from piv.files.atomic import write_text
from softfinger.make import Machine, make

_RANKS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
# Measured 2026-11-22: single_finger at level coarse, 74305 cells in 4243 columns, moving mesh and
# samples, two pressure solves a step: 0.2269 s a step on one rank, 0.1269 s on two.
_FIXED = 0.012  # s: f, by which small runs at level smoke took longer than their cells explain
_SERIAL = 9.3e-9  # s a cell: s, of the sheet's pictures, which one rank collects
_WORK = (0.2269 - _FIXED) / 74305 - _SERIAL  # s a cell: w
_PAIR = 1.0455  # b(2), with which the model takes 0.1269 s
_CYCLES = 4.0  # GAMG cycles of a step with two pressure solves
# Open MPI on 100 Gb/s InfiniBand (osu_latency and osu_bw by J. Grimm, 2021,
# gist.github.com/jfgrimm/3af692a5475bdd4ed836b5a18197a209): 1.67 µs for the 1 kB of a halo message;
# 11.6 GB/s between nodes, and of 64 ranks in 8 by 8 patches an eighth of the halos leaves the node.
# Microsoft's figures of HBv3 and HBv4 agree: below 2 µs, 192 and 400 Gb/s.
_LATENCY, _BANDWIDTH = 1.7e-6, 1.45e9  # s, bytes/s of a rank
_NODE = 64  # ranks of a node
# OpenFOAM is bound by memory: a rank on a full node is slowed down by nothing where its share fits
# the caches, and up to threefold (Galeazzo et al. 2024, IOP Conf. Ser.: Mater. Sci. Eng. 1312,
# 012009). The middle is assumed, and the answer shows both.
_SATURATED, _SATURATED_RANGE = 2.0, (1.0, 3.0)
_HALOS = 6.0  # of a level: smoothing twice, residual, prolongation, interpolation, scaling
_SWEEPS = 6.0  # of the momentum: three components, about two each
_COARSEST_CELLS, _COARSEST_SUMS = 100.0, 22.0  # of a rank and of a cycle, on the coarsest level
_FACE = 8.0  # bytes


def step_time(cells: float, ranks: int, columns: float, saturated: float = _SATURATED) -> float:
    """Seconds of one step; `saturated`: slowdown of a rank on a full node."""
    alone = _FIXED + _SERIAL * cells
    own = cells / ranks
    if ranks == 1:
        return alone + _WORK * own
    share = math.log2(min(ranks, _NODE) / 2) / math.log2(_NODE / 2)
    slowdown = _PAIR + max(saturated - _PAIR, 0.0) * share
    imbalance = 1.01 + 0.5 * ranks / columns  # half a column too many
    depth = max(1.0, math.log2(own / _COARSEST_CELLS))  # each level halves the cells
    # faces shared with neighbours: the rim of a square patch of columns, times the layers; each
    # level has a quarter of the faces of the finer one, and all 4/3 of the finest
    faces = 4.0 * math.sqrt(columns / ranks) * cells / columns
    carried = 4 / 3 * _CYCLES * _HALOS * faces * _FACE
    messages = (_CYCLES * depth * _HALOS + _SWEEPS) * min(6, ranks - 1)
    sums = _CYCLES * _COARSEST_SUMS * math.log2(ranks)
    work = _WORK * own * slowdown * imbalance
    return alone + work + (messages + sums) * _LATENCY + carried / _BANDWIDTH


def useful_ranks(cells: float, columns: float) -> int:
    """Largest useful number of ranks, a power of two, each with at least LEAST_CELLS.

    Twice as many would save less than a quarter of the time.
    """
    ranks = 1
    while 2 * ranks * LEAST_CELLS <= cells:
        if step_time(cells, 2 * ranks, columns) > 0.75 * step_time(cells, ranks, columns):
            break
        ranks *= 2
    return ranks


def report(scene: Scene) -> str:
    """The prediction as text, with its assumptions. StageError without a mesh."""
    interval = max(read_intervals(scene.out), key=lambda interval: interval.end - interval.start)
    column = read_sweep(scene.out, interval.name)["cell_column"].values
    return prediction(scene, len(column), len(np.unique(column)))


def prediction(scene: Scene, cells: int, columns: int) -> str:
    """The prediction of a scene whose mesh has so many cells and columns."""
    numerics = scene.numerics
    solves = numerics.pressure_correctors * (1 + numerics.non_orthogonal_correctors)
    steps = round(predicted(scene).steps)

    def seconds(n: int, saturated: float = _SATURATED) -> float:
        return solves / 2 * steps * step_time(cells, n, columns, saturated)

    pays = useful_ranks(cells, columns)
    spread, plural = "", "" if pays == 1 else "s"
    if pays > 2:
        ends = " to ".join(duration(seconds(pays, end)) for end in _SATURATED_RANGE)
        spread = f" ({ends}, by the memory bandwidth of a node)"
    lines = [
        f"{scene.level} {scene.name}: {cells} cells in {columns} columns, {steps} steps",
        "",
        "ranks     time   speed-up   efficiency",
    ]
    for n in (n for n in _RANKS if n == 1 or n * LEAST_CELLS <= cells):
        speed_up = seconds(1) / seconds(n)
        lines.append(f"{n:5d} {duration(seconds(n)):>8s} {speed_up:10.1f} {speed_up / n:11.0%}")
    lines += [
        "",
        f"{scene.level} {scene.name}: about {duration(seconds(pays))} of solver on {pays}"
        f" rank{plural}{spread}; more no longer pay (twice as many would save less than a quarter,"
        f" or have less than {LEAST_CELLS} cells each).",
        "",
        f"Assumed: {1e3 * _FIXED:.0f} ms a step and {1e6 * _WORK:.2f} µs per cell and step, in"
        f" proportion to pressure solves; two ranks slow each other down by {_PAIR - 1:.0%} (all"
        f" measured), a full node of {_NODE} ranks by {_SATURATED - 1:.0%} (Galeazzo et al. 2024);"
        f" latency {1e6 * _LATENCY:.1f} µs and {_BANDWIDTH / 1e9:.2g} GB/s of a rank (InfiniBand);"
        " an idle machine like the one of docs/evidence/ranks.py.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Write the prediction of single_finger at two levels, whose meshes are made first."""
    texts = []
    for level in ("coarse", "fine"):
        run = open_run(ROOT / "cases" / "single_finger", level)
        make(run, "case", Machine())
        texts.append(report(run.scene))
    write_text(ROOT / "docs" / "record" / "ranks.txt", "\n\n\n".join(texts) + "\n")


if __name__ == "__main__":
    main()
