"""Stage kinematics: the pressure law and the family of finger shapes, checked and written to kinematics.h5."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fileio.formats.kinematics import write_kinematics
from pipeline.fea import paper_equations as paper_model
from pipeline.kinematics import rigid_body as rigid
from pipeline.kinematics.contact import closing_sentence, closing_summary, gap
from pipeline.kinematics.finger import Kinematics, law_times, load_kinematics
from pipeline.kinematics.shape_checks import check_shapes
from pipeline.scene.pinch import Pinch
from pipeline.scene.scene import Scene
from pipeline.stage_settings import settings_of

GAP_STEP = 0.2  # of the logarithm of the gap from shape to shape: the mesh between the tips shrinks with it


def shape_knots(
    kinematics: Kinematics, lowest: float, highest: float, step: float, pinch: Pinch | None = None
) -> np.ndarray:
    """Pressures (Pa) from `lowest` to `highest` at even steps of at most `step` rad of bend; at least five.

    In a pinch a step closes or opens the gap by no more than GAP_STEP of itself either, so that the last shapes lie close
    together.
    """
    fine = np.linspace(lowest, highest, 2001)
    steps = np.abs(np.diff([kinematics.family.bend(p) for p in fine])) / step
    if pinch is not None:
        gaps = gap(np.array([kinematics.outline(p) for p in fine]), pinch)
        steps = np.maximum(
            steps, np.abs(np.diff(np.log(np.maximum(gaps, 0.5 * pinch.residual_gap)))) / GAP_STEP
        )
    walk = np.concatenate([[0], np.cumsum(steps)])
    count = max(5, int(np.ceil(walk[-1])) + 1)
    return np.interp(np.linspace(0, walk[-1], count), walk, fine)


def input_uncertainty(kinematics: Kinematics) -> dict[str, np.ndarray]:
    """Bend of the states and of the paper's equations, and the standard uncertainty of the bend, where known."""
    states, length = kinematics.states, kinematics.finger.length
    family = kinematics.family
    paper, _ = paper_model.bend(states.pressure, length=length)
    found = {
        "state_pressure": states.pressure,
        "state_bend": np.array([family.bend(p) for p in states.pressure]),
        "paper_bend": paper,
    }
    if states.curvature_std is not None:
        found["state_bend_std"] = length * states.curvature_std
    return found


def contact_values(
    kinematics: Kinematics, time: np.ndarray, knots: np.ndarray, outlines: np.ndarray, pinch: Pinch | None
) -> dict[str, Any]:
    """What a pinch adds to the file: the gap over time and over the shapes, the chambers' own pressure, and attributes.

    The gap over time is that of the spline through the shapes, which is what the mesh follows.
    """
    if pinch is None:
        return {}
    shapes, pressure = CubicSpline(knots, outlines), kinematics.law(time)
    gaps = np.concatenate(
        [gap(shapes(part), pinch) for part in np.array_split(pressure, len(time) // 200 + 1)]
    )
    return {
        "free_pressure": kinematics.free_law(time),
        "gap": gaps,
        "shape_gap": gap(outlines, pinch),
        "mirror": 1,
    } | closing_summary(time, gaps, pinch)


def kinematics_values(scene: Scene) -> dict[str, Any]:
    """Variables and attributes of kinematics.h5 for a scene with a finger."""
    kinematics = load_kinematics(scene)
    time = law_times(scene.motion.end_time)
    pressure = kinematics.law(time)
    low, high = float(pressure.min()), float(pressure.max())
    if high - low < 1e-9:
        high = low + 1.0
    knots = shape_knots(kinematics, low, high, np.radians(scene.motion.max_bend_step_deg) / 2, scene.pinch)
    family = kinematics.family
    bends = np.array([family.bend(p) for p in knots])
    outlines = np.array([kinematics.outline(p) for p in knots])
    check_shapes(outlines, bends, scene)
    tips = np.array([family.tip(p) for p in knots])
    tip = kinematics.to_tank(tips[:, 0])
    speed = np.hypot(*(CubicSpline(knots, tip)(pressure, 1) * kinematics.law(time, 1)[:, None]).T)
    return {
        "time": time,
        "pressure": pressure,
        "shape_parameter": knots,
        "shape_outline": outlines,
        "shape_bend": bends,
        "shape_tip": tip,
        "shape_tip_direction": kinematics.turn(tips[:, 1]),
        "shape_dorsal_direction": kinematics.turn(tips[:, 2]),
        "source": scene.motion.source,
        "tip_thickness": family.tip_thickness,
        "peak_tip_speed": float(speed.max()),
        **contact_values(kinematics, time, knots, outlines, scene.pinch),
        **input_uncertainty(kinematics),
    }


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    values, unit = rigid.kinematics_values(scene) if scene.body else (kinematics_values(scene), "Pa")
    write_kinematics(scene.out / "kinematics.h5", values, settings_of(scene, "kinematics"), unit)
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
