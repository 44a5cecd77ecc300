"""The terms of the power balance: work, energy, and losses by viscosity, scheme and coupling.

Losses are the solver's own discrete terms times the velocity of the cell, less what moves to other
cells or through a wall, by face (docs/schemes.md).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.interpolate import PchipInterpolator

from pipeline.formats.mesh_intervals import IntervalMesh
from pipeline.formats.records import LOSSES
from pipeline.geometry.quality import cell_areas, cell_centres
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.function_objects import read_function_object
from pipeline.openfoam.polymesh_files import Faces, read_faces
from pipeline.openfoam.surface_vtk import wall_forces
from pipeline.openfoam.through_flow import WALLS
from pipeline.scene.current import Stream
from pipeline.scene.sections import Fluid
from pipeline.solve.checkpoint import saved_field, saved_times

_UPWIND_SHARE = {"LUST": 0.25, "linearUpwind": 1.0}
_LIMIT = 0.5  # of the non-orthogonal correction: system/fvSchemes
_LEAST_COSINE = 0.05  # OpenFOAM's least distance of two cells along the face's normal
_FREE = ("sheet", "mirror", "top")  # patches along which the water slips


@dataclass(frozen=True)
class _FaceGeometry:
    """Faces and cells of a mesh in one shape, m: area vectors and centres, centres and volumes.

    Faces of patches of no extent (2-D) have area vectors of zero.
    """

    faces: Faces
    area: ndarray
    centre: ndarray
    cell_centre: ndarray
    volume: ndarray

    @property
    def inner(self) -> int:
        """Number of inner faces."""
        return len(self.faces.neighbour)


def face_terms(
    mesh: _FaceGeometry,
    velocity: ndarray,
    pressure: ndarray,
    on_boundary: ndarray,
    swept: ndarray,
    viscosity: ndarray,
    convection: str,
    entry: slice | None = None,
) -> dict[str, ndarray]:
    """Power over density that each of LOSSES takes at faces (face,), m⁵/s³.

    `velocity` (cell, 3) m/s; `pressure` (cell,) m²/s²; `on_boundary` (boundary face, 3) m/s;
    `swept` (face,) m³/s: flux of the mesh's own motion; `viscosity` (cell,) m²/s; `entry`: of the
    boundary faces those with a prescribed flux through them.
    """
    n, own, other = mesh.inner, mesh.faces.owner, mesh.faces.neighbour
    inside, outside = mesh.area[:n], mesh.area[n:]
    rim = own[n:]
    own = own[:n]
    across = mesh.cell_centre[other] - mesh.cell_centre[own]
    size = np.linalg.norm(inside, axis=1)
    normal = inside / size[:, None]
    to_own = _dot(normal, mesh.centre[:n] - mesh.cell_centre[own])
    share = to_own / _dot(normal, across)  # of the neighbour in a value at the face

    def at_faces(values: ndarray) -> ndarray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[own] * (1 - weight) + values[other] * weight

    linear = at_faces(velocity)
    gradient = _gradient(mesh, linear, on_boundary)
    change = velocity[other] - velocity[own]
    flux = _dot(linear, inside) - swept[:n]

    # convection: the convected value less the mean of both sides, which would keep the energy
    upwind = np.where(flux > 0, own, other)
    ahead = mesh.centre[:n] - mesh.cell_centre[upwind]
    carried = velocity[upwind] + np.einsum("fi,fij->fj", ahead, gradient[upwind])
    part = _UPWIND_SHARE[convection]
    carried = part * carried + (1 - part) * linear
    mean = 0.5 * (velocity[own] + velocity[other])
    mixed = [-flux * _dot(carried - mean, change)]

    # viscosity: with the limited correction of the normal gradient
    cosine = np.maximum(_dot(normal, across), _LEAST_COSINE * np.linalg.norm(across, axis=1))
    slope = change / cosine[:, None]
    skew = normal - across / cosine[:, None]
    correction = np.einsum("fi,fij->fj", skew, at_faces(gradient))
    scale = np.linalg.norm(slope, axis=1) / np.maximum(np.linalg.norm(correction, axis=1), 1e-30)
    correction *= np.minimum(1.0, _LIMIT / (1 - _LIMIT) * scale)[:, None]
    inner_viscous = at_faces(viscosity) * size * _dot(slope + correction, change)
    edge = np.linalg.norm(outside, axis=1)
    real = edge > 0
    away = _dot(outside, mesh.centre[n:] - mesh.cell_centre[rim]) / np.where(real, edge, 1.0)
    jump = on_boundary - velocity[rim]
    if entry is not None:
        mixed.append(-0.5 * (_dot(on_boundary, outside) * _dot(jump, jump))[entry])
    rim_viscous = np.where(
        real, viscosity[rim] * edge / np.where(real, away, 1.0) * _dot(jump, jump), 0.0
    )

    # pressure: work of its gradient on the cells' velocity, less that on the walls'
    coupled = -at_faces(pressure) * _dot(inside, change)
    rim_coupled = -pressure[rim] * _dot(outside, jump)

    taken = (inner_viscous, rim_viscous), mixed, (coupled, rim_coupled)
    return {name: np.concatenate(parts) for name, parts in zip(LOSSES, taken, strict=True)}


def _dot(a: ndarray, b: ndarray) -> ndarray:
    return np.einsum("fi,fi->f", a, b)


def _gradient(mesh: _FaceGeometry, inner: ndarray, boundary: ndarray) -> ndarray:
    """Gradient (cell, direction, component) by Gauss's theorem from values on faces."""
    n, cells = mesh.inner, len(mesh.volume)
    gradient = np.empty((cells, 3, 3))
    for i in range(3):
        for j in range(3):
            through = mesh.area[:, i] * np.concatenate([inner[:, j], boundary[:, j]])
            total = np.bincount(mesh.faces.owner, through, cells)
            total -= np.bincount(mesh.faces.neighbour, through[:n], cells)
            gradient[:, i, j] = total / mesh.volume
    return gradient


