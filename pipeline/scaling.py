"""How long a run takes on n ranks: a model of work, halo exchange and global sums, fitted to measured runs.

Command: python -m pipeline.scaling cases/pinch --level fine (make predict SCENE=pinch LEVEL=fine)

Time of a step on n ranks, N cells:
    t(n) = w N/n · b(n) · i(n)  +  s N  +  m(N/n) · [latency of halo messages + their bytes / bandwidth]  +  r · latency · log2 n
w: seconds per cell of one rank alone (measured); b: how much ranks of one node slow each other down for want of memory
bandwidth (measured on 2 ranks; beyond a node's saturation, from the literature); i: imbalance of whole columns; s: what
one rank does for all (the sheet's pictures; measured); messages m and sums r by counting what PISO with GAMG sends.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import tomllib
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.errors import StageError
from pipeline.legs import read_legs
from pipeline.ranks import LEAST_CELLS
from pipeline.scene import Scene, load_scene
from pipeline.stage import guarded, parser, read_dataset

MEASURED = {"cells", "columns", "correctors", "step_s", "pressure_iterations"}  # of steps.csv
WEAK_CELLS = 20000  # of a rank, in the weak-scaling column
DATA = Path(__file__).with_name("scaling.toml")
STEPS = Path(__file__).resolve().parent.parent / "docs" / "tradeoff" / "steps.csv"  # of make bench-steps


@dataclass(frozen=True)
class Network:
    """What carries messages between nodes, and how many ranks a node's memory feeds."""

    latency: float  # s per message
    bandwidth: float  # bytes/s per rank
    ranks_per_node: int
    saturated: float  # slow-down of a rank on a full node against a rank alone
    saturated_range: tuple[float, float] | None = (
        None  # from a node whose memory feeds all to one that does not
    )
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
        6.0  # smoothing before and after, residual, prolongation, interpolation and scaling
    )
    coarsest_iterations: float = 10.0  # of the solver of the coarsest level, two sums each
    coarsest_cells: float = 100.0  # of a rank, where agglomeration ends
    bytes_per_face: float = 8.0


def levels(cells: float, solver: Solver) -> float:
    """Levels of the multigrid on one rank: it halves the cells until few are left."""
    return (
        max(1.0, math.log2(max(cells, 2.0) / solver.coarsest_cells)) if cells > solver.coarsest_cells else 1.0
    )


def slowdown(ranks: int, solver: Solver, network: Network) -> float:
    """How much slower a rank works among the others of its node: measured on two, literature on a full node."""
    here = min(ranks, network.ranks_per_node)
    if here <= 1:
        return 1.0
    if here == 2:
        return solver.pair_slowdown
    share = math.log2(here / 2) / max(1.0, math.log2(network.ranks_per_node / 2))
    return (
        solver.pair_slowdown + (max(network.saturated, solver.pair_slowdown) - solver.pair_slowdown) * share
    )


def imbalance(cells: float, ranks: int, columns: float) -> float:
    """Largest load over the mean: whole columns are handed out, so that a rank has half a column too many or few."""
    return 1.0 if ranks == 1 else 1.0 + 0.5 * ranks / max(columns, 1.0) + 0.01


def step_time(cells: float, ranks: int, columns: float, solver: Solver, network: Network) -> float:
    """Seconds of one step."""
    own = cells / ranks
    work = solver.seconds_per_cell * own * slowdown(ranks, solver, network) * imbalance(cells, ranks, columns)
    serial = solver.serial_seconds_per_cell * cells
    if ranks == 1:
        return work + serial
    depth = levels(own, solver)
    layers = cells / columns
    # a rank's share of the planform is a patch of columns; its rim, times the layers, is what it shares
    faces = 4.0 * math.sqrt(columns / ranks) * layers
    halos = solver.pressure_cycles * depth * solver.halos_per_level + solver.momentum_sweeps
    neighbours = min(6, ranks - 1)
    # coarse levels have a quarter of the faces of the finer one or so: 4/3 of the finest in all
    carried = solver.pressure_cycles * solver.halos_per_level * faces * solver.bytes_per_face * 4 / 3
    messages = halos * neighbours * network.latency + carried / network.bandwidth
    sums = solver.pressure_cycles * (2 + 2 * solver.coarsest_iterations) * network.latency * math.log2(ranks)
    return work + serial + messages + sums


