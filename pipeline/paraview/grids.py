"""Water and walls of a mesh interval as VTK grids, at any instant, and their mirror images."""

from dataclasses import dataclass

import numpy as np
import pyvista as pv
import vtk
import xarray as xr
from numpy import ndarray

from pipeline.geometry.sweep import BODY_PATCHES
from pipeline.openfoam.polymesh_files import Faces
from pipeline.scene.scene import Scene

Z, X = 2, 0  # normal of the sheet's plane of symmetry, and of that between two fingers


@dataclass(frozen=True)
class Topology:
    """Cells of the water, faces of bodies in VTK's padded form, and the cell behind each face."""

    cells: ndarray
    types: ndarray
    wall_points: ndarray  # of the mesh, those that the walls use
    walls: ndarray
    behind: ndarray


def _padded(corners: ndarray, count: ndarray) -> ndarray:
    """Rows of corners (row, most), of which the first `count` (row) are used, as VTK lists them."""
    rows = np.column_stack([count, corners])
    return rows[np.arange(rows.shape[1]) <= count[:, None]]


def topology(planform: xr.Dataset, sweep: xr.Dataset, faces: Faces) -> Topology:
    """Wedges and hexahedra of a swept mesh, in its own order."""
    triangles, quads = planform["triangles"].values, planform["quads"].values
    nodes = np.vstack([np.pad(triangles, ((0, 0), (0, 1))), quads])
    column, layer = sweep["cell_column"].values, sweep["cell_layer"].values
    number = np.full((planform.sizes["node"], planform.sizes["level"]), -1)
    number[sweep["node"].values, sweep["level"].values] = np.arange(sweep.sizes["point"])
    wedge = column < len(triangles)
    low, high = (number[nodes[column], (layer + k)[:, None]] for k in (0, 1))
    corners = np.hstack([low, high])
    corners[wedge, 3:6] = high[wedge, :3]
    types = np.where(wedge, pv.CellType.WEDGE, pv.CellType.HEXAHEDRON).astype(np.uint8)
    bodies = [k for name, k in faces.patches.items() if name in BODY_PATCHES]
    members = np.concatenate([np.arange(part.start, part.stop) for part in bodies])
    wall = faces.corners[members]
    points, wall_corners = np.unique(wall, return_inverse=True)
    sides = np.where(wall[:, 3] == wall[:, 2], 3, 4)
    cells = _padded(corners, np.where(wedge, 6, 8))
    walls = _padded(wall_corners.reshape(wall.shape), sides)
    return Topology(cells, types, points, walls, faces.owner[members])


Box = tuple[float, ...]  # low and high x, y, z in m


def water(
    mesh: Topology,
    points: ndarray,
    velocity: ndarray,
    pressure: ndarray,
    box: Box | None = None,
) -> pv.UnstructuredGrid:
    """The water with its vorticity and its q, from `velocity` and `pressure` of the cells.

    Velocity (cell, 3) in m/s, pressure (cell,) in Pa. VTK derives the vorticity (1/s) and q (1/s²),
    half of rotation squared less strain squared (Hunt et al. 1988). With a `box`: the cells whose
    first corner lies in it.
    """
    grid = pv.UnstructuredGrid(mesh.cells, mesh.types, points)
    grid.cell_data["velocity"] = velocity
    grid.cell_data["pressure"] = pressure.astype(np.float32)
    if box:
        first = points[grid.cell_connectivity[grid.cell_offsets[:-1]]]
        inside = (first > box[::2]).all(axis=1) & (first < box[1::2]).all(axis=1)
        grid = grid.extract_cells(inside)
    derived = grid.compute_derivative(
        "velocity", gradient=False, vorticity=True, qcriterion="q", preference="cell"
    )
    for name in ("vorticity", "q"):
        grid.cell_data[name] = derived[name].astype(np.float32)
    grid.cell_data["velocity"] = grid["velocity"].astype(np.float32)
    return grid


def walls(mesh: Topology, points: ndarray, pressure: ndarray) -> pv.UnstructuredGrid:
    """Surfaces of the bodies in the water, with the pressure (Pa) in the cells beside them."""
    surface = pv.PolyData(points[mesh.wall_points], mesh.walls)
    surface.cell_data["pressure"] = pressure[mesh.behind].astype(np.float32)
    return surface.cast_to_unstructured_grid()


def mirror_planes(scene: Scene) -> tuple[int, ...]:
    """Normals of the planes of symmetry at which a run's water ends."""
    planes: tuple[int, ...] = (Z,) if scene.model.kind in ("half", "quarter") else ()
    one_of_two = scene.pinch is not None and not scene.both_fingers
    return planes + ((X,) if one_of_two else ())


def with_mirror_image(grid: pv.UnstructuredGrid, axis: int) -> pv.UnstructuredGrid:
    """A grid and its image in the plane through the origin normal to `axis`, vorticity reversed."""
    reflect = vtk.vtkReflectionFilter()
    reflect.SetInputData(grid)
    reflect.SetPlane({X: vtk.vtkReflectionFilter.USE_X, Z: vtk.vtkReflectionFilter.USE_Z}[axis])
    reflect.SetCenter(0.0)
    reflect.CopyInputOn()
    reflect.FlipAllInputArraysOn()
    reflect.Update()
    both = pv.wrap(reflect.GetOutput())
    if "vorticity" in both.cell_data:
        both.cell_data["vorticity"][grid.n_cells :] *= -1
    return both
