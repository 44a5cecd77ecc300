"""What the measurement must see: the tip's path, and the camera, sheet and vortices that fit it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.integrate import cumulative_trapezoid

from pipeline.formats.bending_states import States
from pipeline.kinematics.finger import finger_motion, law_times
from pipeline.scene.current import Stream
from pipeline.scene.measurement import Camera
from pipeline.scene.predicted import picture_of
from pipeline.scene.scene import Scene

_NOISE = 0.05  # of the way: a sensor's noise at rest is no turn
_SHAPES = 61  # over the motion's pressures: the tip moves by a few degrees between two
_PLACES = 241  # over the motion, of the tip
# of the finger's thickness, around the tip: a vortex lies beside it, and is measured in a circle
_ROOM = 2.2
# Where the tip turns back vortices of two strokes merge: 90mm x 18mm, a cycle of 25 kPa, at draft
_ROOM_OF_TURNS = 3.0
# A vortex takes up no more than 2 tip speeds times thickness (formation number 4), and one of a
# pair carries the other with circulation over 2 pi times their distance, about the thickness
_FORMED, _APART = 2.0, 1.0
_FARTHEST = 0.5  # of the finger's length: they part, or lose their strength
# The same ahead of a tip that does not turn back, where no later vortex meets them
_AHEAD = 1.3
# Between two fingers the pair is equal and goes straight on, with the jet of the closing: in an
# own pinch at smoke 2.0 times as far as its travel (45 x 30 mm, 40 kPa, 2026-11-28). Another pair
# goes up: at draft in that pinch out of a view that ended 0.5 lengths above the tips.
_OF_PINCH = 2.0
# of PIV in the finger's thickness: with 1.7 the circulation of the tip's vortex was known at 0 of 8
# instants, with 2.5 at 7 of 9 (softfinger new with 50mm x 20mm at smoke, 2026-11-25)
_WINDOWS = 2.6
# of the grid that the flow is sampled on: finer ones hold nothing more
_SPACING_PX, _SPACING_CELLS = 4, 0.7
_LEAST_CIRCULATION = 0.01  # of peak tip speed times length: the shipped scenes' share
_MOST_PIXELS, _SIDE = 1600 * 1280, 64  # of a camera that is not stated; its sides are multiples


@dataclass(frozen=True)
class TipPath:
    """Places (instant, 2) of the tip's middle over a motion (m), peak speed (m/s), and turns back.

    `travel` (instant,): how far a vortex that is shed at an instant goes until the end, m; `drift`
    (instant,): along x with a current, m.
    """

    places: ndarray
    speed: float
    turns: int
    travel: ndarray
    drift: ndarray


def tip_path(scene: Scene, over_time: States | None = None) -> TipPath:
    """The path of a finger's tip; StageError where the motion cannot be.

    `over_time`: shapes at times (s) in place of those at pressures. In a pinch they end at the
    plane between the fingers.
    """
    pinch = scene.pinch if over_time is None else None
    motion = finger_motion(scene.motion, scene.finger, pinch, scene.folder, over_time)
    time = law_times(scene.motion.end_time)
    parameter = motion.law(time)
    count = _SHAPES if over_time is None else _PLACES
    known = np.linspace(parameter.min(), parameter.max(), count)
    tip = motion.to_tank(np.array([motion.shapes.tip(p)[0] for p in known]))
    if scene.pinch is not None:
        tip[:, 0] = np.minimum(tip[:, 0], 0.0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(tip, axis=0).T))])
    done = np.interp(parameter, known, way)
    speed = np.abs(np.gradient(done, time))
    some = np.unique(np.linspace(0, time.size - 1, _PLACES).astype(int))
    places = np.stack([np.interp(parameter[some], known, axis) for axis in tip.T], axis=1)
    travel = _travel(time, speed, scene.finger.thickness)[some]
    stream = Stream.of(scene)
    went = cumulative_trapezoid(stream.law(time) if stream else 0 * time, time, initial=0)
    drift = (went[-1] - went)[some]
    return TipPath(places, float(speed.max()), _turns(done), travel, drift)


def _travel(time: ndarray, speed: ndarray, thickness: float) -> ndarray:
    """How far (m) a vortex that is shed at each `time` (s) goes until the last.

    By the slug model its circulation grows with half the square of the tip's `speed` (m/s).
    """
    step = np.gradient(time)
    size = np.minimum(0.5 * np.cumsum(speed**2 * step), _FORMED * speed.max() * thickness)
    carried = np.cumsum(size * step) / (2 * np.pi * _APART * thickness)
    return carried[-1] - carried


def _turns(way: ndarray) -> int:
    """How often a way turns back by more than a sensor's noise."""
    least, count, side, furthest = _NOISE * np.ptp(way), 0, 0, way[0]
    for place in way.tolist():
        if abs(place - furthest) > least and np.sign(place - furthest) != side:
            count += side != 0
            side, furthest = np.sign(place - furthest), place
        elif side * (place - furthest) > 0:
            furthest = place
    return int(count)


