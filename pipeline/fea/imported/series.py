"""Displacement fields of VTU and PVD (PyVista) and XDMF series (meshio)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pyvista

from pipeline.fea.imported.importing import Fields
from pipeline.fea.settings import Import


def read_vtk(path: Path, results: Import) -> Fields:
    """All states of a .pvd, or of .vtu files numbered by name (*); raises ValueError."""
    meshes: list[Any] = []
    if path.suffix == ".pvd":
        reader = pyvista.PVDReader(path)
        times = list(reader.time_values)
        for time in times:
            reader.set_active_time_value(time)
            block: Any = reader.read()
            meshes.append(block.combine() if block.n_blocks > 1 else block[0])
    else:
        meshes = [pyvista.read(file) for file in sorted(path.parent.glob(path.name))]
        times = list(range(1, len(meshes) + 1))
    if not meshes:
        raise ValueError(f"{path}: no file of that name: set file in [fea.results]")
    return _fields(path, results, meshes[0].points, times, [mesh.point_data for mesh in meshes])


def read_xdmf(path: Path, results: Import) -> Fields:
    """All steps of an XDMF time series; raises ValueError."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, _ = reader.read_points_cells()
        steps = [reader.read_data(step) for step in range(reader.num_steps)]
    return _fields(path, results, points, [step[0] for step in steps], [step[1] for step in steps])


def _fields(
    path: Path, results: Import, points: Any, times: list[float], states: list[Mapping]
) -> Fields:
    fields = []
    for number, data in enumerate(states, 1):
        if results.displacement_field not in data:
            raise ValueError(
                f"{path}: state {number} has no point data {results.displacement_field!r} (it has:"
                f" {', '.join(data.keys()) or 'none'}): set displacement_field"
            )
        fields.append(np.asarray(data[results.displacement_field], dtype=float))
        if len(fields[-1]) != len(points):
            raise ValueError(
                f"{path}: state {number} has {len(fields[-1])} nodes, the first one {len(points)}:"
                " export the same mesh for every state"
            )
    nobody = np.empty(0, int)
    return Fields(np.asarray(points, float), np.array(fields), np.array(times, float), nobody)
