"""The meshes of a run, `planform.h5` and `sweep.h5`: intervals of time, each with its mesh."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.schema import Schema, variables

if TYPE_CHECKING:  # slow to import: who reads no motion needs none
    from scipy.interpolate import BSpline, CubicSpline

PER_FINGER = {"2d": 1, "half": 2, "quarter": 2, "full": 1}  # computed parts of one, by `model`


@dataclass(frozen=True)
class Interval:
    """Results from `start` to `end` (s) are those of mesh number `mesh`.

    Its solver starts at `begin`: earlier by the overlap, but for the first interval. Where it is
    not `moving`, the mesh stands still, also in the overlap.
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


@dataclass(frozen=True)
class NodeMotion:
    """Twice continuously differentiable motion of nodes, exact at the knots of the parameter."""

    pressure: "CubicSpline"
    shape: "CubicSpline | BSpline"

    @classmethod
    def of(cls, law: "CubicSpline", planform: xr.Dataset) -> "NodeMotion":
        """Motion of a planform's nodes by a law of its shape parameter over time (s)."""
        from scipy.interpolate import CubicSpline

        return cls(law, CubicSpline(planform["shape_parameter"].values, planform["points"].values))

    def nodes(self, time: float) -> ndarray:
        """Positions (node, 2) at `time` s, m; at rest before 0."""
        return self.shape(float(self.pressure(max(time, 0.0))))

    def velocity(self, time: float) -> ndarray:
        """Velocities (node, 2) at `time` s, m/s."""
        if time <= 0:
            return np.zeros_like(self.nodes(0.0))
        return self.shape(float(self.pressure(time)), 1) * float(self.pressure(time, 1))


@dataclass(frozen=True)
class IntervalMesh:
    """The moving mesh of one interval: its planform, its sweep and its nodes' motion."""

    interval: Interval
    planform: xr.Dataset
    sweep: xr.Dataset
    motion: NodeMotion

    @property
    def cells(self) -> int:
        """Number of cells of the swept mesh."""
        return int(self.sweep.sizes["cell"])


_COLUMNS = [f"interval_{name}" for name in ("begin", "start", "end", "mesh", "moving")]
SCHEMA = Schema(
    "planform",
    variables("""
interval_begin  interval  s  when its solver starts: before interval_start by the overlap
interval_start  interval  s  where it begins: a whole number of time steps, without a gap
interval_end  interval  s  where it ends
interval_mesh  interval  1  number of the mesh that serves
interval_moving  interval  1  0: the mesh stands still, as in a long rest at the end of a run
model  -  -  `2d`, `quarter`, `half` or `full`
mirror  -  1  1: the planform ends at the plane x = 0 between two fingers
"""),
    variables("""
shape_parameter  shape_parameter  Pa  of the shapes that the mesh's intervals take
points  shape_parameter, node, axis  m  nodes of the planform in each shape
bend  shape_parameter  rad  bend angle of each shape
built?  node, axis  m  nodes as the planform was built, of a coupled run
fixed?  node, axis  1  coupled run: 1 where a coordinate of a node is prescribed
triangles  triangle, corner3  1  nodes of each
quads  quad, corner4  1  nodes of each; with both fingers the second half mirrors the first
body  triangle  1  number of the body in whose footprint it lies, 0 in the water
body_name  number  -  `water`, `finger`, `object` (one per step of a sphere), `support`,
  `mirrored_finger`
body_half_width  number  m  reach of each body in |z|
wall  wall_node  1  nodes of finger 0's outline, counter-clockwise
material  wall_node  1  their positions along the outline, point index
outer  outer_node  1  nodes of the tank's outline, counter-clockwise from the lower left
levels  level  m  z of the sweep; the same in all meshes
corners  -  m  x, y of the tank's lower left and upper right corner
"""),
)


SWEEP = Schema(
    "sweep",
    (),
    variables("""
node  point  1  planform node of each mesh point
level  point  1  level of each mesh point, from the back wall
cell_column  cell  1  planform cell of each mesh cell
cell_layer  cell  1  layer of each mesh cell, from the back wall
"""),
)


def write_planform(
    path: Path,
    intervals: Sequence[Interval],
    attributes: dict[str, Any],
    meshes: Sequence[dict[str, Any]],
) -> None:
    """Write planform.h5: intervals, `attributes` of the root, values of the meshes by name."""
    columns = dict(
        zip(_COLUMNS, zip(*(astuple(i)[1:] for i in intervals), strict=True), strict=True)
    )
    arrays = {name: np.array(values) for name, values in columns.items()}
    arrays["interval_moving"] = arrays["interval_moving"].astype(int)
    groups = {f"mesh_{number}": mesh for number, mesh in enumerate(meshes)}
    SCHEMA.write(path, arrays | attributes, groups)


def read_intervals(folder: Path) -> tuple[Interval, ...]:
    """The intervals of the planform.h5 in a folder, in order."""
    file = SCHEMA.read(folder / "planform.h5")
    rows = zip(*(file[name].values.tolist() for name in _COLUMNS), strict=True)
    return tuple(Interval(k, b, s, e, mesh, bool(m)) for k, (b, s, e, mesh, m) in enumerate(rows))


def read_planform(folder: Path, mesh: int) -> xr.Dataset:
    """One planform of the planform.h5 in a folder, loaded, with the attributes that all share."""
    return SCHEMA.read(folder / "planform.h5", f"mesh_{mesh}")


def read_planforms(path: Path) -> list[dict[str, ndarray]]:
    """The variables of all planforms of a planform.h5, in order."""
    count = int(SCHEMA.read(path)["interval_mesh"].max()) + 1
    planforms = [SCHEMA.read(path, f"mesh_{mesh}") for mesh in range(count)]
    return [{str(name): v.values for name, v in p.variables.items()} for p in planforms]


def read_sweep(out: Path, case: str) -> xr.Dataset:
    """The mesh of one case of a level's sweep.h5, loaded."""
    return SWEEP.read(out / "sweep.h5", case)


def read_meshes(out: Path, law: "CubicSpline") -> list[IntervalMesh]:
    """The mesh of each interval, of planform.h5 and sweep.h5 of a level's folder.

    `law`: the shape parameter over time (s), that of the motion.
    """
    intervals = read_intervals(out)
    planforms = {mesh: read_planform(out, mesh) for mesh in {i.mesh for i in intervals}}
    motions = {mesh: NodeMotion.of(law, planform) for mesh, planform in planforms.items()}
    return [
        IntervalMesh(i, planforms[i.mesh], read_sweep(out, i.name), motions[i.mesh])
        for i in intervals
    ]
