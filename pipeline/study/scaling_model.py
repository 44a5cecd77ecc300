"""How long a time step takes on n ranks: a model of work, halo exchange and global sums, and its fit to measured runs.

Time of a step on n ranks, N cells:

    t(n) = f  +  w N/n · b(n) · i(n)  +  s N  +  m(N/n) · [latency of halo messages + their bytes / bandwidth]  +  r · latency · log2 n

f: what a step costs however few its cells are (measured); w: seconds per cell of one rank alone (measured); b: how much ranks of one node slow each other down for want of memory
bandwidth (measured on 2 ranks; beyond a node's saturation, from the literature); i: imbalance of whole columns; s: what
one rank does for all (the sheet's pictures; measured); messages m and sums r by counting what PISO with GAMG sends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pipeline.openfoam.ranks import LEAST_CELLS


@dataclass(frozen=True)
class Network:
    """What carries messages between nodes, and how many ranks a node's memory feeds."""

    latency: float  # s per message
    bandwidth: float  # bytes/s per rank
    ranks_per_node: int
    saturated: float  # slow-down of a rank on a full node against a rank alone
    # from a node whose memory feeds all to one that does not
    saturated_range: tuple[float, float] | None = None
    source: str = ""


@dataclass(frozen=True)
class Solver:
    """What a step costs and sends; all but the first three are counted from the algorithm."""

    seconds_per_cell: float  # w, one rank alone
    pair_slowdown: float  # b(2), two ranks on one machine
    serial_seconds_per_cell: float  # s
    pressure_cycles: float  # GAMG cycles of a step, all correctors
    momentum_sweeps: float = 6.0  # three components, about two sweeps each
    halos_per_level: float = (
        6.0  # smoothing twice, residual, prolongation, interpolation and scaling
    )
    coarsest_iterations: float = 10.0  # of the solver of the coarsest level, two sums each
    coarsest_cells: float = 100.0  # of a rank, where agglomeration ends
    bytes_per_face: float = 8.0
    seconds_per_step: float = 0.0  # f


def levels(cells: float, solver: Solver) -> float:
    """Levels of the multigrid on one rank: it halves the cells until few are left."""
    return max(1.0, math.log2(max(cells, 2.0) / solver.coarsest_cells))


def slowdown(ranks: int, solver: Solver, network: Network) -> float:
    """How much slower a rank works among the others of its node: measured on two, literature on a full node."""
    here = min(ranks, network.ranks_per_node)
    if here <= 1:
        return 1.0
    if here == 2:
        return solver.pair_slowdown
    share = math.log2(here / 2) / max(1.0, math.log2(network.ranks_per_node / 2))
    return solver.pair_slowdown + max(network.saturated - solver.pair_slowdown, 0.0) * share


def imbalance(cells: float, ranks: int, columns: float) -> float:
    """Largest load over the mean: whole columns are handed out, so that a rank has half a column too many or few."""
    return 1.0 if ranks == 1 else 1.0 + 0.5 * ranks / max(columns, 1.0) + 0.01


def step_time(cells: float, ranks: int, columns: float, solver: Solver, network: Network) -> float:
    """Seconds of one step."""
    own = cells / ranks
    work = (
        solver.seconds_per_cell
        * own
        * slowdown(ranks, solver, network)
        * imbalance(cells, ranks, columns)
    )
    serial = solver.serial_seconds_per_cell * cells + solver.seconds_per_step
    if ranks == 1:
        return work + serial
    depth = levels(own, solver)
    layers = cells / columns
    # a rank's share of the planform is a patch of columns; its rim, times the layers, is what it shares
    faces = 4.0 * math.sqrt(columns / ranks) * layers
    halos = solver.pressure_cycles * depth * solver.halos_per_level + solver.momentum_sweeps
    neighbours = min(6, ranks - 1)
    # coarse levels have a quarter of the faces of the finer one or so: 4/3 of the finest in all
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
    """Most ranks (a power of two) that still pay: twice as many would save less than `gain` of the time, or be refused.

    The run stage gives no rank fewer than LEAST_CELLS.
    """
    ranks = 1
    while 2 * ranks * LEAST_CELLS <= cells:
        now = step_time(cells, ranks, columns, solver, network)
        if step_time(cells, 2 * ranks, columns, solver, network) > (1 - gain) * now:
            return ranks
        ranks *= 2
    return ranks


def fit(one: dict[str, float], two: dict[str, float] | None, network: Network) -> Solver:
    """The solver's constants: from a run on one rank `cells`, `columns`, `step_s`, `cycles` and, of its step, `serial_s`, `fixed_s`;
    from a mesh run on two as well `cells`, `columns`, `alone_s` and `step_s`, seconds of a step on one rank and on two.

    Raises ValueError where the numbers do not fit each other.
    """
    serial, fixed = one.get("serial_s", 0.0), one.get("fixed_s", 0.0)
    if not (serial >= 0 and fixed >= 0 and serial + fixed < one["step_s"]):
        raise ValueError(
            f"serial_s = {serial} s and fixed_s = {fixed} s are no parts of a step of {one['step_s']} s"
        )
    own = (one["step_s"] - serial - fixed) / one["cells"]
    solver = Solver(own, 1.0, serial / one["cells"], one["cycles"], seconds_per_step=fixed)
    if two is None:
        return solver
    shared = two["alone_s"] - fixed
    alone = replace(solver, seconds_per_cell=shared / two["cells"], serial_seconds_per_cell=0.0)
    ideal = step_time(two["cells"], 2, two["columns"], alone, network)
    work = shared / 2 * imbalance(two["cells"], 2, two["columns"])
    return replace(solver, pair_slowdown=max(1.0, 1.0 + (two["step_s"] - ideal) / work))
