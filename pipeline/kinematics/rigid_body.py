"""Kinematics of a rigid body: the distance travelled takes the place of the pressure."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.interpolate import CubicSpline

from pipeline.kinematics.pressure_law import history_law, smooth_step
from pipeline.kinematics.shape_checks import check_motion, check_number
from pipeline.scene.rigid_body import Law, RigidBody
from pipeline.scene.sections import Motion
from piv.formats.user_tables import read_history

_SAMPLES_PER_SMOOTHING = 200  # a cubic spline through them is exact to 1e-9 of the law's step


@dataclass(frozen=True)
class Distance:
    """The distance (m or rad) and its rate over `time` (s)."""

    time: ndarray
    distance: ndarray
    rate: ndarray


def travelled(law: Law, end_time: float) -> Distance:
    """The law, sampled finely enough for a cubic spline; a rotation stays in degrees."""
    count = int(np.ceil(end_time / law.smoothing * _SAMPLES_PER_SMOOTHING)) + 1
    time = np.linspace(0.0, end_time, min(max(count, 2001), 400_001))
    since = np.maximum(time - law.start, 0.0)
    begun = smooth_step(since / law.smoothing)
    if law.kind == "sine":
        assert law.amplitude is not None
        assert law.period is not None
        turn = 2 * np.pi * since / law.period
        begins = smooth_step(since / law.smoothing, 1) / law.smoothing
        swing = begins * np.sin(turn) + begun * 2 * np.pi / law.period * np.cos(turn)
        rate = np.where(since > 0, law.amplitude * swing, 0.0)
        return Distance(time, law.amplitude * begun * np.sin(turn), rate)
    assert law.rate is not None
    assert law.exponent is not None
    rate = law.rate * begun * since**law.exponent
    return Distance(time, CubicSpline(time, rate).antiderivative()(time), rate)


def rest_outline(body: RigidBody) -> ndarray:
    """Closed counter-clockwise outline (point, 2) about the centre, m; a plate's ends are round."""
    if body.shape == "circle":
        turn = np.linspace(0, 2 * np.pi, body.points, endpoint=False)
        return 0.5 * body.size * np.column_stack([np.cos(turn), np.sin(turn)])
    assert body.thickness is not None
    radius, straight = 0.5 * body.thickness, body.size - body.thickness
    around = np.pi * radius
    walk = np.linspace(0, 2 * (around + straight), body.points, endpoint=False)
    side = walk // (around + straight)  # 0: right end and upper side, 1: the same turned by 180°
    s = walk - side * (around + straight)
    turn = np.minimum(s, around) / radius - 0.5 * np.pi
    x = 0.5 * straight + radius * np.cos(turn) - np.maximum(s - around, 0)
    points = (1 - 2 * side)[:, None] * np.column_stack([x, radius * np.sin(turn)])
    return _turned(points, np.radians(body.angle_deg))


def _turned(points: ndarray, angle: float) -> ndarray:
    """Points (…, 2) rotated counter-clockwise by `angle` rad."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def measured_path(path: Path, end_time: float) -> Distance:
    """A measured place over time: a cubic spline, at rest before and after."""
    time = np.linspace(0.0, end_time, 2001)
    law = history_law(*read_history(path, "place", least=3))
    return Distance(time, law(time) - law(np.zeros(1)), law(time, 1))


def rigid_values(
    body: RigidBody, motion: Motion, where: Path, may_rest: bool = False
) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5; StageError: no motion, or too many shapes.

    A body that `may_rest` needs no motion.
    """
    law = motion.displacement or motion.rotation
    if law:
        path = travelled(law, motion.end_time)
    else:
        path = measured_path(where.parent / str(motion.path_csv), motion.end_time)
    distance = (np.radians(1.0) if motion.rotation else 1.0) * path.distance
    low, high = float(distance.min()), float(distance.max())
    step = motion.path_step or (np.radians(5.0) if motion.rotation else 0.1 * body.size)
    if may_rest and low == high:
        high = low + step  # shapes that it does not take
    check_motion((high - low) * (0.5 * body.size if motion.rotation else 1.0), body.size, where)
    check_number((high - low) / step, "motion.path_step", step, where)
    knots = np.linspace(low, high, max(5, int(np.ceil((high - low) / step)) + 1))
    centre = np.asarray(body.centre)
    direction = _turned(np.array([1.0, 0.0]), np.radians(law.direction_deg if law else 0.0))

    def placed(points: ndarray) -> ndarray:
        if motion.rotation:
            return np.array([_turned(points, q) for q in knots]) + centre
        return points + centre + knots[:, None, None] * direction

    half = 0.5 * body.size if body.shape == "plate" else 0.0
    ends = np.array([[half, 0.0], [-half, 0.0]]) if half else np.zeros((1, 2))
    turn = knots if motion.rotation else np.zeros_like(knots)
    return {
        "time": path.time,
        "pressure": distance,
        "shape_parameter": knots,
        "shape_outline": placed(rest_outline(body)),
        "shape_edges": placed(_turned(ends, np.radians(body.angle_deg))),
        "shape_bend": turn,
        "shape_tip": centre + (0 * knots if motion.rotation else knots)[:, None] * direction,
        "shape_tip_direction": np.stack([np.cos(turn), np.sin(turn)], -1),
        "shape_dorsal_direction": np.stack([-np.sin(turn), np.cos(turn)], -1),
        "tip_thickness": body.size,
    }
