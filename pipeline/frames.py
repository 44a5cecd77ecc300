"""The motion as OpenFOAM reads it: one field of point displacements per time step."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.foamfile import END, binary_list, header, write_bytes
from pipeline.motion import NodeMotion

FIELD = "wantedDisplacement"
PADDING = 3  # frames beyond the last time step

BOUNDARY = b"""
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


def checkpoint_interval(duration: float, wanted: float) -> float:
    """Interval (s) near `wanted` that divides `duration`, so that its end is saved; no whole number of steps is needed."""
    return duration / max(1, round(duration / wanted)) if duration > 1e-9 else wanted


def frame_content(displacement: np.ndarray, flat: bool) -> bytes:
    """A pointVectorField file with internal values (point, 3) m."""
    kinds = (b"empty", b"empty") if flat else (b"symmetryPlane", b"calculated")
    head = header("pointVectorField", "", FIELD, binary=True)
    field = b"dimensions [0 1 0 0 0 0 0];\n\ninternalField nonuniform List<vector> "
    return head + field + binary_list(displacement) + b";\n" + BOUNDARY % kinds + END


def write_frames(case: Path, motion: NodeMotion, node: np.ndarray, driving: np.ndarray, time_step: float,
                 first: int, last: int, flat: bool) -> None:  # fmt: skip
    """Lay `<time>/wantedDisplacement` for the steps `first` to `last` into `case` (or one processor's folder).

    Displacements are relative to the shape at `first`. `node` (point,) maps mesh points to planform nodes; only
    `driving` points (on walls that drive a column) carry values, the others stay zero so that the files compress to
    almost nothing.
    """
    start = motion.nodes(first * time_step)
    moved = node[driving]
    for step in range(first, last + PADDING + 1):
        displacement = np.zeros((len(node), 3))
        displacement[driving, :2] = (motion.nodes(step * time_step) - start)[moved]
        write_bytes(
            case / time_name(step * time_step) / FIELD, frame_content(displacement, flat), compress=True
        )


def remove_frames(case: Path) -> None:
    """Take the frames away again, and the folders that hold nothing else."""
    for path in case.glob(f"*/{FIELD}*"):
        path.unlink()
        if not any(path.parent.iterdir()):
            path.parent.rmdir()
