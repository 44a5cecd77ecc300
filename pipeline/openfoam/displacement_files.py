"""The motion as OpenFOAM reads it: one field of point displacements per time step."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.formats.mesh_intervals import IntervalMesh
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.foamfile import END, binary_list, header, labels_of, write_bytes

FIELD = "wantedDisplacement"
PADDING = 3  # frames beyond the last time step

_BOUNDARY = b"""
boundaryField
{
    ".*"                { type calculated; }
    "proc.*"            { type processor; }
    sheet               { type %s; }
    back                { type %s; }
    mirror              { type symmetryPlane; }
}
"""


def time_name(time: float) -> str:
    """A time as OpenFOAM names its folder (timeFormat general, timePrecision 8)."""
    return f"{time:.8g}"


def steps_of(time: float, time_step: float) -> int:
    """Number of time steps in `time` s."""
    return round(time / time_step)


class Steps(NamedTuple):
    """Time steps of an interval: number of the first, times (s) with PADDING more at the end."""

    first: int
    times: ndarray

    @classmethod
    def of(cls, begin: float, end: float, time_step: float) -> "Steps":
        """Return the frames from `begin` to `end` (s)."""
        first, last = steps_of(begin, time_step), steps_of(end, time_step)
        return cls(first, time_step * np.arange(first, last + PADDING + 1))


def checkpoint_steps(wanted: float, time_step: float) -> int:
    """Time steps between two checkpoints, about `wanted` s apart: an even number.

    OpenFOAM's multigrid pairs the cells anew in each step, in alternating direction, which no file
    keeps: a solver that starts begins forward, as after an even number of steps.
    """
    return 2 * max(1, round(wanted / (2 * time_step)))


_HEADER = header("pointVectorField", "", FIELD, binary=True)


class Frames:
    """Writes fields of displacement for the ranks of a case.

    Only the points that drive the others have values; zeros elsewhere compress to almost nothing.
    """

    def __init__(self, case: Case, mesh: IntervalMesh) -> None:
        planform, sweep = mesh.planform, mesh.sweep
        self._case, kind = case, planform.attrs["model"]
        node, level = sweep["node"].values, sweep["level"].values
        driving = (level == 0) | ((level == planform.sizes["level"] - 1) & (kind == "full"))
        points = [np.arange(len(node))]
        if case.ranks > 1:
            addressing = case.contents("constant/polyMesh/pointProcAddressing")
            points = [labels_of(block) for block in addressing]
        self._driven = [(driving[p], node[p][driving[p]]) for p in points]
        kinds = (b"empty", b"empty") if kind == "2d" else (b"symmetryPlane", b"calculated")
        self._tail = b";\n" + _BOUNDARY % kinds + END

    def write(self, time: float, moved: ndarray | None) -> None:
        """Write `<time>/wantedDisplacement`; `moved` (node, 2) m: against the first shape.

        None: a small file, which holds the place of one that is written later.
        """
        head = b"dimensions [0 1 0 0 0 0 0];\n\ninternalField "
        bodies = []
        for drives, nodes in self._driven:
            values = b"uniform (0 0 0)"
            if moved is not None:
                displacement = np.zeros((len(drives), 3))
                displacement[drives, :2] = moved[nodes]
                values = b"nonuniform List<vector> " + binary_list(displacement)
            bodies.append(head + values + self._tail)
        for folder, body in zip(self._case.folders, bodies, strict=True):
            # thousands of files, so without a sync: the solver refuses one that a power cut emptied
            content = _HEADER + body
            write_bytes(folder / time_name(time) / FIELD, content, compress=True, sync=False)


def write_frames(case: Case, mesh: IntervalMesh, times: ndarray) -> Iterator[float]:
    """Write the frames of a known motion for all `times` (s); yields them."""
    frames = Frames(case, mesh)
    start = mesh.motion.nodes(times[0])
    for time in times:
        frames.write(time, mesh.motion.nodes(time) - start)
        yield time


def frames_laid(case: Case) -> bool:
    """Whether frames lie in a case; they are all removed together."""
    return any(case.folders[0].glob(f"*/{FIELD}*"))


def remove_frames(case: Case) -> None:
    """Remove the frames, and the folders that hold nothing else."""
    for folder in case.folders:
        for path in folder.glob(f"*/{FIELD}*"):
            path.unlink()
            if not any(path.parent.iterdir()):
                path.parent.rmdir()
