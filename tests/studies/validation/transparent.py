"""The body made transparent: water on both sides of its outline, so that the mesh moves and the flow does not know."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from tqdm import tqdm

from fileio.errors import StageError
from fileio.formats.mesh_intervals import read_intervals, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from pipeline import case
from pipeline.geometry.quality import cell_areas, cell_centres
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.openfoam.displacement_files import Steps
from pipeline.openfoam.foamfile import END, binary_list, header, read_field, write_bytes
from pipeline.openfoam.ranks import Ranks
from pipeline.run.guards import Guard
from pipeline.run.prepare import prepare
from pipeline.run.solver import solve
from pipeline.scene.scene import Scene

Field = Callable[
    [np.ndarray, float], np.ndarray
]  # positions (n, 2) m, time s -> velocities (n, 2) m/s


@dataclass(frozen=True)
class Cells:
    """Velocity (cell, 2) of the mesh's cells at one instant, with their centres (cell, 2) and areas."""

    centres: np.ndarray
    areas: np.ndarray
    velocity: np.ndarray


def solve_transparent(scene: Scene, initial: Field, boundary: str, quiet: bool = True) -> None:
    """Mesh, case and solution of a scene whose body lets water through.

    `boundary`: OpenFOAM's type of U on all outer sides: `slip`, or `fixedValue`, of the initial field at each face.
    """
    scene.out.mkdir(parents=True, exist_ok=True)
    kinematics.run(scene, quiet)
    mesh.run(scene, quiet)
    path = scene.out / "planform.h5"
    intervals = read_intervals(scene.out)
    if len(intervals) > 1:
        raise StageError(
            f"{path}: {len(intervals)} planforms; a flow of known order must stay on one: refine or move less"
        )
    with h5py.File(path, "a") as file:
        file["mesh_0/body"][...] = 0
    case.run(scene, quiet)
    folder = scene.out / "case" / intervals[0].name
    first = cells(scene, 0.0, None)
    walls = {
        name: b"type slip;" if boundary == "slip" else fixed_value(initial(middle, 0.0))
        for name, middle in outer_faces(scene).items()
    }
    write_velocity(folder / "0" / "U", initial(first.centres, 0.0), walls)
    pressure = (folder / "0" / "p").read_text()
    pressure = re.sub(r"gap( +)\{[^}]*\}", r"gap\1{ type zeroGradient; }", pressure)
    (folder / "0" / "p").write_text(pressure)
    solution = (folder / "system" / "fvSolution").read_text()
    solution = solution.replace(
        "PIMPLE\n{", "PIMPLE\n{\n    pRefCell            0;\n    pRefValue           0;"
    )
    solution = re.sub(
        r"(relTol +)[\d.]+;",
        r"\g<1>0;",
        re.sub(r"(tolerance +)[\de.-]+;", r"\g<1>1e-11;", solution),
    )
    solution = re.sub(r"maxIter +\d+;", "", solution)
    (folder / "system" / "fvSolution").write_text(solution)
    (folder / "system" / "functions").write_text("// no body, no forces\n")
    steps = Steps.of(intervals[0].begin, intervals[0].end, scene.numerics.time_step)
    prepare(scene.out, intervals, intervals[0], Ranks(), steps, quiet)
    with tqdm(disable=True) as bar:
        solve(folder, intervals[0], Ranks(), None, bar, Guard(scene.numerics.max_courant))


def outer_faces(scene: Scene) -> dict[str, np.ndarray]:
    """Middles (face, 2), m, of the outer patches' faces in the mesh's order; nothing moves them."""
    planform = read_planform(scene.out, 0)
    swept = case.build_mesh(planform)
    points = swept.points(read_motion(scene.out).nodes(0.0), planform["levels"].values)
    middles = {}
    for name, start, count in swept.patches:
        if name in OUTER_PATCHES:
            corners = swept.face_points[swept.face_offset[start] : swept.face_offset[start + count]]
            middles[name] = points[corners.reshape(count, 4)].mean(1)[:, :2]
    return middles


def cells(scene: Scene, time: float, folder: Path | None) -> Cells:
    """Cells at `time`; the velocity is read from `folder`, or zero without one."""
    planform = read_planform(scene.out, 0)
    triangles, quads = planform["triangles"].values, planform["quads"].values
    column = read_sweep(scene.out, "interval_0")["cell_column"].values
    nodes = read_motion(scene.out).nodes(time)
    centres = cell_centres(nodes, triangles, quads)[column]
    areas = cell_areas(nodes, triangles, quads)[column]
    velocity = (
        np.zeros_like(centres) if folder is None else read_field(folder / "U", len(column))[:, :2]
    )
    return Cells(centres, areas, velocity)


def at_end(scene: Scene) -> Cells:
    """Cells at the run's end."""
    time = scene.motion.end_time
    return cells(scene, time, scene.out / "case" / "interval_0" / f"{time:.8g}")


def fixed_value(velocity: np.ndarray) -> bytes:
    """Entries of a patch whose faces have the velocities (face, 2)."""
    return (
        b"type fixedValue; value nonuniform List<vector> " + binary_list(in_space(velocity)) + b";"
    )


def write_velocity(path: Path, velocity: np.ndarray, walls: dict[str, bytes]) -> None:
    """Write U with the cells' velocities (cell, 2) and the entries of each outer patch."""
    sides = b"".join(
        b"    %s { %s }\n" % (name.encode(), entries) for name, entries in walls.items()
    )
    sides += b"    sheet { type empty; }\n    back { type empty; }\n"
    field = b"internalField nonuniform List<vector> " + binary_list(in_space(velocity)) + b";\n\n"
    body = b"dimensions [0 1 -1 0 0 0 0];\n\n" + field + b"boundaryField\n{\n" + sides + b"}\n"
    write_bytes(path, header("volVectorField", "0", "U", binary=True) + body + END)


def in_space(velocity: np.ndarray) -> np.ndarray:
    """Velocities (n, 2) with a third component, 0."""
    return np.column_stack([velocity, np.zeros(len(velocity))])
