"""A scene for an own finger (softfinger new); the file names what it assumes."""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pipeline.fea.sections import sections
from pipeline.formats.bending_states import BendingStates, read_states
from pipeline.kinematics.pressure_law import absolute, harmless_smoothing, measured_law, moving_time
from pipeline.kinematics.shapes import circular_states
from pipeline.runs.estimate import duration, estimate, of_page
from pipeline.runs.run import NOT_FASTER, open_run
from pipeline.runs.stages import FEA
from pipeline.scene.measurement import frames_apart
from pipeline.scene.predicted import predicted
from pipeline.scene.read_toml import command, read_layers
from pipeline.scene.scene import Scene, load_scene
from pipeline.scene.sections import SMOOTHING
from pipeline.structure.finger import ElasticFinger, modelled_speed
from piv.files.atomic import write_text
from piv.files.errors import StageError
from piv.formats.user_tables import read_history

PARENT = Path("cases/single_finger")
_FILLED = 0.9  # of the tank's height: the experiment's
_ABOVE_ROOT, _LEAST_ABOVE_ROOT = 0.055, 0.02  # m of water: the experiment's, and a shallow tank's
_BELOW_TIP, _LEAST_BELOW_TIP = 0.1, 0.01  # m of water
_LEAST_SLENDER, _LEAST_CAVITY = 2.0, 2.5  # length over thickness; width over that of a side wall
_FEWEST_STATES = 8
_PRESSURE_STEPS = (0.5, 1, 2, 5, 10, 20, 50)  # kPa
_STEP_SPEED = 0.35  # m/s, for which the levels' times were chosen
# at most so many times the shipped scene's vector fields: in a run that moves, that mostly rests
_LONGER, _LONGER_AT_REST = 4.0, 16.0
_PLANE_WINDOW = 16  # px, of plane levels: half of the others', in pictures of a quarter
# of a finger's vibration and of the pressure's smoothing; of a run
_PERIOD_STEPS, _FEWEST_PICTURES = 20, 100
_MOST_STEPS = 1000  # that a run may take to resolve the smoothing
# of cells with the distance from the wall, as at coarse: without it those above a root that is near
# the surface are so large that the flow makes circulation, 8 % of the tip vortex's
_GRADING = 0.35
_WHOLE = 0.02  # s: the end of a run, and the end of the smoothed pressure
_LEVELS = ("smoke", "draft", "coarse")
_SECTION = ("h1", "h2", "l1", "gap", "b1", "b2", "roof", "channel")  # of [actuator]
# keys of [mesh] in proportion to the finger's thickness, and to its length
_CELLS = {"wall_cell", "wall_first_layer", "wall_distance", "tip_cell", "near_cell", "edge_layer"}
_CELLS |= {"sheet_layer"}
_REACHES = {"near_offset", "near_distance", "tip_transition"}


@dataclass(frozen=True)
class Own:
    """What the user gives: length and width (m), pressure history (CSV), tank x, y, z (m).

    `thickness` (m): of the cross-section, whose shape is the shipped one's; None: its size, too.
    """

    length: float
    width: float
    pressure: Path
    tank: tuple[float, float, float]
    thickness: float | None = None