def useful_ranks(cells: float, columns: float, solver: Solver, network: Network, gain: float = 0.25) -> int:
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
    """The solver's constants: from a run on one rank `cells`, `columns`, `step_s`, `cycles` and, of its step, `serial_s`;
    from a mesh run on two as well `cells`, `columns`, `alone_s` and `step_s`, seconds of a step on one rank and on two.

    Raises ValueError where the numbers do not fit each other.
    """
    serial = one.get("serial_s", 0.0)
    if not 0 <= serial < one["step_s"]:
        raise ValueError(f"serial_s = {serial} s is no part of a step of {one['step_s']} s")
    solver = Solver((one["step_s"] - serial) / one["cells"], 1.0, serial / one["cells"], one["cycles"])
    if two is None:
        return solver
    alone = replace(solver, seconds_per_cell=two["alone_s"] / two["cells"], serial_seconds_per_cell=0.0)
    ideal = step_time(two["cells"], 2, two["columns"], alone, network)
    work = two["alone_s"] / 2 * imbalance(two["cells"], 2, two["columns"])
    return replace(solver, pair_slowdown=max(1.0, 1.0 + (two["step_s"] - ideal) / work))


def read_steps(
    path: Path, serial_seconds_per_cell: float
) -> tuple[dict[str, float], dict[str, float]] | None:
    """What `make bench-steps` measured of a step on one rank and on two, for `fit`; None where it was not run."""
    if not path.exists():
        return None
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = {
        row["ranks"]: row
        for row in csv.DictReader(lines)
        if (row["mesh"], row["samples"]) == ("moving", "True")
    }
    try:
        one, two = (
            {key: float(value) for key, value in rows[n].items() if key in MEASURED} for n in ("1", "2")
        )
        mesh = {key: one[key] for key in ("cells", "columns")}
        serial = serial_seconds_per_cell * one["cells"]
        return (
            {**mesh, "correctors": one["correctors"], "step_s": one["step_s"], "serial_s": serial, "cycles": one["pressure_iterations"]},
            {**mesh, "alone_s": one["step_s"], "step_s": two["step_s"]},
        )  # fmt: skip
    except (KeyError, ValueError) as error:
        raise StageError(f"{path}: {error} is missing or no number; run make bench-steps again") from None


def read_data(
    path: Path = DATA, steps: Path = STEPS
) -> tuple[dict[str, float], dict[str, float] | None, Network]:
    """The runs measured by `make bench-steps`, or else those of scaling.toml, and its network."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    network = dict(table["network"])
    if "saturated_range" in network:
        network["saturated_range"] = tuple(network["saturated_range"])
    two = {key: value for key, value in table.get("two_ranks", {}).items() if key != "source"}
    one = table["one_rank"]
    measured_here = read_steps(steps, one.get("serial_s", 0.0) / one["cells"])
    return (*(measured_here or (one, two or None)), Network(**network))


def measured(case: Path, sampling: int) -> dict[str, float]:
    """What a run's log says of a step: CPU seconds of a rank (of the quiet quarter of the steps), pressure cycles.

    `serial_s` is what a picture of the sheet adds, spread over the `sampling` steps between two of them.
    """
    clock, cycles = [], []
    for line in (case / "log.pimpleFoam").read_text(errors="replace").splitlines():
        if line.startswith("Time = "):
            cycles.append(0)
        elif "Solving for p," in line and cycles:
            cycles[-1] += int(line.split()[-1])
        elif line.startswith("ExecutionTime"):
            clock.append(float(line.split()[2]))
    steps = [b - a for a, b in pairwise(clock)]  # step k + 1 is element k
    with_picture = [t for k, t in enumerate(steps) if (k + 2) % sampling == 0]
    plain = steps if sampling == 1 else [t for k, t in enumerate(steps) if (k + 2) % sampling]
    if len(plain) < 20 or not with_picture:
        raise StageError(f"{case}: {len(clock)} steps are too few to measure by; run more")
    quiet = _low(plain)
    picture = max(0.0, _low(with_picture) - quiet) if sampling > 1 else 0.0
    return {
        "step_s": quiet + picture / sampling,
        "serial_s": picture / sampling,
        "cycles": sum(cycles) / len(cycles),
    }


def _low(values: list[float]) -> float:
    """Mean of the lowest quarter but the very lowest: the clock of the log ticks in hundredths of a second."""
    ordered = sorted(values)
    part = ordered[1 : max(2, len(ordered) // 4)]
    return sum(part) / len(part)


def size(scene: Scene) -> tuple[int, int]:
    """Cells and columns of a scene's mesh, of its longest leg; StageError where it was not made."""
    leg = max(read_legs(scene.out), key=lambda leg: leg.end - leg.start)
    with read_dataset(scene.out / "sweep.h5", "sweep", leg.name) as sweep:
        column = sweep["cell_column"].values
    return len(column), len(np.unique(column))