def term_rows(
    case: Case, mesh: IntervalMesh, fluid: Fluid, convection: str, stream: Stream | None = None
) -> ndarray:
    """Rows POWER_TERMS (W) of the computed part of the tank, of the fields written in an interval.

    `convection`: numerics.convection; `stream`: the scene's current.
    """
    node = mesh.sweep["node"].values
    faces = read_faces(case.folder / "constant" / "polyMesh")
    entry = None
    if stream is not None:
        inner, ends = len(faces.neighbour), faces.patches["upstream"]
        entry = slice(ends.start - inner, ends.stop - inner)
    rows = []
    for time, name in saved_times(case, ("U", "p")):
        if time < mesh.interval.start + 1e-9:
            continue  # in the overlap with the interval before
        shape = geometry_at(faces, mesh, time)
        cells = len(shape.volume)
        modelled = ["nut"] if (case.folders[0] / name / "nut").exists() else []
        velocity, pressure, *viscosity = (
            saved_field(case, f"{name}/{field}", cells) for field in ("U", "p", *modelled)
        )
        effective = sum(viscosity, np.full(cells, fluid.kinematic_viscosity))
        plane = mesh.motion.velocity(time)[node][faces.corners].mean(1)
        moving = np.column_stack([plane, np.zeros(len(plane))])  # of faces, m/s
        terms = face_terms(
            shape, velocity, pressure, _boundary_velocity(shape, velocity, moving, stream, time),
            np.einsum("fi,fi->f", moving, shape.area), effective, convection, entry,
        )  # fmt: skip
        rows.append([time, *(fluid.density * terms[name].sum() for name in LOSSES)])
    return np.array(rows).reshape(-1, 1 + len(LOSSES))


def geometry_at(faces: Faces, mesh: IntervalMesh, time: float) -> _FaceGeometry:
    """Geometry of a mesh in its shape at `time` s; its faces are plane."""
    nodes, levels = mesh.motion.nodes(time), mesh.planform["levels"].values
    node, level, column, layer = (
        mesh.sweep[name].values for name in ("node", "level", "cell_column", "cell_layer")
    )
    corner = np.column_stack([nodes[node], levels[level]])[faces.corners]
    first, second = (
        np.cross(corner[:, k] - corner[:, 0], corner[:, k + 1] - corner[:, 0]) / 2 for k in (1, 2)
    )
    area = first + second
    size = np.linalg.norm(area, axis=1)[:, None]
    parts = [np.einsum("fi,fi->f", part, area)[:, None] / size**2 for part in (first, second)]
    middles = corner[:, [0, 1, 2]].mean(1), corner[:, [0, 2, 3]].mean(1)
    centre = sum(part * middle for part, middle in zip(parts, middles, strict=True))
    if mesh.planform.attrs["model"] == "2d":
        for name in ("back", "sheet"):
            area[faces.patches[name]] = 0.0
    cells = mesh.planform["triangles"].values, mesh.planform["quads"].values
    middle = 0.5 * (levels[1:] + levels[:-1])
    cell_centre = np.column_stack([cell_centres(nodes, *cells)[column], middle[layer]])
    volume = cell_areas(nodes, *cells)[column] * np.diff(levels)[layer]
    return _FaceGeometry(faces, area, np.asarray(centre), cell_centre, volume)


def _boundary_velocity(
    mesh: _FaceGeometry, velocity: ndarray, moving: ndarray, stream: Stream | None, time: float
) -> ndarray:
    """Velocity (boundary face, 3) at the patches as the case's boundary conditions give it."""
    patch_velocity = np.zeros((len(mesh.faces.owner) - mesh.inner, 3))
    slips = stream is not None and stream.current.walls == "slip"
    free = set(_FREE + (WALLS if slips else ()))
    if stream is not None and stream.current.channel:
        free.discard("top")
    for name, faces in mesh.faces.patches.items():
        rows = slice(faces.start - mesh.inner, faces.stop - mesh.inner)
        inside = velocity[mesh.faces.owner[faces]]
        if name.endswith("finger"):
            patch_velocity[rows] = moving[faces]
        elif name == "gap":
            patch_velocity[rows] = inside
        elif name == "upstream" and stream is not None:
            patch_velocity[rows, 0] = stream.law(np.array(time)) * stream.share(
                mesh.centre[faces, 1]
            )
        elif name == "downstream":  # what enters there comes straight
            enters = np.einsum("fi,fi->f", inside, mesh.area[faces]) < 0
            patch_velocity[rows] = inside
            patch_velocity[rows, 1:] *= ~enters[:, None]
        elif name in free:
            area = mesh.area[faces]
            size = np.maximum(np.einsum("fi,fi->f", area, area), 1e-300)
            patch_velocity[rows] = (
                inside - (np.einsum("fi,fi->f", inside, area) / size)[:, None] * area
            )
    return patch_velocity