def write_scene(folder: Path, own: Own, parent: Path = PARENT) -> Scene:
    """Write scene.toml and pressure.csv into a folder; returns the scene at level coarse.

    StageError, and nothing written, where they do not fit together.
    """
    shipped = load_scene(parent)
    actuator, _ = sections(shipped)
    scale = (own.thickness or shipped.finger.thickness) / shipped.finger.thickness
    scaled = {key: round(scale * getattr(actuator, key), 7) for key in _SECTION}
    actuator = actuator.model_copy(update=scaled | {"l2": scale * actuator.l2})
    _check_section(own, scale * shipped.finger.thickness, actuator.b1)
    placed = _placed(own)
    times, pressure = read_history(own.pressure, "pressure", least=2)
    measured_law(own.pressure)  # refuses kPa
    chambers = max(2, round((own.length + actuator.gap) / actuator.pitch))
    cavity = (own.length + actuator.gap) / chambers - 2 * actuator.l1 - actuator.gap
    end = _up(times[-1] - times[0] + SMOOTHING, _WHOLE)
    history = "".join(f"{t - times[0]:.9g},{p:.9g}\n" for t, p in zip(times, pressure, strict=True))
    with TemporaryDirectory() as place:  # from 0 s on, as the scene will have it
        table = Path(place) / "pressure.csv"
        write_text(table, f"t,p\n{history}")
        likely = _likely(replace(own, pressure=table), shipped, chambers, end, scale)
        try:
            speed = modelled_speed(likely, end)
        except StageError:
            low, high = pressure.min() / 1e3, pressure.max() / 1e3
            raise StageError(
                f"{own.pressure}: at {low:g} to {high:g} kPa a finger of the paper's cross-section"
                f" and silicone, {1e3 * own.length:g} mm long, finds no equilibrium; give smaller"
                " pressures, in Pa"
            ) from None
        slower, period = _pace(likely.period, speed / scale, shipped, end)
        smoothing = harmless_smoothing(table, period)
        period = smoothing if smoothing > SMOOTHING else period
        # the finger keeps a quarter of the shipped scene's fields, or more, while it moves
        moving = np.clip(2 * moving_time(table, smoothing), end / _LONGER_AT_REST, end / _LONGER)
        sparser = 2 ** max(0, math.ceil(math.log2(moving / slower / shipped.motion.end_time)))
    end = _up(end + smoothing - SMOOTHING, _WHOLE * max(slower, 1.0))
    span = np.ptp(pressure) / 1e3
    step = max((s for s in _PRESSURE_STEPS if s * _FEWEST_STATES <= span), default=0.5)
    low, high = math.floor(pressure.min() / 1e3 / step), math.ceil(pressure.max() / 1e3 / step)
    values = {
        "parent": os.path.relpath(parent, folder),
        "parent_name": shipped.folder.resolve().name,
        "smoothing": smoothing,
        "smoothed": f"smoothing = {smoothing}  # s\n" if smoothing > SMOOTHING else "",
        "title": folder.name.replace("_", " ").capitalize(),
        "tank": [float(x) for x in own.tank],
        **placed,
        "length": own.length,
        "width": own.width,
        "chambers": chambers,
        "l2": round(cavity, 7),
        "thickness": "" if scale == 1 else _thickness(own, shipped, scale),
        "section": "" if scale == 1 else "".join(f"{key} = {v}\n" for key, v in scaled.items()),
        "first": step * (min(low, 0) - 1.0),
        "last": step * max(high, 1.0),
        "step": float(step),
        "rows": len(times),
        "source": own.pressure.name,
        "low": pressure.min() / 1e3,
        "high": pressure.max() / 1e3,
        "end": round(end, 6),
        "source_of_motion": "structure" if likely.known else "fea",
        "levels": _of_levels(own, shipped, (slower, period), scale, sparser),
    }
    written = [
        (folder / "pressure.csv", f"t,p\n{history}"),
        (folder / "scene.toml", _TEXT.format(**values)),
    ]
    if there := next((path for path, _ in written if path.exists()), None):
        raise StageError(f"{there}: exists already; give another folder, or edit it")
    new = not folder.exists()
    for path, text in written:
        write_text(path, text)
    try:
        scene = load_scene(folder)
        sections(scene)
    except StageError:
        for path, _ in written:
            path.unlink()
        folder.rmdir() if new else None
        raise
    return scene


def _thickness(own: Own, shipped: Scene, scale: float) -> str:
    """Keys of [finger] for a cross-section of another size."""
    finger = shipped.finger
    return (
        f"thickness = {own.thickness}  # m\n"
        f"root_corner_radius = {scale * finger.root_corner_radius:.3g}\n"
        f"tip = {{ corner_radius = {scale * finger.tip.corner_radius:.3g} }}\n"
    )


def _check_section(own: Own, thickness: float, side_wall: float) -> None:
    """StageError where the shipped cross-section (m) makes no finger of this size."""
    for option, size, least in (
        ("--length", own.length, _LEAST_SLENDER * thickness),
        ("--width", own.width, _LEAST_CAVITY * side_wall),
    ):
        if size < least * (1 - 1e-9):
            raise StageError(
                f"{option}: {1e3 * size:g} mm is too little for a cross-section of the paper's"
                f" shape, {1e3 * thickness:.3g} mm thick with side walls of {1e3 * side_wall:.3g}"
                f" mm; give at least {1e3 * least:.3g} mm, or a smaller --thickness"
            )


def _placed(own: Own) -> dict[str, Any]:
    """Water depth and root for a finger in a tank; StageError where it does not fit."""
    depth = math.floor(round(1e3 * _FILLED * own.tank[1], 6)) / 1e3
    above = min(max(depth - own.length - _BELOW_TIP, _LEAST_ABOVE_ROOT), _ABOVE_ROOT)
    below = depth - above - own.length
    if below < _LEAST_BELOW_TIP:
        raise StageError(
            f"--length: a finger of {1e3 * own.length:g} mm does not hang in a tank"
            f" {1e3 * own.tank[1]:g} mm high, filled to {1e3 * depth:g} mm; give a higher one, at"
            f" least {1e3 * (own.length + _LEAST_ABOVE_ROOT + _LEAST_BELOW_TIP) / _FILLED:.0f} mm"
        )
    half = own.tank[0] / 2
    x = min(0.0, max(half - 1.2 * own.length, own.length / 3 - half))
    return {"depth": depth, "root": [round(x, 4), round(depth - above, 4)], "above": 1e3 * above}


