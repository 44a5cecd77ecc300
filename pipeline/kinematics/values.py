"""The variables of kinematics.h5: the law of the shapes and the shapes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.fea import paper_equations
from pipeline.formats.bending_states import States
from pipeline.formats.kinematics import SHAPE, SHAPE_OF_TIME, write_kinematics
from pipeline.kinematics.contact import closing_sentence, closing_summary, gap
from pipeline.kinematics.finger import FingerMotion, clipping, finger_motion, law_times
from pipeline.kinematics.pressure_law import absolute
from pipeline.kinematics.rigid_body import rigid_values
from pipeline.kinematics.shape_checks import check_body, check_motion, check_number, check_shapes
from pipeline.scene.pinch import Pinch
from pipeline.scene.scene import Scene

_JUMP = 0.05  # of the peak rate: a motion that starts with more starts impulsively
# of a motion over time: longest piece between two shapes, and longest where one would be longer
_LONGEST, _RESTING = 0.25, 0.06
_GAP_STEP = 0.2  # of the logarithm of the gap from shape to shape: the mesh there shrinks with it


def _shape_knots(
    motion: FingerMotion, lowest: float, highest: float, step: float, pinch: Pinch | None
) -> np.ndarray:
    """Parameters of at least five shapes, at even steps of at most `step` rad of bend.

    In a pinch a step changes the gap by no more than _GAP_STEP of itself.
    """
    fine = np.linspace(lowest, highest, 2001)
    steps = np.abs(np.diff([motion.shapes.bend(p) for p in fine])) / step
    if pinch is not None:
        gaps = gap(np.array([motion.outline(p) for p in fine]), pinch)
        change = np.abs(np.diff(np.log(np.maximum(gaps, 0.5 * pinch.residual_gap))))
        steps = np.maximum(steps, change / _GAP_STEP)
    if not steps.any():  # no pressure changes the shape
        return np.linspace(lowest, highest, 5)
    knots = _spaced(steps, fine)
    if motion.over_time and np.diff(knots).max() > _LONGEST * (highest - lowest):
        # a rest, which would be one long piece of the spline, and would overshoot
        knots = _spaced(np.maximum(steps, 1 / (_RESTING * len(steps))), fine)
    return knots


def _spaced(steps: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Parameters among the `fine` ones, between which the sum of `steps` is even, and 1 or less."""
    walk = np.concatenate([[0], np.cumsum(steps)])
    count = max(5, int(np.ceil(walk[-1])) + 1)
    return np.interp(np.linspace(0, walk[-1], count), walk, fine)


