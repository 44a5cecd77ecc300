"""Stage kinematics: the pressure law and the finger's shapes, written to kinematics.h5."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fileio.formats.kinematics import SHAPE, SHAPE_OF_TIME, write_kinematics
from pipeline.fea import paper_equations as paper_model
from pipeline.kinematics.contact import closing_sentence, closing_summary, gap
from pipeline.kinematics.finger import FingerMotion, finger_motion, law_times
from pipeline.kinematics.rigid_body import rigid_values
from pipeline.kinematics.shape_checks import check_body, check_motion, check_number, check_shapes
from pipeline.scene.pinch import Pinch
from pipeline.scene.scene import Scene

_JUMP = 0.05  # of the peak rate: a motion that starts with more starts impulsively
_GAP_STEP = 0.2  # of the logarithm of the gap from shape to shape: the mesh there shrinks with it


def _shape_knots(
    motion: FingerMotion, lowest: float, highest: float, step: float, pinch: Pinch | None
) -> np.ndarray:
    """Parameters of at least five shapes, at even steps of at most `step` rad of bend.

    In a pinch a step changes the gap by no more than _GAP_STEP of itself. Shapes over time lie no
    farther apart than those of their file.
    """
    fine = np.linspace(lowest, highest, 2001)
    steps = np.abs(np.diff([motion.shapes.bend(p) for p in fine])) / step
    if motion.over_time:
        known = motion.states.pressure
        steps = np.maximum(steps, np.diff(np.interp(fine, known, np.arange(len(known)))))
    if pinch is not None:
        gaps = gap(np.array([motion.outline(p) for p in fine]), pinch)
        change = np.abs(np.diff(np.log(np.maximum(gaps, 0.5 * pinch.residual_gap))))
        steps = np.maximum(steps, change / _GAP_STEP)
    walk = np.concatenate([[0], np.cumsum(steps)])
    count = max(5, int(np.ceil(walk[-1])) + 1)
    return np.interp(np.linspace(0, walk[-1], count), walk, fine)


def _finger_values(
    motion: FingerMotion, end_time: float, bend_step: float, pinch: Pinch | None
) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5 for a finger, shapes `bend_step` rad apart."""
    time = law_times(end_time)
    parameter = motion.law(time)
    low, high = float(parameter.min()), float(parameter.max())
    if high - low < 1e-9:
        high = low + 1.0
    knots = states = motion.states.pressure
    if not motion.over_time or high < states[-1]:  # else as computed: no contact stops it
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
        length = motion.finger.length
        values["state_pressure"] = states
        values["state_bend"] = np.array([motion.shapes.bend(p) for p in states])
        values["paper_bend"], _ = paper_model.bend(states, length=length)
        if motion.states.curvature_std is not None:
            values["state_bend_std"] = length * motion.states.curvature_std
    if pinch is not None:
        # the gap over time is that of the spline through the shapes, which the mesh follows
        spline = CubicSpline(knots, outlines)
        parts = np.array_split(parameter, len(time) // 200 + 1)
        gaps = np.concatenate([gap(spline(part), pinch) for part in parts])
        values |= {"free_pressure": motion.free_law(time), "gap": gaps, "mirror": 1}
        values["shape_gap"] = gap(outlines, pinch)
        values |= closing_summary(time, gaps, pinch)
    return values


def motion_rate(values: dict[str, Any]) -> np.ndarray:
    """Rate (time,) of the shape parameter."""
    parameter = values.get(SHAPE_OF_TIME, values["pressure"])
    return np.asarray(CubicSpline(values["time"], parameter)(values["time"], 1))


def kinematics_values(scene: Scene) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5; StageError where the motion cannot be."""
    motion, where = scene.motion, scene.folder / "scene.toml"
    if scene.body is not None:
        values: dict[str, Any] = dict(rigid_values(scene.body, motion, where))
        check_body(values["shape_outline"], scene.tank, where)
    else:
        finger = finger_motion(motion, scene.finger, scene.pinch, scene.folder)
        bend_step = np.radians(motion.max_bend_step_deg) / 2
        values = _finger_values(finger, motion.end_time, bend_step, scene.pinch)
        outlines, bends = values["shape_outline"], values["shape_bend"]
        check_motion(float(np.ptp(values["shape_tip"], axis=0).max()), scene.finger.length, where)
        check_number(len(bends), "motion.max_bend_step_deg", motion.max_bend_step_deg, where)
        check_shapes(outlines, bends, scene.tank, scene.pinch, scene.support, where)
    finger_length = scene.finger.length + scene.finger.tip.length
    length = scene.body.size if scene.body is not None else finger_length
    root = np.array(scene.finger.root)
    values |= {"source": motion.source, "root": root, "length": length}
    return values


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    values = kinematics_values(scene)
    units = {}
    if scene.body is not None:  # the distance travelled
        units = dict.fromkeys(("pressure", SHAPE), "rad" if scene.motion.rotation else "m")
    elif SHAPE_OF_TIME in values:
        units = {SHAPE: "s"}
    write_kinematics(scene.out / "kinematics.h5", values, units)
    if not quiet and scene.body:
        print(f"kinematics: a {scene.body.shape} in {len(values['shape_parameter'])} places")
    elif not quiet:
        bend = np.degrees(values["shape_bend"])
        print(
            f"kinematics: {bend.min():.1f}° … {bend.max():.1f}° of bend in {len(bend)} shapes,"
            f" tip ≤ {values['peak_tip_speed']:.3f} m/s"
        )
        rate = np.abs(motion_rate(values))
        if rate[0] > _JUMP * rate.max():
            print(
                f"kinematics: warning: {scene.motion.pressure_csv or scene.motion.recording} begins"
                " with a jump of its slope: the first peak of force is that of an impulsive start;"
                " give motion.smoothing, or rows of rest before"
            )
        if scene.pinch is not None:
            print(f"kinematics: {closing_sentence(values)}")
