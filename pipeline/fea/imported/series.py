"""Displacement fields of VTU and PVD (PyVista) and XDMF series (meshio)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pyvista

from pipeline.fea.imported.importing import Fields
from pipeline.fea.settings import Import


def read_vtk(path: Path, given: Import) -> Fields:
    """All states of a .pvd, or of name-numbered .vtu beside each other (`file` with a *); raises ValueError."""
    meshes: list[Any] = []
    if path.suffix == ".pvd":
        reader = pyvista.PVDReader(path)
        times = [float(t) for t in reader.time_values]
        for time in times:
            reader.set_active_time_value(time)
            block = reader.read()
            meshes.append(
                block.combine()
                if isinstance(block, pyvista.MultiBlock) and block.n_blocks > 1
                else block[0]
            )
    else:
        files = sorted(path.parent.glob(path.name))
        times = [float(k + 1) for k in range(len(files))]
        meshes = [pyvista.read(file) for file in files]
    if not meshes:
        raise ValueError(f"{path}: no file of that name: set file in [fea.results]")
    return _fields(path, given, meshes[0].points, times, [mesh.point_data for mesh in meshes])


def read_xdmf(path: Path, given: Import) -> Fields:
    """All steps of an XDMF time series; raises ValueError."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, _ = reader.read_points_cells()
        steps = [reader.read_data(step) for step in range(reader.num_steps)]
    return _fields(
        path, given, points, [float(step[0]) for step in steps], [step[1] for step in steps]
    )


def _fields(
    path: Path, given: Import, points: Any, times: list[float], states: list[Mapping]
) -> Fields:
    """The displacements among the point data of each state."""
    fields = []
    for number, data in enumerate(states, 1):
        if given.displacement_field not in data:
            known = ", ".join(data.keys()) or "none"
            raise ValueError(
                f"{path}: state {number} has no point data {given.displacement_field!r} (it has: {known}): set displacement_field"
            )
        fields.append(np.asarray(data[given.displacement_field], dtype=float))
        if len(fields[-1]) != len(points):
            raise ValueError(
                f"{path}: state {number} has {len(fields[-1])} nodes, the first one {len(points)}: export the same mesh for every state"
            )
    return Fields(np.asarray(points, dtype=float), np.array(fields), np.array(times), {})