def _finger_values(
    motion: FingerMotion, end_time: float, bend_step: float | None, pinch: Pinch | None
) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5 for a finger.

    Its shapes are `bend_step` rad apart; None: those of the motion's states.
    """
    time = law_times(end_time)
    parameter = motion.law(time)
    low, high = float(parameter.min()), float(parameter.max())
    if high - low < 1e-9:
        high = low + 1.0
    knots = states = motion.states.pressure
    if bend_step is not None:
        knots = _shape_knots(motion, low, high, bend_step, pinch)
    outlines = np.array([motion.outline(p) for p in knots])
    tips = np.array([motion.shapes.tip(p) for p in knots])
    tip = motion.to_tank(tips[:, 0])
    speed = np.hypot(*(CubicSpline(knots, tip)(parameter, 1) * motion.law(time, 1)[:, None]).T)
    values = {
        "time": time,
        "pressure": parameter,
        "shape_parameter": knots,
        "shape_outline": outlines,
        "shape_bend": np.array([motion.shapes.bend(p) for p in knots]),
        "shape_tip": tip,
        "shape_tip_direction": motion.turn(tips[:, 1]),
        "shape_dorsal_direction": motion.turn(tips[:, 2]),
        "tip_thickness": motion.shapes.tip_thickness,
        "peak_tip_speed": float(speed.max()),
    }
    if motion.over_time:
        values |= {"pressure": motion.free_law(time), SHAPE_OF_TIME: parameter}
    else:
        values["state_pressure"] = states
        values["state_bend"] = np.array([motion.shapes.bend(p) for p in states])
        if motion.states.curvature_std is not None:
            values["state_bend_std"] = motion.finger.length * motion.states.curvature_std
    if pinch is not None:
        # the gap over time is that of the spline through the shapes, which the mesh follows
        spline = CubicSpline(knots, outlines)
        parts = np.array_split(parameter, len(time) // 200 + 1)
        gaps = np.concatenate([gap(spline(part), pinch) for part in parts])
        values |= {"gap": gaps, "mirror": 1}
        if not motion.over_time:
            values["free_pressure"] = motion.free_law(time)
        values["shape_gap"] = gap(outlines, pinch)
        values |= closing_summary(time, gaps, pinch)
    return values


def kinematics_values(
    scene: Scene, over_time: States | None = None, exact: bool = False
) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5; StageError where the motion cannot be.

    `over_time`: shapes at times (s), as of a coupled finger; `exact`: all of them are kept.
    """
    motion, where = scene.motion, scene.folder / "scene.toml"
    may_rest = scene.current is not None
    if scene.body is not None:
        values: dict[str, Any] = dict(rigid_values(scene.body, motion, where, may_rest))
        check_body(values["shape_outline"], scene.tank, where)
    else:
        pinch = None if exact else scene.pinch  # which keeps the guess from closing
        finger = finger_motion(motion, scene.finger, pinch, scene.folder, over_time)
        bend_step = None if exact else np.radians(motion.max_bend_step_deg) / 2
        values = _finger_values(finger, motion.end_time, bend_step, scene.pinch)
        if "state_pressure" in values and paper_equations.describes(scene.actuator):
            values["paper_bend"], _ = paper_equations.bend(
                values["state_pressure"], length=scene.finger.length
            )
        outlines, bends = values["shape_outline"], values["shape_bend"]
        if not exact:
            moved = float(np.ptp(values["shape_tip"], axis=0).max())
            if not may_rest:
                check_motion(moved, scene.finger.length, where)
            step = motion.max_bend_step_deg
            check_number(len(bends), "motion.max_bend_step_deg", step, where)
        fixed = scene.obstacle or ()
        check_shapes(outlines, bends, scene.tank, scene.pinch, scene.support, where, fixed)
    finger_length = scene.finger.length + scene.finger.tip.length
    length = scene.body.size if scene.body is not None else finger_length
    root = np.array(scene.finger.root)
    values |= {"source": motion.source, "root": root, "length": length}
    return values


def write_motion(scene: Scene, folder: Path, values: dict[str, Any]) -> None:
    """Write kinematics.h5 to a folder, with the units of a shape parameter that is no pressure."""
    units: dict[str, str] = {}
    if scene.body is not None:  # the distance travelled
        units = dict.fromkeys(("pressure", SHAPE), "rad" if scene.motion.rotation else "m")
    elif SHAPE_OF_TIME in values:
        units = {SHAPE: "s"}
    write_kinematics(folder / "kinematics.h5", values, units=units)


def motion_sentences(scene: Scene, values: dict[str, Any]) -> Iterator[str]:
    """What a stage prints of a motion that it has written."""
    if scene.body:
        yield f"kinematics: a {scene.body.shape} in {len(values['shape_parameter'])} places"
        return
    bend = np.degrees(values["shape_bend"])
    yield (
        f"kinematics: {bend.min():.1f}° … {bend.max():.1f}° of bend in {len(bend)} shapes,"
        f" tip ≤ {values['peak_tip_speed']:.3f} m/s"
    )
    rate = np.abs(CubicSpline(values["time"], values["pressure"])(values["time"], 1))
    if rate[0] > _JUMP * rate.max():
        yield (
            f"kinematics: warning: {scene.motion.pressure_csv or scene.motion.recording} begins"
            " with a jump of its slope: the first peak of force is that of an impulsive start;"
            " give motion.smoothing, or rows of rest before"
        )
    table = scene.motion.pressure_csv
    beyond = clipping(scene.motion, scene.finger, scene.folder)
    for remark in (beyond, absolute(scene.folder / table) if table else ""):
        if remark:
            yield f"kinematics: warning: {remark}"
    if scene.pinch is not None:
        yield f"kinematics: {closing_sentence(values)}"
