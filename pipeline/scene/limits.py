"""Scenes that are refused before anything runs: numbers of no tank, runs sure to be stopped.

Bounds of a single key stand with the key; here are those that several keys decide. Each check
raises ValueError with the key, the reason and the nearest value that works.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.scene.current import check_current
from pipeline.scene.obstacle import check_obstacles
from pipeline.scene.pinch import check_pinch, check_support
from pipeline.scene.predicted import (
    checkpoints,
    picture_of,
    predicted,
    sheet_points,
    view_size,
)
from pipeline.scene.sections import SCALED

_MAX_TANK = 5.0  # m
_MAX_STEPS = 100_000  # each has a folder with a frame of the motion
MAX_CELLS = 5e7
_MAX_SHEET_POINTS = 5e7
MAX_DISK = 1e13  # bytes
MAX_CPU = 3e8  # s: ten years
_FEWEST_PICTURES = 4  # of the sheet: a pair for PIV, and a change between two of its fields
_FEWEST_FIELDS = 2  # of PIV
_FEWEST_PARTICLES = 2  # in a window of PIV: with fewer no vector is right
_LONGEST_RUN = 600.0  # s of a finger's motion, whose pressure is sampled 4000 times a second
_LONGEST_INTERVAL = 10  # between two frames of the camera, in pictures of the sheet
_PERIOD_STEPS = 8  # time steps in a period of a rigid body
_RUBBER = (1e3, 1e12)  # Pa, E I over I of the finger's section: softest gel, stiffest solid
_LEAST_GROWTH = 0.02  # of cells with the distance: 1e5 cells round a point of a gap
_FINEST = 1e-3  # of the finger's thickness: smaller cells resolve nothing of it
# key: least, most, unit, the unit by mistake, of water; liquid metals to honey
_LIQUIDS = {
    "kinematic_viscosity": (1e-7, 1e-2, "m²/s", "mm²/s", "1e-6"),
    "density": (100.0, 20000.0, "kg/m³", "g/cm³", "998"),
}


def check_scene(scene: Any) -> None:
    """All that several keys of a scene decide."""
    _check_places(scene)
    if scene.body is None:  # a rigid body's scene is in units of its own
        _check_finger(scene)
        _check_fluid(scene.fluid)
        _check_mesh(scene)
    check_obstacles(scene)
    _check_times(scene)
    check_current(scene)
    _check_motion(scene)
    _check_pictures(scene)
    _check_fields(scene)
    _check_sizes(scene)


def _check_places(scene: Any) -> None:
    tank, finger, sheet = scene.tank, scene.finger, scene.sheet
    if tank.water_depth > tank.size[1]:
        raise ValueError(
            f"tank.water_depth = {tank.water_depth} m exceeds the tank's height {tank.size[1]} m"
        )
    if scene.body is None and (finger.length > 1 or max(tank.size) > _MAX_TANK):
        raise ValueError(
            f"finger.length = {finger.length:g} m or tank.size = {list(tank.size)} m looks like"
            f" millimetres; give metres, at most 1 and {_MAX_TANK:g}"
        )
    if not abs(finger.root[0]) < tank.size[0] / 2 or finger.root[1] <= 0:
        raise ValueError(f"finger.root = {list(finger.root)} is not in the tank; move it inside")
    if finger.root[1] >= tank.water_depth:
        raise ValueError(
            f"tank.water_depth = {tank.water_depth:g} m does not cover finger.root,"
            f" {finger.root[1]:g} m above the bottom; give a deeper water or a lower root"
        )
    if finger.width >= tank.size[2]:
        raise ValueError(f"finger.width = {finger.width} m does not fit between the tank's walls")
    if scene.pinch is not None:
        check_pinch(scene.pinch, finger, tank, scene.motion.start_pressure_kpa)
    elif scene.model.kind == "quarter":
        raise ValueError(
            "model.kind = 'quarter' needs the second symmetry plane of [pinch]; give 'half' for a"
            " single finger"
        )
    if scene.support is not None:
        check_support(scene.support, finger, tank)
    if abs(sheet.z) >= tank.size[2] / 2:
        raise ValueError(f"sheet.z = {sheet.z} m lies outside the tank")
    if scene.model.kind != "full" and sheet.z != 0:
        raise ValueError(
            "sheet.z must be 0 unless model.kind = 'full': the sheet is the symmetry plane"
        )


def _within(key: str, value: float, low: float, high: float, unit: str, why: str) -> None:
    if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
        bound = f"at least {low:.3g}" if value < low else f"at most {high:.3g}"
        raise ValueError(f"{key} = {value:g}{unit} is {why}; give {bound}")


def _check_finger(scene: Any) -> None:
    finger, tip = scene.finger, scene.finger.tip
    thick, length = finger.thickness, finger.length
    thin = 0.49 * min(thick, tip.thickness or thick)
    rows = [
        ("thickness", thick, 0.02 * length, 0.5 * length, "no finger's, against its length"),
        ("width", finger.width, 0.05 * thick, 20 * thick, "no finger's, against its thickness"),
        ("tip.length", tip.length, 0, length, "more than the finger's length"),
    ]
    # a default is fitted to a thin finger
    if "root_corner_radius" in finger.model_fields_set:
        rows.append(
            (
                "root_corner_radius",
                finger.root_corner_radius,
                0,
                thin,
                "more than half the thickness",
            )
        )
    if "corner_radius" in tip.model_fields_set:
        rows.append(
            ("tip.corner_radius", tip.corner_radius, 0, thin, "more than half the thickness")
        )
    for key, value, low, high, why in rows:
        _within(f"finger.{key}", value, low, high, " m", why)
    if scene.structure.bending_stiffness is not None:
        low, high = (e * finger.width * thick**3 / 12 for e in _RUBBER)
        key, why = "structure.bending_stiffness", "that of no solid of the finger's section"
        _within(key, scene.structure.bending_stiffness, low, high, " N m²", why)


def _check_motion(scene: Any) -> None:
    motion, step = scene.motion, scene.numerics.time_step
    for name in ("displacement", "rotation"):
        law = getattr(motion, name)
        short = f"too short for numerics.time_step = {step:g} s"
        for key, least in (("smoothing", 1), ("period", _PERIOD_STEPS)) if law else ():
            value = getattr(law, key)
            if value is not None:
                _within(f"motion.{name}.{key}", value, least * step, np.inf, " s", short)
    if not motion.strokes:
        free = motion.pressure_csv or motion.source in ("rigid", "recording")
        if scene.current is None and not free:
            raise ValueError(
                "motion: no pressure moves the finger in still water; give motion.strokes or"
                " motion.pressure_csv, or a [current]"
            )
        return
    short = f"less than four of numerics.time_step = {step:g} s"
    for k, stroke in enumerate(motion.strokes):
        _within(f"motion.strokes[{k}].duration", stroke.duration, 4 * step, np.inf, " s", short)
    begun = [s.pressure_kpa for s in motion.strokes if s.start < motion.end_time]
    if not any(abs(b - a) > 1e-3 for a, b in pairwise([motion.start_pressure_kpa, *begun])):
        raise ValueError(
            f"motion: no stroke changes the pressure before motion.end_time = {motion.end_time:g}"
            " s, the finger would not move; give motion.strokes another pressure_kpa or an earlier"
            " start"
        )


def _check_times(scene: Any) -> None:
    end, step, rate = scene.motion.end_time, scene.numerics.time_step, scene.sheet.rate_hz
    if scene.body is None:
        _within("motion.end_time", end, 0, _LONGEST_RUN, " s", "longer than any stroke of a finger")
    steps = end / step
    if steps > _MAX_STEPS:
        raise ValueError(
            f"numerics.time_step = {step:g} s makes {steps:.3g} steps of the run; give at least"
            f" {end / _MAX_STEPS:.3g}"
        )
    sampling = scene.numerics.sampling_steps(rate)
    if steps < _FEWEST_PICTURES * (1 - 1e-6):
        raise ValueError(
            f"motion.end_time = {end:g} s is {steps:.3g} of numerics.time_step = {step:g} s; give"
            f" at least {_FEWEST_PICTURES * sampling * step:g}"
        )
    if abs(steps - round(steps)) > 1e-6 * steps:
        raise ValueError(
            f"motion.end_time = {end:g} s is no whole number of numerics.time_step = {step:g} s;"
            f" give {round(steps) * step:g}"
        )
    pictures = round(steps) // sampling
    if pictures < _FEWEST_PICTURES:
        raise ValueError(
            f"sheet.rate_hz = {rate:g} makes {pictures} pictures of the sheet by motion.end_time ="
            f" {end:g} s; give at least {1 / (round(steps) // _FEWEST_PICTURES * step):g}"
        )
    interval = scene.numerics.write_interval
    short = f"less than numerics.time_step = {step:g} s"
    _within("numerics.write_interval", interval, step, np.inf, " s", short)


def _check_pictures(scene: Any) -> None:
    camera, sheet, piv = scene.camera, scene.sheet, scene.piv
    wide, high = view_size(camera)
    points = sheet_points(scene)
    if points > _MAX_SHEET_POINTS:
        least = sheet.spacing * (points / _MAX_SHEET_POINTS) ** 0.5
        raise ValueError(
            f"sheet.spacing = {sheet.spacing:g} m makes {points:.3g} points of each picture of the"
            f" sheet; give at least {least:.2g}, or a smaller sheet.margin"
        )
    if sheet.spacing > max(wide, high) / 8:
        raise ValueError(
            f"sheet.spacing = {sheet.spacing:g} m puts fewer than eight points into the picture;"
            f" give at most {max(wide, high) / 8:.2g}"
        )
    half, depth = scene.tank.size[0] / 2, scene.tank.water_depth
    seen = np.ones(2)
    if camera.centre is not None:
        low, up = picture_of(camera)
        seen = (np.minimum(up, (half, depth)) - np.maximum(low, (-half, 0.0))) / (wide, high)
    if seen.min() < 0.01:
        raise ValueError(
            f"camera.centre = {list(camera.centre)} m shows no water: the picture is {wide:.3g} m"
            f" by {high:.3g} m, the water x from {-half:g} to {half:g} m and y from 0 to {depth:g}"
            " m; give a centre in it"
        )
    levels, side = 2**camera.bits, min(camera.columns, camera.rows)
    least = 100 / levels  # the shot noise of the brightest is then a tenth of the levels
    bright = f"as bright as camera.bits = {camera.bits} can show"
    noisy = f"too much of the {levels} levels to see particles"
    sparse = "too much to put eight vectors into the picture"
    scale, quarter = scene.vortices.scale or 0.0, min(wide, high) / 4
    for key, value, most, unit, why in (
        ("camera.background", camera.background, 0.9 * levels, "", bright),
        ("camera.read_noise", camera.read_noise, 0.1 * levels, "", noisy),
        ("piv.window", piv.window, side / 2, " px", "more than half the picture"),
        ("piv.spacing", piv.spacing, side / 8, " px", sparse),
        ("vortices.scale", scale, quarter, " m", "over a quarter of the picture"),
    ):
        _within(key, value, 0, most, unit, why)
    if camera.electrons_per_level > 0:
        key = "camera.electrons_per_level"
        _within(key, camera.electrons_per_level, least, np.inf, "", noisy)
    few = f"fewer than {_FEWEST_PARTICLES} particles in a window of piv.window = {piv.window} px"
    least = _FEWEST_PARTICLES / piv.window**2
    _within("camera.density_ppp", camera.density_ppp, least, np.inf, "", few)
    if camera.pairs_every > 1 and piv.frames > 2:
        raise ValueError(
            f"piv.frames = {piv.frames} needs every frame; give camera.pairs_every = 1, or"
            " piv.frames = 2"
        )


def _check_fields(scene: Any) -> None:
    """The number of PIV's vector fields."""
    camera, sheet, piv = scene.camera, scene.sheet, scene.piv
    rate = camera.frame_rate_hz or sheet.rate_hz
    slow = f"fewer frames than one in {_LONGEST_INTERVAL} pictures of the sheet"
    _within("camera.frame_rate_hz", rate, sheet.rate_hz / _LONGEST_INTERVAL, np.inf, " Hz", slow)
    step = scene.numerics.time_step
    pictures = round(scene.motion.end_time / step) // scene.numerics.sampling_steps(sheet.rate_hz)
    every = (sheet.every or 1) if scene.filmed else 1
    last = (pictures - 1) // every * every  # of the pictures that are taken
    frames = math.floor(last / sheet.rate_hz * rate + 1e-6) + 1
    fields = field_count(frames, camera.pairs_every, piv.frames, piv.every)
    if fields < _FEWEST_FIELDS:
        raise ValueError(
            f"the camera takes {frames} frames, of which camera.pairs_every ="
            f" {camera.pairs_every}, piv.frames = {piv.frames} and piv.every = {piv.every} make"
            f" {fields} vector fields, fewer than {_FEWEST_FIELDS}; lower these"
            f"{f' and sheet.every = {every}' if every > 1 else ''}, raise"
            f" sheet.rate_hz = {sheet.rate_hz:g}, or give a later motion.end_time"
        )


