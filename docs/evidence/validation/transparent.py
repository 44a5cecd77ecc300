"""A transparent body: the mesh moves with it, and water is on both sides of its outline."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from tqdm import tqdm

from docs.evidence.small_scene import meshes_of
from pipeline.case import stage as case
from pipeline.case.interval_case import build_mesh
from pipeline.formats.mesh_intervals import read_intervals
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.openfoam.foamfile import END, binary_list, header, read_field, write_bytes
from pipeline.scene.scene import Scene
from pipeline.solve.guards import Guard
from pipeline.solve.interval import KnownMotion, solver_intervals
from pipeline.solve.lead import solve_lead
from pipeline.solve.map_fields import swept_cells
from pipeline.solve.prepare import prepare
from pipeline.solve.solver import solve
from piv.files.errors import StageError

# positions (n, 2) m, time s -> velocities (n, 2) m/s
Field = Callable[[np.ndarray, float], np.ndarray]


@dataclass(frozen=True)
class Cells:
    """Velocity (cell, 2) of the mesh's cells at one instant, with their centres and areas."""

    centres: np.ndarray
    areas: np.ndarray
    velocity: np.ndarray


def solve_transparent(
    scene: Scene, initial: Field | None = None, boundary: str = "fixedValue"
) -> None:
    """Mesh, case and solution of a scene whose body lets water through.

    `boundary`: type of U on the outer sides: `slip`, or `fixedValue`, of the initial field. Without
    an initial field the case keeps its own fields and conditions.
    """
    scene.out.mkdir(parents=True, exist_ok=True)
    kinematics.run(scene, quiet=True)
    mesh.run(scene, quiet=True)
    path = scene.out / "planform.h5"
    intervals = read_intervals(scene.out)
    if len(intervals) > 1:
        raise StageError(
            f"{path}: {len(intervals)} planforms; a flow of known order must stay on one: refine"
            " or move less"
        )
    with h5py.File(path, "a") as file:
        file["mesh_0/body"][...] = 0
    case.run(scene, quiet=True)
    case_folder = scene.out / "case"
    folder = case_folder / intervals[0].name
    if initial is not None:
        first = _cells(scene, 0.0, None)
        walls = {
            name: b"type slip;" if boundary == "slip" else _fixed_value(initial(middle, 0.0))
            for name, middle in _outer_faces(scene).items()
        }
        _write_velocity(folder / "0" / "U", initial(first.centres, 0.0), walls)
        _edit(folder / "0" / "p", (r"gap( +)\{[^}]*\}", r"gap\1{ type zeroGradient; }"))
    for system in case_folder.glob("*/system"):
        _edit(
            system / "fvSolution",
            (r"PIMPLE\n\{", "PIMPLE\n{\n    pRefCell            0;\n    pRefValue           0;"),
            (r"(tolerance +)[\de.-]+;", r"\g<1>1e-11;"),
            (r"(relTol +)[\d.]+;", r"\g<1>0;"),
            (r"maxIter +\d+;", ""),
        )
    for name in ("functions", "obstacles"):
        (folder / "system" / name).write_text("// no body, no forces\n")
    parts = solver_intervals(scene, 1, True)
    parts[0].guard = Guard(scene.numerics.max_courant)  # no body, no guard of the energy
    solve_lead(scene, parts[0], solve, True)
    motion = KnownMotion(parts[0])
    prepare(parts, 0, motion, True)
    with tqdm(disable=True) as bar:
        solve(parts[0], motion, bar)


def _edit(path: Path, *changes: tuple[str, str]) -> None:
    """Replace patterns in a file."""
    text = path.read_text()
    for pattern, new in changes:
        text = re.sub(pattern, new, text)
    path.write_text(text)


def _outer_faces(scene: Scene) -> dict[str, np.ndarray]:
    """Middles (face, 2), m, of the outer patches' faces, which do not move."""
    mesh = meshes_of(scene)[0]
    swept = build_mesh(mesh.planform)
    points = swept.points(mesh.motion.nodes(0.0), mesh.planform["levels"].values)
    middles = {}
    for name, start, count in swept.patches:
        if name in OUTER_PATCHES:
            corners = swept.face_points[swept.face_offset[start] : swept.face_offset[start + count]]
            middles[name] = points[corners.reshape(count, 4)].mean(1)[:, :2]
    return middles


def _cells(scene: Scene, time: float, folder: Path | None) -> Cells:
    """Cells at `time`; the velocity is that in `folder`, or zero without one."""
    mesh = swept_cells(meshes_of(scene)[0], time)
    column = mesh.column
    centres, areas = mesh.centre[column], mesh.area[column]
    if folder is None:
        return Cells(centres, areas, np.zeros_like(centres))
    return Cells(centres, areas, read_field(folder / "U", len(column))[:, :2])


def at_end(scene: Scene) -> Cells:
    """Cells at the run's end."""
    time = scene.motion.end_time
    return _cells(scene, time, scene.out / "case" / "interval_0" / f"{time:.8g}")


def _vectors(velocity: np.ndarray) -> bytes:
    """Velocities (n, 2) as a list with a third component, 0."""
    space = np.column_stack([velocity, np.zeros(len(velocity))])
    return b"nonuniform List<vector> " + binary_list(space) + b";"


def _fixed_value(velocity: np.ndarray) -> bytes:
    """Entries of a patch whose faces have the velocities (face, 2)."""
    return b"type fixedValue; value " + _vectors(velocity)


def _write_velocity(path: Path, velocity: np.ndarray, walls: dict[str, bytes]) -> None:
    """Write U with the cells' velocities (cell, 2) and the entries of each outer patch."""
    sides = [b"    %s { %s }\n" % (name.encode(), entries) for name, entries in walls.items()]
    sides.append(b"    sheet { type empty; }\n    back { type empty; }\n")
    body = b"dimensions [0 1 -1 0 0 0 0];\n\ninternalField " + _vectors(velocity)
    body += b"\n\nboundaryField\n{\n" + b"".join(sides) + b"}\n"
    write_bytes(path, header("volVectorField", "0", "U", binary=True) + body + END)
