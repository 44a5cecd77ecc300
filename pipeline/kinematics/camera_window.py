"""What the measurement must see: the tip's path, and the camera, sheet and vortices that fit it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import ndarray

from pipeline.kinematics.finger import finger_motion, law_times
from pipeline.scene.measurement import Camera
from pipeline.scene.predicted import picture_of
from pipeline.scene.scene import Scene

_NOISE = 0.05  # of the way: a sensor's noise at rest is no turn
_SHAPES = 61  # over the motion's pressures: the tip moves by a few degrees between two
_ROOM = 0.45  # of the finger's length, around root and path, for the vortices that the tip sheds
# of PIV in the finger's thickness: with 1.7 the circulation of the tip's vortex was known at 0 of 8
# instants, with 2.5 at 7 of 9 (softfinger new with 50mm x 20mm at smoke, 2026-11-25)
_WINDOWS = 2.6
_SPACING_PX = 4  # of the grid that the flow is sampled on
_LEAST_CIRCULATION = 0.01  # of peak tip speed times length: the shipped scenes' share


@dataclass(frozen=True)
class TipPath:
    """Places (shape, 2) of the tip's middle over a motion (m), peak speed (m/s), and turns back."""

    places: ndarray
    speed: float
    turns: int


def tip_path(scene: Scene) -> TipPath:
    """The path of a finger's tip; StageError where the motion cannot be."""
    motion = finger_motion(scene.motion, scene.finger, scene.pinch, scene.folder)
    time = law_times(scene.motion.end_time)
    parameter = motion.law(time)
    known = np.linspace(parameter.min(), parameter.max(), _SHAPES)
    tip = motion.to_tank(np.array([motion.shapes.tip(p)[0] for p in known]))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(tip, axis=0).T))])
    speed = np.gradient(np.interp(parameter, known, way), time)
    return TipPath(tip, float(np.abs(speed).max()), _turns(np.interp(parameter, known, way)))


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


def following(scene: Scene) -> dict[str, Any]:
    """Values by dotted key of what the scene leaves to follow from the motion. StageError."""
    path = tip_path(scene)
    length = scene.finger.length + scene.finger.tip.length
    camera, pixels = scene.camera, np.array([scene.camera.columns, scene.camera.rows])
    sides = [1.0] if scene.pinch is None else [1.0, -1.0]
    tips = np.vstack([path.places * [side, 1] for side in sides])
    points = np.vstack([tips, *(np.array(scene.finger.root) * [side, 1] for side in sides)])
    scale = camera.scale_mm_per_px
    if "scale_mm_per_px" not in camera.model_fields_set:
        whole, near = (
            np.max((np.ptp(p, axis=0) + 2 * _ROOM * length) / pixels) for p in (points, tips)
        )
        sharp = scene.finger.thickness / (_WINDOWS * scene.piv.window)
        scale = _rounded_up(1e3 * float(min(whole, max(near, sharp))))
    size = 1e-3 * scale * pixels
    middle = 0.5 * (points.min(0) + points.max(0))
    first, last = tips.min(0), tips.max(0)
    room = np.maximum(0.0, np.minimum(_ROOM * length, 0.5 * (size - last + first)))
    # a small picture leaves out the root
    middle = np.clip(middle, last + room - 0.5 * size, first - room + 0.5 * size)
    values: dict[str, Any] = {
        "camera.scale_mm_per_px": scale,
        "sheet.spacing": round(_SPACING_PX * scale * 1e-3, 7),
        "vortices.min_circulation": _rounded_up(_LEAST_CIRCULATION * path.speed * length),
    }
    for name in list(values):
        section, key = name.split(".")
        if key in getattr(scene, section).model_fields_set:
            del values[name]
    return {"camera.centre": [round(float(x), 4) for x in middle]} | values


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