def _duration(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min"


def report(scene: Scene, cells: int, columns: int, ranks: list[int]) -> str:
    """The prediction as text, with its assumptions."""
    one, two, network = read_data()
    solver = fit(one, two, network)
    steps = round(scene.motion.end_time / scene.numerics.time_step)
    correctors = scene.numerics.pressure_correctors * (1 + scene.numerics.non_orthogonal_correctors)
    factor = correctors / one.get("correctors", correctors)
    ranks = [n for n in ranks if n == 1 or n * LEAST_CELLS <= cells]
    hours = {n: factor * steps * step_time(cells, n, columns, solver, network) / 3600 for n in ranks}
    pays = useful_ranks(cells, columns, solver, network)
    best = factor * steps * step_time(cells, pays, columns, solver, network) / 3600
    spread = ""
    if network.saturated_range and pays > 2:
        ends = [
            factor * steps * step_time(cells, pays, columns, solver, replace(network, saturated=end)) / 3600
            for end in network.saturated_range
        ]
        spread = f" ({' to '.join(map(_duration, ends))}, by how well a node's memory feeds its ranks)"
    lines = [
        f"{scene.level} {scene.name}: {cells} cells in {columns} columns, {steps} steps of {scene.numerics.time_step * 1e3:g} ms",
        "",
        "ranks   hours   speed-up   efficiency   weak efficiency",
    ]
    alone = factor * steps * step_time(cells, 1, columns, solver, network) / 3600
    base, per_cell = step_time(WEAK_CELLS, 1, 1, solver, network), columns / cells
    for n, time in hours.items():
        weak = base / step_time(WEAK_CELLS * n, n, WEAK_CELLS * n * per_cell, solver, network)
        lines.append(f"{n:5d} {time:7.3g} {alone / time:10.1f} {alone / time / n:11.0%} {weak:16.0%}")
    lines += [
        "",
        f"{scene.level} {scene.name}: about {_duration(best)} on {pays} ranks{spread}; more than {pays} ranks no longer pay"
        f" (twice as many would save less than a quarter, or have less than {LEAST_CELLS} cells each).",
        "",
        "Assumptions:",
        f"- one rank: {1e6 * solver.seconds_per_cell:.2f} µs per cell and step (measured, {int(one['cells'])} cells,"
        f" {one['cycles']:.1f} pressure cycles a step), in proportion to cells and pressure correctors;",
        f"- two ranks of a machine slow each other down by {solver.pair_slowdown - 1:.0%}"
        + (" (measured);" if two else " (not measured);"),
        f"- a full node ({network.ranks_per_node} ranks) by {network.saturated - 1:.0%}; latency {1e6 * network.latency:.1f} µs,"
        f" {network.bandwidth / 1e9:.2g} GB/s per rank: {network.source or 'pipeline/scaling.toml'};",
        f"- pictures of the sheet are collected by one rank: {1e9 * solver.serial_seconds_per_cell:.1f} ns per cell and step;",
        "- messages and sums of GAMG are counted, six halos per level and cycle; the machine is this one's kind, and idle.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    arguments = parser("scaling", __doc__)
    arguments.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32, 64, 128, 256])
    arguments.add_argument("--json", action="store_true", help="seconds of a step by ranks, for programs")
    arguments.add_argument(
        "--measure",
        action="store_true",
        help="print this run's measured step, for pipeline/scaling.toml, instead",
    )
    args: argparse.Namespace = arguments.parse_args()

    def action() -> None:
        if min(args.ranks) < 1:
            raise StageError(f"--ranks {min(args.ranks)}: give 1 or more")
        scene = load_scene(args.scene, args.level)
        cells, columns = size(scene)
        numerics = scene.numerics
        if args.measure:
            step = measured(
                scene.out / "case" / read_legs(scene.out)[0].name,
                numerics.sampling_steps(scene.sheet.rate_hz),
            )
            correctors = numerics.pressure_correctors * (1 + numerics.non_orthogonal_correctors)
            print(f"cells = {cells}\ncolumns = {columns}\ncorrectors = {correctors}")
            print("\n".join(f"{key} = {value:.5g}" for key, value in step.items()))
        elif args.json:
            one, two, network = read_data()
            solver = fit(one, two, network)
            print(json.dumps({n: step_time(cells, n, columns, solver, network) for n in args.ranks}))
        else:
            print(report(scene, cells, columns, args.ranks))

    guarded("predict", action)


if __name__ == "__main__":
    main()
