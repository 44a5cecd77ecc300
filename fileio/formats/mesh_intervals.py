"""The mesh intervals of a run: spans of time, each with the planform mesh that serves in it, as the mesh stage chose them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.schema import Schema, Variable

PER_FINGER = {"2d": 1, "half": 2, "quarter": 2, "full": 1}  # computed parts of one, by `model`


@dataclass(frozen=True)
class Interval:
    """From `start` to `end` (s) results are those of mesh number `mesh` of planform.h5; its solver starts at `begin`.

    `begin` is earlier than `start` but for the first interval: the overlap. Not `moving`: the mesh stands still, also there.
    """

    index: int
    begin: float
    start: float
    end: float
    mesh: int
    moving: bool = True

    @property
    def name(self) -> str:
        """Its folder in case/ and its group in sweep.h5."""
        return f"interval_{self.index}"


SCHEMA = Schema(
    "planform",
    5,
    "delete it and run make again",
    (
        Variable(
            "interval_begin",
            "interval",
            "s",
            "when its solver starts: before interval_start by the overlap",
        ),
        Variable(
            "interval_start",
            "interval",
            "s",
            "where it begins: a whole number of time steps, without a gap",
        ),
        Variable("interval_end", "interval", "s", "where it ends"),
        Variable("interval_mesh", "interval", "1", "number of the mesh that serves"),
        Variable(
            "interval_moving",
            "interval",
            "1",
            "0: the mesh stands still, as in a long rest at the end of a run",
        ),
        Variable("model", "-", "", "`2d`, `quarter`, `half` or `full`"),
        Variable("mirror", "-", "1", "1: the planform ends at the plane x = 0 between two fingers"),
    ),
    (
        Variable(
            "shape_parameter",
            "shape_parameter",
            "Pa",
            "of the shapes that the mesh's intervals take",
        ),
        Variable(
            "points", "shape_parameter, node, axis", "m", "nodes of the planform in each shape"
        ),
        Variable("bend", "shape_parameter", "rad", "bend angle of each shape"),
        Variable("triangles", "triangle, corner3", "1", "nodes of each"),
        Variable(
            "quads",
            "quad, corner4",
            "1",
            "nodes of each; with both fingers the second half of the cells mirrors the first",
        ),
        Variable(
            "body", "triangle", "1", "number of the body in whose footprint it lies, 0 in the water"
        ),
        Variable(
            "body_name",
            "number",
            "",
            "`water`, `finger`, `object` (one per step of a sphere), `support`, `mirrored_finger`",
        ),
        Variable("body_half_width", "number", "m", "reach of each body in |z|"),
        Variable("wall", "wall_node", "1", "nodes of finger 0's outline, counter-clockwise"),
        Variable("material", "wall_node", "1", "their positions along the outline, point index"),
        Variable(
            "outer",
            "outer_node",
            "1",
            "nodes of the tank's outline, counter-clockwise from the lower left",
        ),
        Variable("levels", "level", "m", "z of the sweep; the same in all meshes"),
        Variable("corners", "-", "m", "x, y of the tank's lower left and upper right corner"),
    ),
)


def write_planform(
    path: Path, intervals: Sequence[Interval], attributes: dict[str, Any], meshes: Sequence[dict[str, Any]],
) -> None:  # fmt: skip
    """Write planform.h5: the intervals, `attributes` of the root, and variables and attributes of each mesh by name."""
    columns = {
        f"interval_{name}": np.array([getattr(interval, name) for interval in intervals])
        for name in ("begin", "start", "end", "mesh", "moving")
    }
    columns["interval_moving"] = columns["interval_moving"].astype(int)
    groups = {f"mesh_{number}": mesh for number, mesh in enumerate(meshes)}
    SCHEMA.write(path, columns | attributes, groups)


def read_intervals(out: Path) -> tuple[Interval, ...]:
    """The intervals of `planform.h5`, in order."""
    file = SCHEMA.read(out / "planform.h5")
    columns = [
        file[f"interval_{name}"].values.tolist()
        for name in ("begin", "start", "end", "mesh", "moving")
    ]
    return tuple(
        Interval(k, begin, start, end, mesh, bool(moving))
        for k, (begin, start, end, mesh, moving) in enumerate(zip(*columns, strict=True))
    )


def read_planform(out: Path, mesh: int) -> xr.Dataset:
    """One planform of `planform.h5`, loaded, with the attributes that all meshes share."""
    return SCHEMA.read(out / "planform.h5", f"mesh_{mesh}")


def read_planforms(path: Path) -> list[dict[str, np.ndarray]]:
    """The variables of all planforms of a planform.h5, in order."""
    count = int(SCHEMA.read(path)["interval_mesh"].max()) + 1
    planforms = [SCHEMA.read(path, f"mesh_{mesh}") for mesh in range(count)]
    return [
        {str(name): v.values for name, v in planform.variables.items()} for planform in planforms
    ]
