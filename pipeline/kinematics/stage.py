"""Stage kinematics: the pressure law and the finger's shapes, checked and written to kinematics.h5."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fileio.formats.kinematics import SHAPE, SHAPE_OF_TIME, write_kinematics
from pipeline.fea import paper_equations as paper_model
from pipeline.kinematics.contact import closing_sentence, closing_summary, gap
from pipeline.kinematics.finger import FingerMotion, finger_motion, law_times
from pipeline.kinematics.rigid_body import rigid_values
from pipeline.kinematics.shape_checks import check_body, check_shapes
from pipeline.scene.pinch import Pinch
from pipeline.scene.scene import Scene

GAP_STEP = 0.2  # of the logarithm of the gap from shape to shape: the mesh between the tips shrinks with it


def shape_knots(
    motion: FingerMotion, lowest: float, highest: float, step: float, pinch: Pinch | None = None
) -> np.ndarray:
    """Pressures (Pa) from `lowest` to `highest` at even steps of at most `step` rad of bend; at least five.

    In a pinch a step closes or opens the gap by no more than GAP_STEP of itself either, so that the last shapes lie close
    together. Shapes over time lie no farther apart than they were given.
    """
    fine = np.linspace(lowest, highest, 2001)
    steps = np.abs(np.diff([motion.shapes.bend(p) for p in fine])) / step
    if motion.over_time:
        given = motion.states.pressure
        steps = np.maximum(steps, np.diff(np.interp(fine, given, np.arange(len(given)))))
    if pinch is not None:
        gaps = gap(np.array([motion.outline(p) for p in fine]), pinch)
        steps = np.maximum(
            steps, np.abs(np.diff(np.log(np.maximum(gaps, 0.5 * pinch.residual_gap)))) / GAP_STEP
        )
    walk = np.concatenate([[0], np.cumsum(steps)])
    count = max(5, int(np.ceil(walk[-1])) + 1)
    return np.interp(np.linspace(0, walk[-1], count), walk, fine)


def input_uncertainty(motion: FingerMotion) -> dict[str, np.ndarray]:
    """Bend of the states and of the paper's equations, and the standard uncertainty of the bend, where known."""
    states, length = motion.states, motion.finger.length
    paper, _ = paper_model.bend(states.pressure, length=length)
    variables = {
        "state_pressure": states.pressure,
        "state_bend": np.array([motion.shapes.bend(p) for p in states.pressure]),
        "paper_bend": paper,
    }
    if states.curvature_std is not None:
        variables["state_bend_std"] = length * states.curvature_std
    return variables


def contact_values(
    motion: FingerMotion,
    time: np.ndarray,
    knots: np.ndarray,
    outlines: np.ndarray,
    pinch: Pinch | None,
) -> dict[str, Any]:
    """What a pinch adds to the file: the gap over time and over the shapes, the chambers' own pressure, and attributes.

    The gap over time is that of the spline through the shapes, which is what the mesh follows.
    """
    if pinch is None:
        return {}
    shapes, pressure = CubicSpline(knots, outlines), motion.law(time)
    gaps = np.concatenate(
        [gap(shapes(part), pinch) for part in np.array_split(pressure, len(time) // 200 + 1)]
    )
    return {
        "free_pressure": motion.free_law(time),
        "gap": gaps,
        "shape_gap": gap(outlines, pinch),
        "mirror": 1,
    } | closing_summary(time, gaps, pinch)


def finger_values(
    motion: FingerMotion, end_time: float, bend_step: float, pinch: Pinch | None
) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5 for a finger whose shapes are `bend_step` rad apart, or less."""
    time = law_times(end_time)
    parameter = motion.law(time)
    low, high = float(parameter.min()), float(parameter.max())
    if high - low < 1e-9:
        high = low + 1.0
    free = (
        motion.over_time and high >= motion.states.pressure[-1]
    )  # as computed: no contact holds it
    knots = motion.states.pressure if free else shape_knots(motion, low, high, bend_step, pinch)
    bends = np.array([motion.shapes.bend(p) for p in knots])
    outlines = np.array([motion.outline(p) for p in knots])
    tips = np.array([motion.shapes.tip(p) for p in knots])
    tip = motion.to_tank(tips[:, 0])
    speed = np.hypot(*(CubicSpline(knots, tip)(parameter, 1) * motion.law(time, 1)[:, None]).T)
    return {
        "time": time,
        **(
            {"pressure": motion.free_law(time), SHAPE_OF_TIME: parameter}
            if motion.over_time
            else {"pressure": parameter}
        ),
        "shape_parameter": knots,
        "shape_outline": outlines,
        "shape_bend": bends,
        "shape_tip": tip,
        "shape_tip_direction": motion.turn(tips[:, 1]),
        "shape_dorsal_direction": motion.turn(tips[:, 2]),
        "tip_thickness": motion.shapes.tip_thickness,
        "peak_tip_speed": float(speed.max()),
        **contact_values(motion, time, knots, outlines, pinch),
        **({} if motion.over_time else input_uncertainty(motion)),
    }


def kinematics_values(scene: Scene) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5. Raises StageError where the motion cannot be."""
    motion, where = scene.motion, scene.folder / "scene.toml"
    if scene.body is not None:
        values = rigid_values(scene.body, motion, where)
        check_body(values["shape_outline"], scene.tank, where)
    else:
        finger = finger_motion(motion, scene.finger, scene.pinch, scene.folder)
        values = finger_values(
            finger, motion.end_time, np.radians(motion.max_bend_step_deg) / 2, scene.pinch
        )
        outlines, bends = values["shape_outline"], values["shape_bend"]
        check_shapes(outlines, bends, scene.tank, scene.pinch, scene.support, where)
    return values | {"source": motion.source}


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    values = kinematics_values(scene)
    units = {}
    if scene.body is not None:
        units = dict.fromkeys(
            ("pressure", SHAPE), "rad" if scene.motion.rotation else "m"
        )  # its distance
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
        if scene.pinch is not None:
            print(f"kinematics: {closing_sentence(values)}")