def _up(value: float, unit: float) -> float:
    """Round a value up to a multiple of `unit`."""
    return round(math.ceil(round(value / unit, 6)) * unit, 6)


def _likely(own: Own, shipped: Scene, chambers: int, end: float, scale: float) -> ElasticFinger:
    """The finger before its bending is analysed: the shipped one's section in its own size.

    `scale`: of lengths in the plane. Strains of the same shape at the same pressure are equal.
    """
    states = read_states(shipped.folder / str(shipped.motion.states), shipped.finger.thickness)
    ends = np.diff(states.profile[:, -2:], axis=1)[:, 0]
    bend = np.unwrap(np.arctan2(ends[:, 1], ends[:, 0])) * chambers / shipped.actuator["chambers"]
    bend -= bend[np.argmin(np.abs(states.pressure))]
    thickness = scale * shipped.finger.thickness
    line = circular_states(states.pressure, bend, own.length, thickness)
    states = replace(states, profile=line.profile, thickness=line.thickness)
    if isinstance(states, BendingStates) and states.law is not None:
        wider, law = own.width / shipped.finger.width, states.law
        powers = {"stiffness": 3, "moment": 2, "rubber_mass": 1, "rubber_section": 1}
        sizes = {
            name: wider * scale**power for name, power in (powers | {"air_section": 1}).items()
        }
        heights = ("neutral_axis", "air_height", "rubber_height", "clamped_length")
        sizes |= dict.fromkeys(heights, scale) | {"curvature": 1 / scale}
        values = {name: size * getattr(law, name) for name, size in sizes.items()}
        states = replace(states, law=replace(law, **values))
    finger = {"length": own.length, "width": own.width, "root": (0.0, 0.0)}
    moved = {"strokes": (), "pressure_csv": str(own.pressure.resolve()), "end_time": end}
    scene = shipped.model_copy(
        update={
            "finger": shipped.finger.model_copy(update=finger),
            "motion": shipped.motion.model_copy(update=moved),
        }
    )
    return ElasticFinger.of(scene, states)


def _steps(period: float, step: float) -> float:
    """By how much a time step (s) of the shipped scene may be longer for a period (s)."""
    return max(period / _PERIOD_STEPS / step, 1.0)


def _pace(vibration: float, speed: float, shipped: Scene, end: float) -> tuple[float, float]:
    """By how much times of the shipped scene are longer, and the shortest period (s) to resolve.

    A power of two: the tip goes over as many cells in a step as that of the shipped scene or fewer;
    the period and a run keep their least numbers of steps and pictures. The period is that of the
    finger's `vibration` (s) or the smoothing. `speed`: of the tip, over the cells' scale, m/s.
    """
    period = min(vibration, max(SMOOTHING, _PERIOD_STEPS * end / _MOST_STEPS))
    of_period = _steps(period, shipped.numerics.time_step)
    of_run = end * shipped.sheet.rate_hz / _FEWEST_PICTURES
    slower = NOT_FASTER * _STEP_SPEED / max(speed, 1e-9)
    slower = min(slower, of_period, max(of_run, 1.0))
    return _power(slower), period


def _power(value: float) -> float:
    """The largest power of two that is no more than a value."""
    return 2.0 ** math.floor(math.log2(value))


def _of_levels(
    own: Own, shipped: Scene, pace: tuple[float, float], scale: float, sparser: int
) -> str:
    """Tables of levels: times as fast as the tip, cells for the thickness and a small tank.

    `pace`: as of `_pace`; the period keeps its least number of steps at each level.
    """
    slower, period = pace
    largest = math.floor(1e3 * min(*own.tank[::2], _FILLED * own.tank[1]) / 4) / 1e3
    text = ""
    layers = read_layers(shipped.folder / "scene.toml")
    for level in dict.fromkeys(name for layer in layers for name in layer.levels):
        scene, keys = load_scene(shipped.folder, level), ""
        if slower != 1:
            numerics = scene.numerics
            step = min(slower, _power(_steps(period, numerics.time_step))) * numerics.time_step
            every = slower * numerics.write_interval
            keys += f"numerics = {{ time_step = {step:g}, write_interval = {every:g} }}\n"
        keys += _pictures(scene, slower, sparser)
        mesh = {} if scale == 1 else _scaled_mesh(scene, scale, own.length / shipped.finger.length)
        if scene.mesh.far_cell > largest:
            mesh["far_cell"] = largest  # a quarter of the tank at most
        if scene.model.kind == "2d" and not scene.mesh.wall_grading:
            mesh["wall_grading"] = _GRADING
        if mesh:
            keys += f"mesh = {{ {', '.join(f'{key} = {value}' for key, value in mesh.items())} }}\n"
        text += f"\n[levels.{level}]\n{keys}" if keys else ""
    return text


