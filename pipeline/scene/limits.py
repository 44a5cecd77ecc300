"""What is refused before anything runs: numbers that no tank has, and runs that a guard would be sure to stop.

Bounds of a single key stand with the key; here are those that several keys decide. Each check raises ValueError with one
sentence that names the key, the reason and the nearest value that works.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.scene.pinch import check_pinch, check_support
from pipeline.scene.predicted import checkpoints, predicted, sheet_points, view_size
from pipeline.scene.sections import SCALED

VISCOSITY = (1e-7, 1e-2)  # m²/s: liquid metals to honey
DENSITY = (100.0, 20000.0)  # kg/m³
MAX_TANK = 5.0  # m
MAX_STEPS = 100_000  # each lays a folder with a frame of the motion
MAX_CELLS = 5e7
MAX_SHEET_POINTS = 5e7
MAX_DISK = 1e13  # bytes
MAX_CPU = 3e8  # s: ten years
FEWEST_PICTURES = 4  # of the sheet: a pair for PIV, and a change between two of its fields
FINEST = 1e-3  # of the finger's thickness: smaller cells resolve nothing of it
# Courant number of a run over that of its wall moving along a cell: the flow round the tip is faster than the tip, and the
# cells in it are smaller. Measured: 2.8 to 5.1 over levels, models, strokes and the pinch.
COURANT_OF_FLOW = (2.5, 4.0)


def check_scene(scene: Any) -> None:
    """All that several keys of a scene decide."""
    _check_places(scene)
    if scene.body is None:  # a rigid body's scene is in units of its own
        _check_finger(scene)
        _check_fluid(scene.fluid)
        _check_mesh(scene)
    _check_times(scene)
    _check_strokes(scene)
    _check_pictures(scene)
    _check_sizes(scene)


def _check_places(scene: Any) -> None:
    tank, finger = scene.tank, scene.finger
    if tank.water_depth > tank.size[1]:
        raise ValueError(
            f"tank.water_depth = {tank.water_depth} m exceeds the tank's height {tank.size[1]} m"
        )
    if scene.body is None and (finger.length > 1 or max(tank.size) > MAX_TANK):
        raise ValueError(
            f"finger.length = {finger.length:g} m or tank.size = {list(tank.size)} m looks like millimetres; give metres, at"
            f" most 1 and {MAX_TANK:g}"
        )
    if not abs(finger.root[0]) < tank.size[0] / 2 or finger.root[1] <= 0:
        raise ValueError(f"finger.root = {list(finger.root)} is not in the tank; move it inside")
    if finger.root[1] >= tank.water_depth:
        raise ValueError(
            f"tank.water_depth = {tank.water_depth:g} m does not cover finger.root, {finger.root[1]:g} m above the bottom; give a"
            " deeper water or a lower root"
        )
    if finger.width >= tank.size[2]:
        raise ValueError(f"finger.width = {finger.width} m does not fit between the tank's walls")
    if scene.pinch is not None:
        check_pinch(scene.pinch, finger, tank, scene.motion.start_pressure_kpa)
    elif scene.model.kind == "quarter":
        raise ValueError(
            "model.kind = 'quarter' needs the second symmetry plane of [pinch]; give 'half' for a single finger"
        )
    if scene.support is not None:
        check_support(scene.support, finger, tank)
    if abs(scene.sheet.z) >= tank.size[2] / 2:
        raise ValueError(f"sheet.z = {scene.sheet.z} m lies outside the tank")
    if scene.model.kind != "full" and scene.sheet.z != 0:
        raise ValueError(
            "sheet.z must be 0 unless model.kind = 'full': the sheet is the symmetry plane"
        )


def _within(key: str, value: float, low: float, high: float, unit: str, why: str) -> None:
    if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
        bound = f"at least {low:.3g}" if value < low else f"at most {high:.3g}"
        raise ValueError(f"{key} = {value:g}{unit} is {why}; give {bound}")


def _check_finger(scene: Any) -> None:
    finger = scene.finger
    _within("finger.thickness", finger.thickness, 0.02 * finger.length, 0.5 * finger.length, " m",
            "no finger's, against its length")  # fmt: skip
    _within("finger.width", finger.width, 0.05 * finger.thickness, 20 * finger.thickness, " m",
            "no finger's, against its thickness")  # fmt: skip
    _within(
        "finger.tip.length",
        finger.tip.length,
        0,
        finger.length,
        " m",
        "more than the finger's length",
    )
    thin = min(finger.thickness, finger.tip.thickness or finger.thickness)
    for name, table, key in (
        ("finger", finger, "root_corner_radius"),
        ("finger.tip", finger.tip, "corner_radius"),
    ):
        if key in table.model_fields_set:  # a default is fitted to a thin finger
            _within(
                f"{name}.{key}",
                getattr(table, key),
                0,
                0.49 * thin,
                " m",
                "more than half the thickness",
            )


def _check_strokes(scene: Any) -> None:
    motion, step = scene.motion, scene.numerics.time_step
    if not motion.strokes:
        return
    for k, stroke in enumerate(motion.strokes):
        _within(f"motion.strokes[{k}].duration", stroke.duration, 4 * step, np.inf, " s",
                f"less than four of numerics.time_step = {step:g} s")  # fmt: skip
    begun = [
        motion.start_pressure_kpa,
        *(s.pressure_kpa for s in motion.strokes if s.start < motion.end_time),
    ]
    if not any(abs(b - a) > 1e-3 for a, b in pairwise(begun)):
        raise ValueError(
            f"motion: no stroke changes the pressure before motion.end_time = {motion.end_time:g} s, the finger would not"
            " move; give motion.strokes another pressure_kpa or an earlier start"
        )


def _check_times(scene: Any) -> None:
    end, step, rate = scene.motion.end_time, scene.numerics.time_step, scene.sheet.rate_hz
    steps = end / step
    if steps > MAX_STEPS:
        raise ValueError(
            f"numerics.time_step = {step:g} s makes {steps:.3g} steps of the run; give at least {end / MAX_STEPS:.3g}"
        )
    sampling = scene.numerics.sampling_steps(rate)
    if steps < FEWEST_PICTURES * (1 - 1e-6):
        raise ValueError(
            f"motion.end_time = {end:g} s is {steps:.3g} of numerics.time_step = {step:g} s; give at least"
            f" {FEWEST_PICTURES * sampling * step:g}"
        )
    if abs(steps - round(steps)) > 1e-6 * steps:
        raise ValueError(
            f"motion.end_time = {end:g} s is no whole number of numerics.time_step = {step:g} s;"
            f" give {round(steps) * step:g}"
        )
    if round(steps) // sampling < FEWEST_PICTURES:
        raise ValueError(
            f"sheet.rate_hz = {rate:g} makes {round(steps) // sampling} pictures of the sheet by motion.end_time = {end:g} s;"
            f" give at least {1 / (round(steps) // FEWEST_PICTURES * step):g}"
        )
    _within("numerics.write_interval", scene.numerics.write_interval, step, np.inf, " s",
            f"less than numerics.time_step = {step:g} s")  # fmt: skip


def _check_pictures(scene: Any) -> None:
    camera, sheet, piv = scene.camera, scene.sheet, scene.piv
    wide, high = view_size(camera)
    points = sheet_points(scene)
    if points > MAX_SHEET_POINTS:
        least = sheet.spacing * (points / MAX_SHEET_POINTS) ** 0.5
        raise ValueError(
            f"sheet.spacing = {sheet.spacing:g} m makes {points:.3g} points of each picture of the sheet; give at"
            f" least {least:.2g}, or a smaller sheet.margin"
        )
    if sheet.spacing > max(wide, high) / 8:
        raise ValueError(
            f"sheet.spacing = {sheet.spacing:g} m puts fewer than eight points into the picture;"
            f" give at most {max(wide, high) / 8:.2g}"
        )
    half, depth = scene.tank.size[0] / 2, scene.tank.water_depth
    seen = [
        min(middle + size / 2, last) - max(middle - size / 2, first)
        for middle, size, first, last in zip(
            camera.centre, (wide, high), (-half, 0.0), (half, depth), strict=True
        )
    ]
    if min(seen[0] / wide, seen[1] / high) < 0.01:
        raise ValueError(
            f"camera.centre = {list(camera.centre)} m shows no water: the picture is {wide:.3g} m by {high:.3g} m, the water"
            f" x from {-half:g} to {half:g} m and y from 0 to {depth:g} m; give a centre in it"
        )
    levels, side = 2**camera.bits, min(camera.columns, camera.rows)
    for key, value, most, unit, why in (
        (
            "camera.background",
            camera.background,
            0.9 * levels,
            "",
            f"as bright as camera.bits = {camera.bits} can show",
        ),
        (
            "camera.read_noise",
            camera.read_noise,
            0.1 * levels,
            "",
            f"too much of the {levels} levels to see particles",
        ),
        ("piv.window", piv.window, side / 2, " px", "more than half the picture"),
        (
            "piv.spacing",
            piv.spacing,
            side / 8,
            " px",
            "too much to put eight vectors into the picture",
        ),
        (
            "vortices.stencil_radius",
            scene.vortices.stencil_radius,
            min(wide, high) / 4,
            " m",
            "a quarter of the picture or more",
        ),
    ):
        _within(key, value, 0, most, unit, why)
    if camera.pairs_every > 1 and piv.frames > 2:
        raise ValueError(
            f"piv.frames = {piv.frames} needs every frame; give camera.pairs_every = 1, or piv.frames = 2"
        )


def _check_sizes(scene: Any) -> None:
    """The predicted cells, disk and time."""
    size, mesh = predicted(scene), scene.mesh
    if size.cells > MAX_CELLS:
        by = (size.cells / MAX_CELLS) ** 0.5
        raise ValueError(
            f"the mesh would have about {size.cells:.2g} cells in {size.memory / 1e9:.2g} GB of memory, more than {MAX_CELLS:g}:"
            f" its smallest is {min(mesh.wall_cell, mesh.tip_cell, mesh.near_cell):g} m; make mesh.wall_cell, tip_cell,"
            f" near_cell and far_cell {by:.2g} times larger"
        )
    if size.disk > MAX_DISK:
        raise ValueError(
            f"the results would take about {size.disk / 1e12:.2g} TB of disk: {checkpoints(scene):.2g} times in steps of"
            f" numerics.write_interval = {scene.numerics.write_interval:g} s are kept, and {size.frames:.2g} frames of the"
            " camera; give a longer write_interval, a lower camera.frame_rate_hz or fewer pixels"
        )
    if size.cpu > MAX_CPU:
        raise ValueError(
            f"the run would take about {size.cpu / 3.15e7:.2g} years of CPU time: {size.cells:.2g} cells in {size.steps:.2g}"
            " steps; make the mesh coarser, or numerics.time_step longer"
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
        ("edge_layer", mesh.edge_layer, finger.width, "the finger's width"),
        ("sheet_layer", mesh.sheet_layer, finger.width, "the finger's width"),
    ):
        _within(f"mesh.{key}", value, 0, most, " m", f"more than {why}")
    for key in (
        "wall_cell",
        "tip_cell",
        "near_cell",
        "far_cell",
        "wall_first_layer",
        "edge_layer",
        "sheet_layer",
    ):
        _within(f"mesh.{key}", getattr(mesh, key), FINEST * finger.thickness, np.inf, " m",
                "less than a thousandth of the finger's thickness")  # fmt: skip
    for key in (*SCALED, "jet_reach"):
        _within(f"mesh.{key}", getattr(mesh, key), 0, max(tank.size), " m", "more than the tank")
    if layers > room / 2:
        raise ValueError(
            f"the mesh's layers at the wall are {layers:.3g} m thick, but there are only {room:.3g} m to the tank's"
            f" walls or the surface; lower mesh.wall_layers or mesh.wall_first_layer by {layers / (room / 2):.2g}"
        )


def check_courant(positions: np.ndarray, times: np.ndarray, max_courant: float) -> float:
    """The Courant number to be expected of wall nodes, in order along the outline, at `positions` (step, node, 2), of even `times` (s).

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
        time_step = times[1] - times[0]
        raise ValueError(
            f"the finger's wall moves at {walk[at] / time_step:.2g} m/s along cells of {size[at]:.2g} m: a Courant number"
            f" of about {likely:.2g}, more than numerics.max_courant = {max_courant:g}; give a numerics.time_step of at"
            f" most {time_step * max_courant / likely:.2g} s (now {time_step:g} s), or larger mesh.wall_cell and tip_cell"
        )
    return likely
