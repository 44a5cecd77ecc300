"""The predicted size of a scene's run: cells, steps, memory, disk and time."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.scene.current import lead_steps
from pipeline.scene.measurement import frames_apart
from piv.synthetic.camera import CARRIED

_MEMORY_PER_CELL = 2e3  # bytes: of pimpleFoam with GAMG
# of a run by cell, time step and pressure corrector (docs/tradeoff.md: 2.1 to 2.5e-6)
_SECONDS_PER_CELL = 2.4e-6
# of a time step besides, s: files, and in a coupled run by cell of the planform that follows
_STEP, _FOLLOWED = 0.02, 2e-5
_CHECKPOINT_PER_CELL = 400.0  # bytes: fields, fluxes and points with their old times
_SHEET_PER_POINT = 21.0  # bytes: five fields and a mark


@dataclass(frozen=True)
class Size:
    """Cells, time steps and camera frames; memory and disk in bytes, CPU time of the flow in s.

    `samples`: points of all `pictures` of the sheet; `vectors`: of all `fields`; `pixels`: of the
    frames, half for a picture and half for a step of the particles.
    """

    cells: float
    steps: float
    pictures: float
    frames: float
    fields: float
    samples: float
    pixels: float
    vectors: float
    memory: float
    disk: float
    cpu: float

    def __str__(self) -> str:
        memory, disk = (f"{float(f'{size / 1e9:.2g}'):,g}" for size in (self.memory, self.disk))
        return (
            f"about {float(f'{self.cells:.1g}'):,.0f} cells, {self.steps:,.0f} steps,"
            f" {memory} GB of memory, {disk} GB of disk"
        )


def predicted(scene: Any) -> Size:
    """The size of a scene's run, each number within a factor of about three."""
    numerics, camera, end = scene.numerics, scene.camera, scene.motion.end_time
    cells, steps = estimated_cells(scene), end / numerics.time_step
    rate = camera.frame_rate_hz or scene.sheet.rate_hz
    frames = end * rate * (min(1.0, 2 / camera.pairs_every))
    carried = end * rate if camera.pairs_every <= CARRIED + 1 else frames / 2
    pictures = end * scene.sheet.rate_hz / (scene.sheet.every or 1)
    samples = pictures * sheet_points(scene)
    picture = camera.columns * camera.rows
    fields = end * rate / frames_apart(camera, scene.piv)
    solutions = (
        numerics.outer_correctors
        * numerics.pressure_correctors
        * (1 + numerics.non_orthogonal_correctors)
    )
    disk = checkpoints(scene) * cells * _CHECKPOINT_PER_CELL
    disk += samples * _SHEET_PER_POINT
    disk += frames * picture * (1 if camera.bits == 8 else 2)
    return Size(
        cells=cells,
        steps=steps,
        pictures=pictures,
        frames=frames,
        fields=fields,
        samples=samples,
        pixels=0.5 * (frames + carried) * picture,
        vectors=fields * picture / scene.piv.spacing**2,
        memory=cells * _MEMORY_PER_CELL,
        disk=disk,
        # on a mesh at rest a step costs half (docs/mesh.md)
        cpu=cells * (steps + 0.5 * lead_steps(scene)) * solutions * _SECONDS_PER_CELL
        + steps * (_STEP + scene.coupled * _FOLLOWED * planform_cells(scene)),
    )


def checkpoints(scene: Any) -> float:
    """Times whose fields are kept."""
    return max(1.0, scene.motion.end_time / scene.numerics.write_interval)


def view_size(camera: Any) -> tuple[float, float]:
    """Width and height of the camera's picture, m."""
    return camera.columns * camera.pixel, camera.rows * camera.pixel


def picture_of(camera: Any) -> tuple[Any, Any]:
    """Lower left and upper right corner (2,) of the camera's picture, m."""
    half = 0.5 * np.array(view_size(camera))
    return camera.centre - half, camera.centre + half


def sheet_points(scene: Any) -> float:
    """Points of a picture of the sheet."""
    wide, high = (size + 2 * scene.sheet.margin for size in view_size(scene.camera))
    return wide * high / scene.sheet.spacing**2


def planform_cells(scene: Any) -> float:
    """Cells of a planform, within a factor of two or three."""
    mesh, finger, body = scene.mesh, scene.finger, scene.body
    length = body.size if body else finger.length + finger.tip.length
    perimeter = 2 * (length + (body.thickness or body.size if body else finger.thickness))
    near = mesh.near_distance
    around = np.pi * near**2 + 2 * length * 2 * near * (mesh.near == "path")
    triangles = 2.3 * (
        around / mesh.near_cell**2
        + scene.tank.size[0] * scene.tank.water_depth / mesh.far_cell**2
        + perimeter * 2 * mesh.wall_distance / mesh.wall_cell**2
    )
    ring = perimeter / min(mesh.wall_cell, 2 * mesh.tip_cell) * mesh.wall_layers
    return float(triangles + ring)


def estimated_cells(scene: Any) -> float:
    """Cells of the whole mesh, within a factor of two or three."""
    mesh, finger = scene.mesh, scene.finger
    layers = {"2d": 1, "full": 2}.get(scene.model.kind, 1)
    if scene.model.kind != "2d":
        growth = np.log(mesh.layer_growth)
        graded = np.log(growth * scene.tank.size[2] / 2 / mesh.edge_layer) / growth
        layers *= finger.width / 2 / mesh.sheet_layer + 1.3 * graded
    return float(planform_cells(scene) * layers)
