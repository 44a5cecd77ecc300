"""Motion of the planform's nodes: shapes of the mesh stage, driven by the pressure law."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fileio.formats.kinematics import read_kinematics
from fileio.formats.mesh_intervals import read_planform

if TYPE_CHECKING:  # slow to import: who reads no motion needs none
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True)
class NodeMotion:
    """Twice continuously differentiable motion of nodes, exact at the knots of the parameter."""

    pressure: CubicSpline
    shape: CubicSpline

    def nodes(self, time: float) -> np.ndarray:
        """Positions (node, 2) at `time` s, m; at rest before 0."""
        return self.shape(float(self.pressure(max(time, 0.0))))

    def velocity(self, time: float) -> np.ndarray:
        """Velocities (node, 2) at `time` s, m/s."""
        if time <= 0:
            return np.zeros(self.shape.c.shape[2:])
        return self.shape(float(self.pressure(time)), 1) * float(self.pressure(time, 1))


def read_motion(out: Path, mesh: int = 0) -> NodeMotion:
    """Motion of one mesh's nodes, from kinematics.h5 and planform.h5 of a level's folder."""
    from scipy.interpolate import CubicSpline

    law = read_kinematics(out / "kinematics.h5").law
    planform = read_planform(out, mesh)
    return NodeMotion(
        law, CubicSpline(planform["shape_parameter"].values, planform["points"].values)
    )
