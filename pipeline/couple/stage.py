"""Stage solve of a coupled run: the flow, the motion and the meshes, interval by interval."""

from functools import partial
from pathlib import Path

from pipeline.couple.follower import Follower
from pipeline.couple.motion import CoupledMotion
from pipeline.scene.scene import Scene
from pipeline.solve.interval import solver_intervals
from pipeline.solve.results import write_results
from pipeline.solve.solver import solve_intervals
from piv.files.errors import StageError
from piv.files.lock import exclusive


def run(
    scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None
) -> dict[str, float]:
    """Solve from the first guess of motion and meshes; as the stage solve, and write both anew."""
    if hosts is not None:
        raise StageError(f"hosts = {hosts}: a coupled run takes this machine alone; leave it out")
    motion = CoupledMotion(scene)
    with exclusive(scene.out / "solver"):
        parts = solver_intervals(scene, ranks, quiet)
        follower = partial(Follower, motion, [part.span for part in parts])
        spent = solve_intervals(scene, parts, follower, hosts, quiet)
        motion.write(parts)
        return write_results(scene, parts, spent, quiet)
