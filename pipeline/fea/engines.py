"""Bending states of a scene by the engine it names: unit cell, CalculiX, or the user's own results."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from fileio.errors import StageError
from fileio.formats.bending_states import BendingStates
from pipeline.fea import analyse
from pipeline.fea.imported.abaqus import read_abaqus
from pipeline.fea.imported.importing import Fields, Profile, height_along, profiles_of, states_of
from pipeline.fea.imported.profiles import read_profiles
from pipeline.fea.imported.series import read_vtk, read_xdmf
from pipeline.fea.settings import Actuator, Fea, Import
from pipeline.fea.solid import calculix
from pipeline.fea.solid import mesh as solid_mesh
from pipeline.fea.solid.frd import read_frd

LIBRARIES = ("felupe", "gmsh", "meshio", "numpy", "pyvista", "scipy", "tensortrax")


def bending_states(
    folder: Path, actuator: Actuator, fea: Fea, done: Callable[[], object] = lambda: None
) -> BendingStates:
    """States with their provenance; `folder` is the case. Raises StageError, ValueError or RuntimeError."""
    if fea.engine == "import" and fea.results is not None:
        states, solver = (
            imported(folder, fea.results, actuator.width),
            f"imported from {fea.results.file}",
        )
    elif fea.engine == "calculix":
        states = solid(folder / "out" / "calculix", actuator, fea)
        solver = f"CalculiX {calculix.release()}, C3D20R"
    else:
        states, solver = analyse.bend(actuator, fea, done), f"FElupe {version('felupe')}, unit cell"
        if len(states.pressure) < len(fea.pressures) and not fea.partial:
            ends = f"{states.pressure[0] / 1e3:g} and {states.pressure[-1] / 1e3:g} kPa"
            raise StageError(
                f"the unit cell converges only between {ends}: narrow first_pressure_kpa and last_pressure_kpa in [fea],"
                " or keep these with partial = true and uncertainty = false"
            )
    about = {
        "geometry": actuator.model_dump(exclude={"materials"}),
        "material": actuator.materials.model_dump(),
        "solver": solver,
        "versions": {name: version(name) for name in LIBRARIES}
        | {"python": platform.python_version()},
        "settings": fea.model_dump(mode="json"),
    }
    return replace(states, about=about)


def solid(folder: Path, actuator: Actuator, fea: Fea) -> BendingStates:
    """The whole finger in 3-D, pressurised, solved in `folder`."""
    pressures = fea.pressures
    if pressures[0] < 0:
        raise StageError(
            'engine = "calculix" pressurises only, because suction of the whole finger diverges beyond about -1 kPa: '
            'set first_pressure_kpa = 0 or use engine = "unit_cell"'
        )
    mesh = solid_mesh.build(actuator, fea.solid_mesh)
    result = calculix.run(folder, calculix.deck(mesh, actuator, pressures[pressures > 0]))
    _, points, displacements = read_frd(result)
    if pressures[0] == 0:
        displacements = np.concatenate([np.zeros_like(displacements[:1]), displacements])
    profiles = []
    for pressure, moved in zip(pressures, displacements, strict=True):
        place = (points + moved)[:, :2] * [1, -1]  # y towards the ventral side
        line = place[mesh.ventral]
        profiles.append(
            Profile(pressure, points[mesh.ventral, 0], line, height_along(line, place[mesh.dorsal]))
        )
    return states_of(result, profiles, actuator.width, actuator.pitch)


def imported(folder: Path, given: Import, width: float) -> BendingStates:
    """The user's own results; raises StageError for a file that is not there or of an unknown kind."""
    path = folder / given.file
    if "*" not in path.name and not path.exists():
        raise StageError(f"{path}: no such file: correct file in [fea.results]")
    if path.suffix == ".csv":
        return states_of(path, read_profiles(path, given), width, given.pitch)
    return states_of(
        path, profiles_of(path, _fields(folder, path, given), given), width, given.pitch
    )


def _fields(folder: Path, path: Path, given: Import) -> Fields:
    if path.suffix in (".pvd", ".vtu"):
        return read_vtk(path, given)
    if path.suffix == ".xdmf":
        return read_xdmf(path, given)
    if path.suffix == ".frd":
        times, points, displacements = read_frd(path)
        return Fields(points, displacements, times, {})
    if path.suffix == ".inp":
        if given.displacements is None:
            raise StageError(
                f"{path}: an .inp has no results: set displacements to the CSV of docs/abaqus_export.py"
            )
        return read_abaqus(path, folder / given.displacements)
    raise StageError(
        f"{path}: {path.suffix} is not a kind that is read: give .csv, .pvd, .vtu, .xdmf, .inp or .frd"
    )