def _pictures(scene: Scene, slower: float, sparser: int) -> str:
    """Keys of a level's pictures, whose pairs are `sparser` times as far apart in a long run.

    A level that correlates one pair of many takes pictures of no others.
    """
    camera, sheet, piv = scene.camera, scene.sheet, scene.piv
    apart = frames_apart(camera, piv)
    few = apart > 2
    rate = sheet.rate_hz / slower / (sparser if few else 1)
    frames = (camera.frame_rate_hz or sheet.rate_hz) / slower
    values: dict[str, dict[str, float]] = {
        "sheet": {"rate_hz": rate} if rate != sheet.rate_hz else {},
        "camera": {"frame_rate_hz": frames} if frames != rate or camera.frame_rate_hz else {},
        "piv": {} if few or sparser == 1 else {"every": sparser * piv.every},
    }
    if few and (sparser > 1 or camera.pairs_every == 1):
        values["camera"]["pairs_every"] = sparser * apart
        values["piv"]["every"] = 1
    if scene.model.kind == "2d":
        values["piv"] |= {"window": _PLANE_WINDOW, "spacing": _PLANE_WINDOW // 4}
    lines = (
        f"{name} = {{ {', '.join(f'{key} = {value:g}' for key, value in keys.items())} }}\n"
        for name, keys in values.items()
        if keys
    )
    return "".join(lines)


def _scaled_mesh(scene: Scene, scale: float, longer: float) -> dict[str, Any]:
    """Keys of [mesh] (m) for a thickness and a length that are `scale` and `longer` times those."""
    out = {}
    for key in type(scene.mesh).model_fields:
        value = getattr(scene.mesh, key)
        size = scale if key in _CELLS else longer if key in _REACHES else 0.0
        if size and np.any(value):
            several = [float(f"{size * part:.4g}") for part in np.atleast_1d(value)]
            out[key] = several if isinstance(value, tuple) else several[0]
    return out


_TEXT = """\
# Written by softfinger new. It holds what differs from {parent_name} (all keys:
# docs/scene_reference.md). "Assumed" marks what was not given: check it against yours.
extends = "{parent}"
title = "{title}"

[tank]
size = {tank}  # inner length x, height y, depth z (m)
water_depth = {depth}  # assumed: nine tenths of the height

[finger]
root = {root}  # assumed: {above:.0f} mm below the surface; x = 0 is the middle of the tank
length = {length}  # m
width = {width}  # m, along z
{thickness}
# The bending analysis (make fea). Assumed: cross-section and silicone of the paper's finger (keys
# in {parent}/scene.toml), with as many chambers as the length takes:
# chambers × (l2 + 2 l1) + (chambers − 1) × gap = finger.length.
[actuator]
chambers = {chambers}
l2 = {l2}  # length of a cavity (m)
width = {width}
{section}
[fea]
first_pressure_kpa = {first}  # {source} has {low:.3g} to {high:.3g} kPa
last_pressure_kpa = {last}
pressure_step_kpa = {step}
uncertainty = false  # true: six more analyses, for a band around the bending radius

[motion]
source = "{source_of_motion}"  # "structure": pressure and water move it together; COUPLED=0: "fea"
pressure_csv = "pressure.csv"  # {source}, {rows} rows, from t = 0 on; smoothing: {smoothing} s
{smoothed}end_time = {end}  # s: when the smoothed pressure has arrived

# Camera, laser sheet and the least vortex that counts follow from the tip's path: [camera] centre
# and scale_mm_per_px state a view. Time steps, checkpoints and pictures of the levels follow from
# the tip's speed in modelled water and the length of the run. Model and mesh are {parent_name}'s.
{levels}"""


def advice(scene: Scene) -> str:
    """What to do next, with predicted times and sizes; nothing has been analysed yet."""
    folder = scene.folder
    runs = [open_run(folder, level) for level in _LEVELS]
    remark = absolute(folder / str(scene.motion.pressure_csv))
    lines = [
        *([f"warning: {remark}"] if remark else []),
        f"{folder / 'scene.toml'}: look at what it assumes, then",
        f"{command('fea', folder):40s} about {duration(estimate(runs[0], FEA.name)[0])}",
    ]
    for level, run in zip(_LEVELS, runs, strict=True):
        seconds = of_page(run)
        lines.append(
            f"{command('run', folder, level):40s} about {duration(seconds)}; the flow:"
            f" {predicted(run.scene)}{'; 2-D: to try' if level == 'smoke' else ''}"
        )
    return "\n".join(lines)
