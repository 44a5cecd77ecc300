"""How long a run takes on n ranks, predicted (pipeline.study.scaling_model), and how many ranks pay.

Command: softfinger predict cases/pinch --level fine
"""

from __future__ import annotations

from dataclasses import replace

from pipeline.openfoam.ranks import LEAST_CELLS
from pipeline.runs.estimate import duration
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene
from pipeline.study.scaling_data import read_data, size
from pipeline.study.scaling_model import Network, fit, step_time, useful_ranks

RANKS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
WEAK_CELLS = 20000  # of a rank, in the weak-scaling column


def report(scene: Scene) -> str:
    """The prediction as text, with its assumptions."""
    cells, columns = size(scene)
    one, two, network = read_data()
    solver = fit(one, two, network)
    steps, factor = round(predicted(scene).steps), pressure_solves(scene) / one["correctors"]

    def seconds(n: int, network: Network = network) -> float:
        return factor * steps * step_time(cells, n, columns, solver, network)

    pays = useful_ranks(cells, columns, solver, network)
    spread, plural = "", "" if pays == 1 else "s"
    if network.saturated_range and pays > 2:
        ends = [seconds(pays, replace(network, saturated=end)) for end in network.saturated_range]
        spread = (
            f" ({' to '.join(map(duration, ends))}, by how well a node's memory feeds its ranks)"
        )
    lines = [
        f"{scene.level} {scene.name}: {cells} cells in {columns} columns, {steps} steps",
        "",
        "ranks     time   speed-up   efficiency   weak efficiency",
    ]
    base, per_cell = step_time(WEAK_CELLS, 1, 1, solver, network), columns / cells
    for n in (n for n in RANKS if n == 1 or n * LEAST_CELLS <= cells):
        weak = base / step_time(WEAK_CELLS * n, n, WEAK_CELLS * n * per_cell, solver, network)
        lines.append(
            f"{n:5d} {duration(seconds(n)):>8s} {seconds(1) / seconds(n):10.1f} {seconds(1) / seconds(n) / n:11.0%} {weak:16.0%}"
        )
    lines += [
        "",
        f"{scene.level} {scene.name}: about {duration(seconds(pays))} of solver on {pays} rank{plural}{spread}; more no longer pay"
        f" (twice as many would save less than a quarter, or have less than {LEAST_CELLS} cells each).",
        "",
        "Assumptions:",
        f"- one rank: {1e3 * solver.seconds_per_step:.0f} ms a step and {1e6 * solver.seconds_per_cell:.2f} µs per cell and step (measured, {int(one['cells'])} cells,"
        f" {one['cycles']:.1f} pressure cycles a step), in proportion to cells and pressure correctors;",
        f"- two ranks of a machine slow each other down by {solver.pair_slowdown - 1:.0%}"
        + (" (measured);" if two else " (not measured);"),
        f"- a full node ({network.ranks_per_node} ranks) by {network.saturated - 1:.0%}; latency {1e6 * network.latency:.1f} µs,"
        f" {network.bandwidth / 1e9:.2g} GB/s per rank: {network.source or 'pipeline/study/scaling.toml'};",
        f"- pictures of the sheet are collected by one rank: {1e9 * solver.serial_seconds_per_cell:.1f} ns per cell and step;",
        "- messages and sums of GAMG are counted, six halos per level and cycle; the machine is this one's kind, and idle.",
    ]
    return "\n".join(lines)


def pressure_solves(scene: Scene) -> int:
    """Pressure solves of a time step."""
    return scene.numerics.pressure_correctors * (1 + scene.numerics.non_orthogonal_correctors)


def solver_time(scene: Scene, cells: int) -> float:
    """The solver's time on one rank, s."""
    one, two, network = read_data()
    step = step_time(cells, 1, cells, fit(one, two, network), network)
    return pressure_solves(scene) / one["correctors"] * predicted(scene).steps * step
