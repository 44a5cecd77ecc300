"""One mesh interval in the solver: its case, mesh, time steps and guard, and the motion's part."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from tqdm import tqdm

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import PER_FINGER, Interval, IntervalMesh, read_meshes
from pipeline.openfoam.case_folder import LEAST_CELLS, Case
from pipeline.openfoam.displacement_files import Steps, remove_frames, write_frames
from pipeline.scene.current import lead_steps
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import resumable_case
from pipeline.solve.guards import Guard, guard_of
from piv.files.errors import StageError


@dataclass
class SolverInterval:
    """A mesh interval in the solver; `mesh` has its motion as far as it is known."""

    case: Case
    mesh: IntervalMesh
    steps: Steps
    guard: Guard

    @property
    def span(self) -> Interval:
        """Its times and the number of its mesh."""
        return self.mesh.interval


class KnownMotion:
    """The motion of a mesh interval that is known before the solver starts.

    A motion that the solver's loads make overrides all (pipeline/couple).
    """

    def __init__(self, part: SolverInterval) -> None:
        self.part = part

    def write_frames(self, quiet: bool) -> None:
        """Write the displacements that the solver reads."""
        if self.part.span.moving:
            times = self.part.steps.times
            frames = write_frames(self.part.case, self.part.mesh, times)
            for _ in tqdm(frames, desc="frames", total=len(times), disable=quiet or None):
                pass

    def begin(self, time: float) -> None:
        """Start the motion where the solver starts, at `time` (s)."""

    def answer(self, time: float, alive: Callable[[], bool]) -> None:
        """The solver has computed the step that ends at `time` (s)."""

    def end(self) -> None:
        """The solver has ended, or was stopped."""

    def finish(self) -> None:
        """The interval is solved to its end: the displacements are removed."""
        remove_frames(self.part.case)


def solver_intervals(scene: Scene, ranks: int, quiet: bool) -> list[SolverInterval]:
    """The mesh intervals of a scene in order, on as many `ranks` as pay, or as can resume.

    StageError where the motion of the wall is sure to exceed numerics.max_courant.
    """
    meshes = read_meshes(scene.out, read_kinematics(scene.out / "kinematics.h5").law)
    least = min(mesh.cells for mesh in meshes)
    useful = max(1, min(ranks, least // LEAST_CELLS))
    if useful < ranks and not quiet:
        print(f"solve: {least} cells are too few for {ranks} ranks; {useful} used")
    names = [scene.out / "case" / mesh.interval.name for mesh in meshes]
    case = Case(names[0], useful)
    case = resumable_case(case, meshes[0].interval.moving, quiet)
    limit, depth = scene.numerics.max_courant, scene.finger.width / PER_FINGER[scene.model.kind]
    parts = []
    for folder, mesh in zip(names, meshes, strict=True):
        steps = Steps.of(mesh.interval.begin, mesh.interval.end, scene.numerics.time_step)
        try:
            current = scene.current is not None
            guard = guard_of(folder, mesh, steps, limit, depth, scene.fluid, current)
            if guard.energy and lead_steps(scene):
                guard.energy.from_rest = False
        except ValueError as error:
            raise StageError(f"{scene.folder / 'scene.toml'}: {error}") from None
        parts.append(SolverInterval(replace(case, folder=folder), mesh, steps, guard))
    return parts
