"""Scaling model: time of a step on n ranks by work, halo exchange and global sums.

Time of a step of N cells on n ranks:

    t(n) = f + w N/n · b(n) · i(n) + s N
           + m(N/n) · [latency + bytes / bandwidth] + r · latency · log2 n

f: fixed time of a step; w: time per cell on one rank; s: time per cell that one rank spends for
all, on pictures of the sheet; these are measured. b: slowdown of ranks that share a node's memory,
measured on two ranks and from literature for a full node. i: imbalance of whole columns of cells.
m: halo messages, r: global sums, both counted from PISO with GAMG.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from fileio.errors import StageError
from pipeline.openfoam.ranks import LEAST_CELLS


@dataclass(frozen=True)
class Network:
    """Network between nodes, and the slowdown of ranks that share a node's memory."""

    latency: float  # s per message
    bandwidth: float  # bytes/s per rank
    ranks_per_node: int
    saturated: float  # slowdown of a rank on a full node against a rank alone
    saturated_range: tuple[float, float] | None = None  # with ample and with scarce bandwidth
    source: str = ""


@dataclass(frozen=True)
class Solver:
    """Cost and messages of a step: three measured constants, the others from the algorithm."""

    seconds_per_cell: float  # w, one rank alone
    pair_slowdown: float  # b(2), two ranks on one machine
    serial_seconds_per_cell: float  # s
    pressure_cycles: float  # GAMG cycles of a step, all correctors
    momentum_sweeps: float = 6.0  # three components, about two sweeps each
    # smoothing twice, residual, prolongation, interpolation and scaling
    halos_per_level: float = 6.0
    coarsest_iterations: float = 10.0  # of the solver of the coarsest level, two sums each
    coarsest_cells: float = 100.0  # of a rank, where agglomeration ends
    bytes_per_face: float = 8.0
    seconds_per_step: float = 0.0  # f


def _levels(cells: float, solver: Solver) -> float:
    """Multigrid levels on one rank; each level halves the cells."""
    return max(1.0, math.log2(max(cells, 2.0) / solver.coarsest_cells))


def _slowdown(ranks: int, solver: Solver, network: Network) -> float:
    """Slowdown b of a rank by the others of its node, interpolated in log2 of their number."""
    here = min(ranks, network.ranks_per_node)
    if here <= 1:
        return 1.0
    if here == 2:
        return solver.pair_slowdown
    share = math.log2(here / 2) / max(1.0, math.log2(network.ranks_per_node / 2))
    return solver.pair_slowdown + max(network.saturated - solver.pair_slowdown, 0.0) * share


def imbalance(cells: float, ranks: int, columns: float) -> float:
    """Largest load over the mean: each rank has whole columns, so half a column too many."""
    return 1.0 if ranks == 1 else 1.0 + 0.5 * ranks / max(columns, 1.0) + 0.01


def step_time(cells: float, ranks: int, columns: float, solver: Solver, network: Network) -> float:
    """Seconds of one step."""
    own = cells / ranks
    work = (
        solver.seconds_per_cell
        * own
        * _slowdown(ranks, solver, network)
        * imbalance(cells, ranks, columns)
    )
    serial = solver.serial_seconds_per_cell * cells + solver.seconds_per_step
    if ranks == 1:
        return work + serial
    depth = _levels(own, solver)
    layers = cells / columns
    # faces shared with neighbours: the rim of a square patch of columns, times the layers
    faces = 4.0 * math.sqrt(columns / ranks) * layers
    halos = solver.pressure_cycles * depth * solver.halos_per_level + solver.momentum_sweeps
    neighbours = min(6, ranks - 1)
    # each level has a quarter of the faces of the finer one: all have 4/3 of the finest
    carried = (
        solver.pressure_cycles * solver.halos_per_level * faces * solver.bytes_per_face * 4 / 3
    )
    messages = halos * neighbours * network.latency + carried / network.bandwidth
    sums = (
        solver.pressure_cycles
        * (2 + 2 * solver.coarsest_iterations)
        * network.latency
        * math.log2(ranks)
    )
    return work + serial + messages + sums


def useful_ranks(
    cells: float, columns: float, solver: Solver, network: Network, gain: float = 0.25
) -> int:
    """Largest useful number of ranks, a power of two, each with at least LEAST_CELLS.

    Twice as many would save less than the share `gain` of the time.
    """
    ranks = 1
    while 2 * ranks * LEAST_CELLS <= cells:
        now = step_time(cells, ranks, columns, solver, network)
        if step_time(cells, 2 * ranks, columns, solver, network) > (1 - gain) * now:
            return ranks
        ranks *= 2
    return ranks


def fit(one: dict[str, float], two: dict[str, float], network: Network) -> Solver:
    """The solver's constants from measured runs.

    one: a run on one rank, `cells`, `columns`, `step_s`, `cycles`, and parts of the step `serial_s`
    and `fixed_s`. two: a mesh on two ranks, `cells`, `columns`, seconds of a step on one rank
    (`alone_s`) and on two (`step_s`).
    """
    serial, fixed = one.get("serial_s", 0.0), one.get("fixed_s", 0.0)
    if not 0 <= serial + fixed < one["step_s"]:
        raise StageError(
            f"scaling.toml: serial_s + fixed_s = {serial + fixed:g} s is no part of a step of"
            f" {one['step_s']:g} s; correct them"
        )
    own = (one["step_s"] - serial - fixed) / one["cells"]
    solver = Solver(own, 1.0, serial / one["cells"], one["cycles"], seconds_per_step=fixed)
    shared = two["alone_s"] - fixed
    alone = replace(solver, seconds_per_cell=shared / two["cells"], serial_seconds_per_cell=0.0)
    ideal = step_time(two["cells"], 2, two["columns"], alone, network)
    work = shared / 2 * imbalance(two["cells"], 2, two["columns"])
    return replace(solver, pair_slowdown=max(1.0, 1.0 + (two["step_s"] - ideal) / work))
