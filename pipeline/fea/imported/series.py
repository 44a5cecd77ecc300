"""Displacement fields of VTU and PVD (PyVista) and XDMF series (meshio)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pyvista
from numpy.typing import NDArray

from pipeline.fea.imported.importing import Fields
from pipeline.fea.settings import Import

FloatArray = NDArray[np.float64]


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
                block.combine() if isinstance(block, pyvista.MultiBlock) and block.n_blocks > 1 else block[0]
            )
    else:
        files = sorted(path.parent.glob(path.name))
        times = [float(k + 1) for k in range(len(files))]
        meshes = [pyvista.read(file) for file in files]
    if not meshes:
        raise ValueError(f"{path}: no file of that name: set file in [fea.results]")
    fields: list[FloatArray] = []
    for number, mesh in enumerate(meshes, 1):
        if given.displacement_field not in mesh.point_data:
            known = ", ".join(mesh.point_data.keys()) or "none"
            raise ValueError(
                f"{path}: state {number} has no point data {given.displacement_field!r} (it has: {known}): set displacement_field"
            )
        fields.append(np.asarray(mesh.point_data[given.displacement_field], dtype=float))
        _same_count(path, number, len(fields[-1]), meshes[0].n_points)
    return Fields(np.asarray(meshes[0].points, dtype=float), np.array(fields), np.array(times), {})


def read_xdmf(path: Path, given: Import) -> Fields:
    """All steps of an XDMF time series; raises ValueError."""
    fields, times = [], []
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, _ = reader.read_points_cells()
        for step in range(reader.num_steps):
            time, data, _ = reader.read_data(step)
            if given.displacement_field not in data:
                known = ", ".join(data) or "none"
                raise ValueError(
                    f"{path}: state {step + 1} has no point data {given.displacement_field!r} (it has: {known}): "
                    "set displacement_field"
                )
            fields.append(np.asarray(data[given.displacement_field], dtype=float))
            times.append(float(time))
            _same_count(path, step + 1, len(fields[-1]), len(points))
    return Fields(np.asarray(points, dtype=float), np.array(fields), np.array(times), {})


def _same_count(path: Path, number: int, count: int, expected: int) -> None:
    if count != expected:
        raise ValueError(
            f"{path}: state {number} has {count} nodes, the first one {expected}: export the same mesh for every state"
        )
