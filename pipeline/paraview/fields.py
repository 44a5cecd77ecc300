"""The fields that a run has written, as grids at any instant of the run."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista as pv
from numpy import ndarray

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import (
    Interval,
    NodeMotion,
    read_intervals,
    read_planform,
    read_sweep,
)
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.polymesh_files import read_faces
from pipeline.paraview.grids import Box, Topology, topology, walls, water
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import prepared_case, saved_field, saved_times


class Instant(NamedTuple):
    """A time (s) with all fields, the interval and case that they are of, and their file."""

    time: float
    interval: Interval
    case: Case
    file: Path


class RunFields:
    """Velocity and pressure of a run at and between its `instants`, on the mesh as it moves.

    The instants ascend from rest at 0 on; an overlap belongs to the earlier interval. There are
    none where no run has written its fields.
    """

    def __init__(self, scene: Scene) -> None:
        self.out, self.density = scene.out, scene.fluid.density
        self._motion = scene.motion_folder
        self.instants = tuple(self._instants())
        self._mesh = lru_cache(maxsize=1)(self._read_mesh)
        self._values = lru_cache(maxsize=2)(self._read_values)

    def _instants(self) -> Iterator[Instant]:
        if not ((self._motion / "planform.h5").exists() and (self.out / "case").exists()):
            return
        for interval in read_intervals(self._motion):
            case = prepared_case(self.out / "case" / interval.name)
            saved = saved_times(case, ("U", "p"))
            if saved and interval.start == 0.0:
                yield Instant(0.0, interval, case, self._motion / "planform.h5")
            for time, name in saved:
                if time > interval.start + 1e-9:
                    yield Instant(time, interval, case, case.folders[-1] / name / "U")

    def grids(
        self, time: float, box: Box | None = None
    ) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
        """Water (in a box) and walls at a time (s): cells where they are then.

        Values are linear in time between two instants, cell by cell.
        """
        after = next((i for i in self.instants if i.time >= time - 1e-9), self.instants[-1])
        earlier = [i for i in self.instants if i.interval == after.interval and i.time <= time]
        before = earlier[-1] if earlier else after
        mesh, motion, nodes, z = self._mesh(after.interval)
        points = np.column_stack([motion.nodes(time)[nodes], z])
        velocity, pressure = self._values(after)
        if before.time < time < after.time:
            share = (time - before.time) / (after.time - before.time)
            first = self._values(before)
            velocity = (1 - share) * first[0] + share * velocity
            pressure = (1 - share) * first[1] + share * pressure
        return water(mesh, points, velocity, pressure, box), walls(mesh, points, pressure)

    def _read_mesh(self, interval: Interval) -> tuple[Topology, NodeMotion, ndarray, ndarray]:
        """Topology, motion, and each point's node of the planform and z (m)."""
        planform, sweep = (
            read_planform(self._motion, interval.mesh),
            read_sweep(self.out, interval.name),
        )
        motion = NodeMotion.of(read_kinematics(self._motion / "kinematics.h5").law, planform)
        faces = read_faces(self.out / "case" / interval.name / "constant" / "polyMesh")
        z = planform["levels"].values[sweep["level"].values]
        return topology(planform, sweep, faces), motion, sweep["node"].values, z

    def _read_values(self, instant: Instant) -> tuple[ndarray, ndarray]:
        """Velocity (cell, 3; m/s) and pressure (cell; Pa); at 0 the water is at rest."""
        cells = len(self._mesh(instant.interval)[0].types)
        if instant.time == 0:
            return np.zeros((cells, 3)), np.zeros(cells)
        name = instant.file.parent.name
        velocity, pressure = (
            saved_field(instant.case, f"{name}/{field}", cells) for field in ("U", "p")
        )
        return velocity, self.density * pressure