def field_count(frames: int, pairs_every: int, in_set: int, every: int) -> int:
    """Vector fields of a camera's frames: the sets of piv.sequence, without its imports."""
    pairs = frames - in_set + 1
    if pairs_every > 1:
        pairs = frames // pairs_every + (frames % pairs_every > 1)
    return max(0, -(-pairs // every))


def _check_sizes(scene: Any) -> None:
    """The predicted cells, disk and time."""
    size, mesh = predicted(scene), scene.mesh
    if size.cells > MAX_CELLS:
        by = (size.cells / MAX_CELLS) ** 0.5
        least = min(mesh.wall_cell, mesh.tip_cell, mesh.near_cell)
        raise ValueError(
            f"the mesh would have about {size.cells:.2g} cells in {size.memory / 1e9:.2g} GB of"
            f" memory, more than {MAX_CELLS:g}: its smallest is {least:g} m; make mesh.wall_cell,"
            f" tip_cell, near_cell and far_cell {by:.2g} times larger"
        )
    if size.disk > MAX_DISK:
        raise ValueError(
            f"the results would take about {size.disk / 1e12:.2g} TB of disk:"
            f" {checkpoints(scene):.2g} times in steps of numerics.write_interval ="
            f" {scene.numerics.write_interval:g} s are kept, and {size.frames:.2g} frames of the"
            " camera; give a longer write_interval, a lower camera.frame_rate_hz or fewer pixels"
        )
    if size.cpu > MAX_CPU:
        raise ValueError(
            f"the run would take about {size.cpu / 3.15e7:.2g} years of CPU time: {size.cells:.2g}"
            f" cells in {size.steps:.2g} steps; make the mesh coarser, or numerics.time_step longer"
        )


def _check_fluid(fluid: Any) -> None:
    for key, (low, high, unit, slip, water) in _LIQUIDS.items():
        value = getattr(fluid, key)
        if not low <= value <= high:
            nearest = low if value < low else high
            raise ValueError(
                f"fluid.{key} = {value:g} {unit} is no liquid's (is it in {slip}?); water's is"
                f" {water}, the nearest that works {nearest:g}"
            )


def _check_mesh(scene: Any) -> None:
    mesh, finger, tank = scene.mesh, scene.finger, scene.tank
    thick, width = finger.thickness, finger.width
    thin = min(thick, finger.tip.thickness or thick)
    room = min(tank.size[0] / 2 - abs(finger.root[0]), tank.water_depth - finger.root[1])
    layers = mesh.wall_first_layer * sum(mesh.wall_growth**k for k in range(mesh.wall_layers))
    most = {
        "wall_cell": (thick / 3, "a third of the finger's thickness"),
        "tip_cell": (thin / 3, "a third of the tip's thickness"),
        "near_cell": (thick, "the finger's thickness"),
        "far_cell": (min(*tank.size, tank.water_depth) / 4, "a quarter of tank.size"),
        "wall_first_layer": (mesh.wall_cell, "mesh.wall_cell"),
        "edge_layer": (width, "the finger's width"),
        "sheet_layer": (width, "the finger's width"),
    }
    fine = "less than a thousandth of the finger's thickness"
    for key, (high, why) in most.items():
        _within(f"mesh.{key}", getattr(mesh, key), 0, high, " m", f"more than {why}")
    for key in (*most, "tip_transition"):
        _within(f"mesh.{key}", getattr(mesh, key), _FINEST * thick, np.inf, " m", fine)
    for key in (*SCALED, "jet_reach"):
        _within(f"mesh.{key}", getattr(mesh, key), 0, max(tank.size), " m", "more than the tank")
    for part in mesh.near_offset:
        _within("mesh.near_offset", abs(part), 0, max(tank.size), " m", "more than the tank")
    if mesh.wall_grading:  # cells of a growth g round a gap are as many as 1 / g²
        slow = "so slow a growth that cells have no end (0: a jump)"
        _within("mesh.wall_grading", mesh.wall_grading, _LEAST_GROWTH, 1, "", slow)
    if layers > room / 2:
        raise ValueError(
            f"the mesh's layers at the wall are {layers:.3g} m thick, but there are only"
            f" {room:.3g} m to the tank's walls or the surface; lower mesh.wall_layers or"
            f" mesh.wall_first_layer by {layers / (room / 2):.2g}"
        )