def resolved_dissipation(
    density: float, viscosity: float, gradient: Any, half_vorticity: Any
) -> Any:
    """Power (W) that viscosity takes, from volume integrals of |grad u|^2 and half of |curl u|^2.

    2 S:S = 2 |grad u|^2 - |curl u|^2, and OpenFOAM's enstrophy is half of |curl u|^2.
    """
    return density * viscosity * (2 * gradient - 2 * half_vorticity)


def finger_power(path: Path, density: float) -> float:
    """Work rate of the computed part of the finger on the water (W) from its sampled surface."""
    _, force, velocity = wall_forces(path, density)
    return -float(np.einsum("fi,fi->", force, velocity))


def power_rows(case: Path, fluid: Fluid, copies: int) -> ndarray:
    """Columns POWER for the whole tank (all fingers), which holds `copies` of the computed part."""
    samples = case / "postProcessing"
    raw = read_function_object(samples / "volumes", "volFieldValue.dat")
    times, square, gradient, half_vorticity = raw.T
    surfaces = [samples / "fingerSurface" / time_name(time) / "finger.vtk" for time in times]
    work = [finger_power(surface, fluid.density) for surface in surfaces]
    dissipation = resolved_dissipation(
        fluid.density, fluid.kinematic_viscosity, gradient, half_vorticity
    )
    return np.column_stack(
        [times, copies * np.array(work), copies * 0.5 * fluid.density * square,
         copies * dissipation]
    )  # fmt: skip


def integrals(table: ndarray, begin: float = 0.0, running: bool = False) -> dict[str, float]:
    """Energy (J) that each term has taken from `begin` (s) to the end of a table POWER_TERMS.

    From rest, or from a flow that was `running`, of which the first rates are taken.
    """
    time = np.concatenate([[begin], table[:, 0]])
    rates = np.vstack([running * table[0, 1:], table[:, 1:]])
    taken = PchipInterpolator(time, rates).integrate(time[0], time[-1])
    return dict(zip(LOSSES, map(float, taken), strict=True))


def power_balance(
    table: ndarray, terms: ndarray, through: ndarray | None = None, running: bool = False
) -> dict[str, Any]:
    """Work = kinetic energy + energy taken by each of `terms` (POWER_TERMS) + an unexplained rest.

    `closure`: the rest after the resolved dissipation of `table` (POWER). `unexplained_share`: of
    the energy that body and water exchange in both directions. `through`: rows of time (s), power
    (W) and its integral (J) that a current brings; it is then `supplied`, and counts beside the
    work. Of a flow that is `running` at 0 s the balance is that since the first row, whose energy
    counts as 0.
    """
    begin = table[0, 0] if running else 0.0
    time = np.concatenate([[begin], table[:, 0]])
    rate = np.vstack([np.zeros(2), table[:, [1, 3]]])
    middle, step = 0.5 * (rate[1:] + rate[:-1]), np.diff(time)
    work, dissipated = np.sum(middle * step[:, None], axis=0)
    exchanged = float(step @ abs(middle[:, 0]))
    kinetic = table[-1, 2] - (table[0, 2] if running else 0.0)
    more, given = {}, work
    if through is not None:
        brought = np.diff(np.interp(time, through[:, 0], through[:, 2]))
        more = {"supplied": float(brought.sum())}
        given, exchanged = work + brought.sum(), exchanged + float(abs(brought).sum())
    closure = given - kinetic - dissipated
    # `terms` has few rows, and gives what the viscous term takes beyond the resolved dissipation
    rest = terms.copy()
    rest[:, 1] -= np.interp(terms[:, 0], table[:, 0], table[:, 3])
    taken = integrals(rest, begin, running)
    taken["viscous"] += float(dissipated)
    unexplained = given - kinetic - sum(taken[name] for name in LOSSES)
    # what a current brings and takes almost cancels, so that their difference is no scale
    scale = (abs(given) if through is None else exchanged) or 1.0
    return more | {
        "work": float(work),
        "kinetic_energy": float(kinetic),
        "dissipated": float(dissipated),
        "closure": float(closure),
        "closure_fraction": float(closure / scale),
        "taken": taken,
        "unexplained": float(unexplained),
        "unexplained_fraction": float(unexplained / scale),
        "unexplained_share": float(abs(unexplained) / exchanged) if exchanged else 0.0,
    }
