"""Bending states of a scene by its engine: the unit cell, or the user's own results."""

import platform
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from pipeline.fea import analyse
from pipeline.fea.imported.importing import digitised, profiles_of, states_of
from pipeline.fea.imported.nodes import read_nodes
from pipeline.fea.imported.series import read_vtk, read_xdmf
from pipeline.fea.settings import Actuator, Fea, Import
from pipeline.formats.bending_states import BendingStates
from piv.files.errors import StageError
from piv.files.provenance import versions
from piv.formats.user_tables import read_table

LIBRARIES = ("felupe", "gmsh", "meshio", "numpy", "pyvista", "scipy", "tensortrax")
READERS = {".csv": read_nodes, ".pvd": read_vtk, ".vtu": read_vtk, ".xdmf": read_xdmf}


def bending_states(
    folder: Path,
    actuator: Actuator,
    fea: Fea,
    done: Callable[[], object] = lambda: None,
    further: Callable[[BendingStates], tuple[float, ...]] = lambda _: (),
) -> BendingStates:
    """States of the case in `folder`, with their provenance; `further` as in `analyse.bend`.

    Raises StageError, ValueError or RuntimeError.
    """
    if fea.results is not None:
        states = imported(folder, fea.results, actuator.width)
        solver = f"imported from {fea.results.file}"
    else:
        states = analyse.bend(actuator, fea, done, further=further)
        solver = f"FElupe {version('felupe')}, unit cell"
        if len(states.pressure) < len(fea.pressures) and not fea.partial:
            ends = f"{states.pressure[0] / 1e3:g} and {states.pressure[-1] / 1e3:g} kPa"
            raise StageError(
                f"the unit cell converges only between {ends}: narrow first_pressure_kpa and"
                " last_pressure_kpa in [fea], or keep these with partial = true and"
                " uncertainty = false"
            )
    about = {
        "geometry": actuator.model_dump(exclude={"materials"}),
        "material": actuator.materials.model_dump(),
        "solver": solver,
        "versions": versions(*LIBRARIES) | {"python": platform.python_version()},
        "settings": fea.model_dump(mode="json"),
    }
    return replace(states, about=about)


def imported(folder: Path, results: Import, width: float) -> BendingStates:
    """The user's own results; raises StageError or ValueError with file and remedy."""
    path = folder / results.file
    if "*" not in path.name and not path.exists():
        raise StageError(f"{path}: no such file: correct file in [fea.results]")
    if path.suffix == ".csv" and "node" not in read_table(path, "nodes or profiles").names:
        profiles = digitised(path, results)
    elif path.suffix in READERS:
        profiles = profiles_of(path, READERS[path.suffix](path, results), results)
    else:
        raise StageError(f"{path}: give a file of kind {', '.join(READERS)}")
    return states_of(path, profiles, width, results.pitch)
