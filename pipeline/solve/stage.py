"""Stage solve: the solver, interval by interval; it resumes, guards and writes tables."""

from pathlib import Path

from pipeline.scene.scene import Scene
from pipeline.solve.interval import KnownMotion, solver_intervals
from pipeline.solve.results import write_results
from pipeline.solve.solver import solve_intervals
from piv.files.lock import exclusive


def run(
    scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None
) -> dict[str, float]:
    """Solve and write the tables of run/; returns the cost of interrupted runs."""
    with exclusive(scene.out / "solver"):
        parts = solver_intervals(scene, ranks, quiet)
        spent = solve_intervals(scene, parts, KnownMotion, hosts, quiet)
        return write_results(scene, parts, spent, quiet)