def following(scene: Scene, path: TipPath) -> dict[str, Any]:
    """Values by dotted key of what the scene leaves to follow from the `path` of its tip.

    The picture holds where vortices go, and the roots where it stays sharp with them.
    """
    camera, finger = scene.camera, scene.finger
    stated = camera.model_fields_set
    near, whole, tips = _boxes(scene, path)
    scale, pixels = camera.scale_mm_per_px * 1e-3, np.array([camera.columns, camera.rows])
    sharp = finger.thickness / (_WINDOWS * scene.piv.window)
    if stated & {"columns", "rows"}:
        if "scale_mm_per_px" not in stated:
            most, least = (float((np.ptp(box, axis=0) / pixels).max()) for box in (whole, near))
            scale = 1e-3 * _rounded_up(1e3 * min(most, max(least, sharp)))
        shown = whole
    else:
        if "scale_mm_per_px" not in stated:
            least = (np.ptp(near, axis=0).prod() / _MOST_PIXELS) ** 0.5
            scale = 1e-3 * _rounded_up(1e3 * max(sharp, least))
        shown = whole if np.ptp(whole, axis=0).prod() <= _MOST_PIXELS * scale**2 else near
        sides = np.ptp(shown, axis=0) / scale
        sides *= min(1.0, (_MOST_PIXELS / sides.prod()) ** 0.5)
        pixels = (_SIDE * np.ceil(sides / _SIDE)).astype(int)
    size = scale * pixels
    fits = size >= np.ptp(near, axis=0) - 1e-9
    low, high = np.where(fits, near, tips)
    middle = np.where(fits, shown.mean(0), near.mean(0))  # else the tip would lie at the edge
    middle = np.clip(middle, high - 0.5 * size, low + 0.5 * size)
    length = finger.length + finger.tip.length
    values: dict[str, Any] = {
        "camera.scale_mm_per_px": round(1e3 * scale, 6),
        "camera.columns": int(pixels[0]),
        "camera.rows": int(pixels[1]),
        "sheet.spacing": round(max(_SPACING_PX * scale, _SPACING_CELLS * scene.mesh.tip_cell), 7),
        "vortices.min_circulation": _rounded_up(_LEAST_CIRCULATION * path.speed * length),
    }
    for name in list(values):
        section, key = name.split(".")
        if key in getattr(scene, section).model_fields_set:
            del values[name]
    return {"camera.centre": [round(float(x), 4) for x in middle]} | values


def _boxes(scene: Scene, path: TipPath) -> tuple[ndarray, ndarray, ndarray]:
    """Lower left and upper right corners (2, 2) in m of what the picture must hold.

    Where vortices go, that with the roots, and where the tips go.
    """
    finger = scene.finger
    room = (_ROOM_OF_TURNS if path.turns else _ROOM) * finger.thickness
    length = finger.length + finger.tip.length
    farthest = _FARTHEST * length
    carried = np.minimum(path.travel, farthest)[:, None]
    first = last = room + carried * np.ones(2)
    if scene.pinch:  # down and up the plane between them
        first = last = room + np.outer(_OF_PINCH * path.travel, [0.0, 1.0])
    drift = np.outer(np.clip(path.drift, -farthest, farthest), [1.0, 0.0])
    if not path.turns and not scene.pinch:
        way = path.places[-1] - path.places[0]
        ahead = np.minimum(path.travel, _AHEAD * length) - carried[:, 0]
        drift = drift + np.outer(ahead, way / max(np.hypot(*way), 1e-9))
    first, last = first - np.minimum(drift, 0.0), last + np.maximum(drift, 0.0)
    root, half = np.array([finger.root]), 0.5 * scene.tank.size[0]
    water = np.array([[-half, 0.0], [half, scene.tank.water_depth]])
    found = []
    for low, high in (
        (path.places - first, path.places + last),
        (np.vstack([path.places - first, root - room]),
         np.vstack([path.places + last, root + room])),
        (path.places, path.places),
    ):  # fmt: skip
        box = np.array([low.min(0), high.max(0)])
        if scene.pinch:
            reach = np.abs(box[:, 0]).max()
            box[:, 0] = -reach, reach
        found.append(box)
    near, whole = (np.clip(box, water[0], water[1]) for box in found[:2])
    return near, whole, found[2]


def unseen_tip(camera: Camera, tip: ndarray) -> str:
    """Why a camera does not see a tip (…, 2) at every place, and the remedy; "" where it does."""
    tip = tip.reshape(-1, 2)
    low, high = picture_of(camera)
    if (tip > low).all() and (tip < high).all():
        return ""

    def span(values: ndarray, axis: int) -> str:
        return f"{'xy'[axis]} from {values[0][axis]:.3f} to {values[1][axis]:.3f} m"

    reach = np.array([tip.min(0), tip.max(0)])
    axis = int(np.argmax(np.maximum(low - reach[0], reach[1] - high)))
    return (
        f"camera.centre = {list(camera.centre or ())} m: the tip leaves the picture (the tip"
        f" moves over {span(reach, axis)}, the picture shows {span(np.array([low, high]), axis)});"
        " remove centre and scale_mm_per_px, so that they follow the tip"
    )


def _rounded_up(value: float) -> float:
    """Round a number up to two digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit - 1e-9) * unit:.6g}")
