"""What is refused before anything runs: numbers that no tank has, and runs that a guard would be sure to stop.

Each check raises ValueError with one sentence that names the key, the reason and the nearest value that works.
"""

from __future__ import annotations

from typing import Any

import numpy as np

VISCOSITY = (1e-7, 1e-2)  # m²/s: liquid metals to honey
DENSITY = (100.0, 20000.0)  # kg/m³
MAX_STEPS = 100_000  # each lays a folder with a frame of the motion
MAX_CELLS = 5e7
MAX_SHEET_POINTS = 5e7
# Courant number of a run over that of its wall moving along a cell: the flow round the tip is faster than the tip, and the
# cells in it are smaller. Measured: 2.8 to 5.1 over levels, models, strokes and the pinch.
COURANT_OF_FLOW = (2.5, 4.0)


def check_numbers(scene: Any) -> None:
    """Units, sizes and counts of a scene."""
    if scene.body is None:  # a rigid body's scene is in units of its own
        _check_fluid(scene.fluid)
        _check_mesh(scene)
    _check_cells(scene)
    steps = scene.motion.end_time / scene.numerics.time_step
    if steps > MAX_STEPS:
        raise ValueError(
            f"numerics.time_step = {scene.numerics.time_step:g} s makes {steps:.3g} steps of the run; give at least"
            f" {scene.motion.end_time / MAX_STEPS:.3g}"
        )
    camera, spacing = scene.camera, scene.sheet.spacing
    seen = camera.columns * camera.rows * (camera.scale_mm_per_px * 1e-3) ** 2
    if seen / spacing**2 > MAX_SHEET_POINTS:
        raise ValueError(
            f"sheet.spacing = {spacing:g} m makes {seen / spacing**2:.3g} points of each picture of the sheet; give at"
            f" least {(seen / MAX_SHEET_POINTS) ** 0.5:.2g}"
        )
    wide = max(camera.columns, camera.rows) * camera.scale_mm_per_px * 1e-3
    if spacing > wide / 8:
        raise ValueError(
            f"sheet.spacing = {spacing:g} m puts fewer than eight points into the picture; give at most {wide / 8:.2g}"
        )


def _check_fluid(fluid: Any) -> None:
    for key, value, (low, high), unit, slip in (
        ("kinematic_viscosity", fluid.kinematic_viscosity, VISCOSITY, "m²/s", "mm²/s"),
        ("density", fluid.density, DENSITY, "kg/m³", "g/cm³"),
    ):
        if not low <= value <= high:
            nearest = low if value < low else high
            raise ValueError(
                f"fluid.{key} = {value:g} {unit} is no liquid's (is it in {slip}?); water's is"
                f" {'1e-6' if slip == 'mm²/s' else '998'}, the nearest that works {nearest:g}"
            )


def _check_mesh(scene: Any) -> None:
    mesh, finger, tank = scene.mesh, scene.finger, scene.tank
    thin = min(finger.thickness, finger.tip.thickness or finger.thickness)
    room = min(tank.size[0] / 2 - abs(finger.root[0]), tank.water_depth - finger.root[1])
    layers = mesh.wall_first_layer * sum(mesh.wall_growth**k for k in range(mesh.wall_layers))
    for key, value, most, why in (
        ("wall_cell", mesh.wall_cell, finger.thickness / 3, "a third of the finger's thickness"),
        ("tip_cell", mesh.tip_cell, thin / 3, "a third of the tip's thickness"),
        ("near_cell", mesh.near_cell, finger.thickness, "the finger's thickness"),
        ("far_cell", mesh.far_cell, min(*tank.size, tank.water_depth) / 4, "a quarter of the tank"),
        ("wall_first_layer", mesh.wall_first_layer, mesh.wall_cell, "mesh.wall_cell"),
    ):
        if value > most * (1 + 1e-9):
            raise ValueError(f"mesh.{key} = {value:g} m is more than {why}; give at most {most:.3g}")
    if layers > room / 2:
        raise ValueError(
            f"the mesh's layers at the wall are {layers:.3g} m thick, but there are only {room:.3g} m to the tank's"
            f" walls or the surface; lower mesh.wall_layers or mesh.wall_first_layer by {layers / (room / 2):.2g}"
        )


def _check_cells(scene: Any) -> None:
    mesh, cells = scene.mesh, estimated_cells(scene)
    if cells > MAX_CELLS:
        by = (cells / MAX_CELLS) ** 0.5
        raise ValueError(
            f"the mesh would have about {cells:.2g} cells, more than {MAX_CELLS:g}: its smallest is"
            f" {min(mesh.wall_cell, mesh.tip_cell, mesh.near_cell):g} m; make mesh.wall_cell, tip_cell, near_cell and"
            f" far_cell {by:.2g} times larger"
        )


def estimated_cells(scene: Any) -> float:
    """Cells of the whole mesh, within a factor of two or three."""
    mesh, finger, body = scene.mesh, scene.finger, scene.body
    length = body.size if body else finger.length + finger.tip.length
    perimeter = 2 * (length + (body.thickness or body.size if body else finger.thickness))
    around = 2 * length * 2 * mesh.near_distance + np.pi * mesh.near_distance**2  # of the path of the tip
    triangles = 2.3 * (
        around / mesh.near_cell**2
        + scene.tank.size[0] * scene.tank.water_depth / mesh.far_cell**2
        + perimeter * 2 * mesh.wall_distance / mesh.wall_cell**2
    )
    ring = perimeter / min(mesh.wall_cell, 2 * mesh.tip_cell) * mesh.wall_layers
    layers = {"2d": 1, "full": 2}.get(scene.model.kind, 1)
    if scene.model.kind != "2d":
        growth = np.log(mesh.layer_growth)
        graded = np.log(growth * scene.tank.size[2] / 2 / mesh.edge_layer) / growth
        layers *= finger.width / 2 / mesh.sheet_layer + 1.3 * graded
    return float((triangles + ring) * layers)


def check_courant(positions: np.ndarray, time_step: float, max_courant: float) -> float:
    """The Courant number to be expected of wall nodes, in order along the outline, at `positions` (step, node, 2).

    ValueError where it is sure to exceed `max_courant`.
    """
    ahead = np.roll(positions, -1, axis=1) - positions
    edge = np.hypot(ahead[..., 0], ahead[..., 1])
    size = np.minimum(edge, np.roll(edge, 1, axis=1))[:-1]
    moved = np.diff(positions, axis=0)
    walk = np.hypot(moved[..., 0], moved[..., 1])
    along = walk / size
    at = np.unravel_index(int(np.argmax(along)), along.shape)
    low, likely = (factor * float(along[at]) for factor in COURANT_OF_FLOW)
    if low > max_courant:
        raise ValueError(
            f"the finger's wall moves at {walk[at] / time_step:.2g} m/s along cells of {size[at]:.2g} m: a Courant number"
            f" of about {likely:.2g}, more than numerics.max_courant = {max_courant:g}; give a numerics.time_step of at"
            f" most {time_step * max_courant / likely:.2g} s (now {time_step:g} s), or larger mesh.wall_cell and tip_cell"
        )
    return likely
