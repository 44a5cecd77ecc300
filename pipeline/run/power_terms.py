"""The terms of the power balance at the instants whose fields were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.records import LOSSES, POWER_TERMS
from fileio.formats.sweep import read_sweep
from pipeline.geometry.quality import cell_areas, cell_centres
from pipeline.openfoam.polymesh_files import Faces, read_faces
from pipeline.openfoam.ranks import Ranks
from pipeline.run.checkpoint import saved_times
from pipeline.run.dissipation import FaceGeometry, face_geometry, face_terms
from pipeline.run.map_fields import read_cells

_FREE = ("sheet", "mirror", "top")  # patches along which the water slips


def term_rows(out: Path, interval: Interval, ranks: Ranks, density: float, viscosity: float,
              convection: str) -> np.ndarray:  # fmt: skip
    """Rows POWER_TERMS (W) of the computed part of the tank, of the fields written in an interval.

    `out`: the level's folder; `density` kg/m³; `viscosity` m²/s; `convection`: numerics.convection.
    """
    case = out / "case" / interval.name
    faces = read_faces(case / "constant" / "polyMesh")
    planform, motion = read_planform(out, interval.mesh), read_motion(out, interval.mesh)
    sweep = read_sweep(out, interval.name)
    flat = planform.attrs["model"] == "2d"
    rows = []
    for time, name in saved_times(case, ranks, ("U", "p")):
        if time < interval.start + 1e-9:
            continue  # in the overlap with the interval before
        mesh = geometry_at(faces, planform, sweep, motion.nodes(time), flat)
        cells = len(mesh.volume)
        velocity, pressure = (read_cells(case, name, field, ranks, cells) for field in ("U", "p"))
        effective = np.full(cells, viscosity)
        if (ranks.folders(case)[0] / name / "nut").exists():
            effective += read_cells(case, name, "nut", ranks, cells)
        plane = motion.velocity(time)[sweep["node"].values][faces.corners].mean(1)
        moving = np.column_stack([plane, np.zeros(len(plane))])  # of faces, m/s
        terms = face_terms(
            mesh, velocity, pressure, _boundary_velocity(mesh, velocity, moving),
            np.einsum("fi,fi->f", moving, mesh.area), effective, convection,
        )  # fmt: skip
        rows.append([time, *(density * terms[name].sum() for name in LOSSES)])
    return np.array(rows).reshape(-1, len(POWER_TERMS.columns))


def geometry_at(
    faces: Faces, planform: xr.Dataset, sweep: xr.Dataset, nodes: np.ndarray, flat: bool
) -> FaceGeometry:
    """Geometry of a mesh interval's mesh with its planform's nodes at `nodes` (node, 2), m."""
    levels = planform["levels"].values
    cells = planform["triangles"].values, planform["quads"].values
    column, layer = sweep["cell_column"].values, sweep["cell_layer"].values
    points = np.column_stack([nodes[sweep["node"].values], levels[sweep["level"].values]])
    middle = 0.5 * (levels[1:] + levels[:-1])
    centres = np.column_stack([cell_centres(nodes, *cells)[column], middle[layer]])
    volumes = cell_areas(nodes, *cells)[column] * np.diff(levels)[layer]
    return face_geometry(faces, points, centres, volumes, ("back", "sheet") if flat else ())


def _boundary_velocity(mesh: FaceGeometry, velocity: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Velocity (boundary face, 3) at the patches as the case's boundary conditions give it."""
    patch_velocity = np.zeros((len(mesh.faces.owner) - mesh.inner, 3))
    for name, faces in mesh.faces.patches.items():
        rows = slice(faces.start - mesh.inner, faces.stop - mesh.inner)
        inside = velocity[mesh.faces.owner[faces]]
        if name.endswith("finger"):
            patch_velocity[rows] = moving[faces]
        elif name == "gap":
            patch_velocity[rows] = inside
        elif name in _FREE:
            area = mesh.area[faces]
            size = np.maximum(np.einsum("fi,fi->f", area, area), 1e-300)
            patch_velocity[rows] = (
                inside - (np.einsum("fi,fi->f", inside, area) / size)[:, None] * area
            )
    return patch_velocity


def integrals(table: np.ndarray) -> dict[str, float]:
    """Energy (J) that each term has taken by the end of a table POWER_TERMS, from rest at 0 s."""
    time = np.concatenate([[0.0], table[:, 0]])
    rates = np.vstack([np.zeros(table.shape[1] - 1), table[:, 1:]])
    taken = PchipInterpolator(time, rates).integrate(time[0], time[-1])
    return dict(zip(LOSSES, map(float, taken), strict=True))
