"""Prediction of a run's time on n ranks, and of the useful number of ranks."""

from __future__ import annotations

from dataclasses import replace

from pipeline.openfoam.ranks import LEAST_CELLS
from pipeline.runs.estimate import duration
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene
from pipeline.study.scaling_data import read_data, size
from pipeline.study.scaling_model import Network, fit, step_time, useful_ranks

_RANKS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_WEAK_CELLS = 20000  # of a rank, in the weak-scaling column


def report(scene: Scene) -> str:
    """The prediction as text, with its assumptions."""
    cells, columns = size(scene)
    one, two, network = read_data()
    solver = fit(one, two, network)
    numerics = scene.numerics
    solves = numerics.pressure_correctors * (1 + numerics.non_orthogonal_correctors)
    steps, factor = round(predicted(scene).steps), solves / one["correctors"]

    def seconds(n: int, network: Network = network) -> float:
        return factor * steps * step_time(cells, n, columns, solver, network)

    pays = useful_ranks(cells, columns, solver, network)
    spread, plural = "", "" if pays == 1 else "s"
    if network.saturated_range and pays > 2:
        ends = [seconds(pays, replace(network, saturated=end)) for end in network.saturated_range]
        spread = f" ({' to '.join(map(duration, ends))}, by the memory bandwidth of a node)"
    lines = [
        f"{scene.level} {scene.name}: {cells} cells in {columns} columns, {steps} steps",
        "",
        "ranks     time   speed-up   efficiency   weak efficiency",
    ]
    base, columns_per_cell = step_time(_WEAK_CELLS, 1, 1, solver, network), columns / cells
    for n in (n for n in _RANKS if n == 1 or n * LEAST_CELLS <= cells):
        weak = base / step_time(
            _WEAK_CELLS * n, n, _WEAK_CELLS * n * columns_per_cell, solver, network
        )
        speed_up = seconds(1) / seconds(n)
        time = duration(seconds(n))
        lines.append(f"{n:5d} {time:>8s} {speed_up:10.1f} {speed_up / n:11.0%} {weak:16.0%}")
    fixed, per_cell = 1e3 * solver.seconds_per_step, 1e6 * solver.seconds_per_cell
    lines += [
        "",
        f"{scene.level} {scene.name}: about {duration(seconds(pays))} of solver on {pays}"
        f" rank{plural}{spread}; more no longer pay (twice as many would save less than a quarter,"
        f" or have less than {LEAST_CELLS} cells each).",
        "",
        "Assumptions:",
        f"- one rank: {fixed:.0f} ms a step and {per_cell:.2f} µs per cell and step (measured,"
        f" {int(one['cells'])} cells, {one['cycles']:.1f} pressure cycles a step), in proportion to"
        " cells and pressure correctors;",
        f"- two ranks of a machine slow each other down by {solver.pair_slowdown - 1:.0%}"
        " (measured);",
        f"- a full node ({network.ranks_per_node} ranks) by {network.saturated - 1:.0%}; latency"
        f" {1e6 * network.latency:.1f} µs, {network.bandwidth / 1e9:.2g} GB/s per rank:"
        f" {network.source or 'pipeline/study/scaling.toml'};",
        "- one rank collects the pictures of the sheet:"
        f" {1e9 * solver.serial_seconds_per_cell:.1f} ns per cell and step;",
        "- messages and sums of GAMG are counted, six halos per level and cycle; the machine is"
        " like this one, and idle.",
    ]
    return "\n".join(lines)
