"""Stage kinematics: the pressure law and the family of finger shapes, checked and written to kinematics.h5."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from fileio.hdf5 import write_dataset
from fileio.provenance import digest
from pipeline.fea import paper_equations as paper_model
from pipeline.kinematics import rigid_body as rigid
from pipeline.kinematics.contact import closing_sentence, closing_summary, gap
from pipeline.kinematics.finger import Kinematics, law_times, load_kinematics
from pipeline.kinematics.shape_checks import check_shapes
from pipeline.scene.command import run_stage
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


def input_uncertainty(
    kinematics: Kinematics, at: np.ndarray
) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
    """Bend of the states and of the paper's equations, and the standard uncertainty of both bend angles, where known.

    `at` (look,) Pa: the pressures at which `bend_std` is given.
    """
    states, length = kinematics.states, kinematics.finger.length
    family = kinematics.family
    paper, _ = paper_model.bend(states.pressure, length=length)
    found = {
        "state_pressure": ("state", states.pressure, {"units": "Pa"}),
        "state_bend": ("state", np.array([family.bend(p) for p in states.pressure]), {"units": "rad"}),
        "paper_bend": ("state", paper, {"units": "rad", "long_name": "equations (1)-(6)"}),
    }
    if states.curvature_std is not None:
        std = length * states.curvature_std
        found["state_bend_std"] = ("state", std, {"units": "rad"})
        found["bend_std"] = ("look", np.interp(at, states.pressure, std), {"units": "rad"})
    return found


def contact_variables(
    kinematics: Kinematics, time: np.ndarray, knots: np.ndarray, outlines: np.ndarray, pinch: Pinch | None
) -> tuple[dict[str, tuple[str, np.ndarray, dict[str, str]]], dict[str, float]]:
    """What a pinch adds to the file: the gap over time and over the shapes, the chambers' own pressure; and attributes.

    The gap over time is that of the spline through the shapes, which is what the mesh follows.
    """
    if pinch is None:
        return {}, {}
    shapes, pressure = CubicSpline(knots, outlines), kinematics.law(time)
    gaps = np.concatenate(
        [gap(shapes(part), pinch) for part in np.array_split(pressure, len(time) // 200 + 1)]
    )
    variables = {
        "free_pressure": ("time", kinematics.free_law(time), {"units": "Pa", "long_name": "in the chambers"}),
        "gap": ("time", gaps, {"units": "m"}),
        "shape_gap": ("shape_parameter", gap(outlines, pinch), {"units": "m"}),
    }
    return variables, {"mirror": 1} | closing_summary(time, gaps, pinch)


def kinematics_dataset(scene: Scene) -> xr.Dataset:
    """Everything of docs/formats.md, Kinematics, as a dataset."""
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
    rates = kinematics.turn(np.array([family.outline_rate(p) for p in knots]))
    tips = np.array([family.tip(p) for p in knots])
    tip = kinematics.to_tank(tips[:, 0])
    rate = kinematics.law(time, 1)
    contact, summary = contact_variables(kinematics, time, knots, outlines, scene.pinch)
    look = np.linspace(0, scene.motion.end_time, 101)
    at = kinematics.law(look)
    moving = np.array([family.outline_rate(p) for p in at]) * kinematics.law(look, 1)[:, None, None]
    shown = kinematics.to_tank(np.array([family.outline(p) for p in at]))
    point = ("point", "axis")
    return xr.Dataset(
        {
            "pressure": ("time", pressure, {"units": "Pa"}),
            "pressure_rate": ("time", rate, {"units": "Pa/s"}),
            "bend": ("look", np.array([family.bend(p) for p in at]), {"units": "rad"}),
            "outline": (("look", *point), shown, {"units": "m"}),
            "outline_velocity": (("look", *point), kinematics.turn(moving), {"units": "m/s"}),
            **contact,
            **input_uncertainty(kinematics, at),
            "shape_outline": (("shape_parameter", *point), outlines, {"units": "m"}),
            "shape_outline_rate": (("shape_parameter", *point), rates, {"units": "m/Pa"}),
            "shape_bend": ("shape_parameter", bends, {"units": "rad"}),
            "shape_tip": (("shape_parameter", "axis"), tip, {"units": "m"}),
            "shape_tip_direction": (("shape_parameter", "axis"), kinematics.turn(tips[:, 1]), {"units": "1"}),
            "shape_dorsal_direction": (
                ("shape_parameter", "axis"),
                kinematics.turn(tips[:, 2]),
                {"units": "1"},
            ),
        },
        coords={
            "time": ("time", time, {"units": "s"}),
            "look": ("look", look, {"units": "s", "long_name": "instants of outline and outline_velocity"}),
            "shape_parameter": ("shape_parameter", knots, {"units": "Pa"}),
        },
        attrs={
            "format": "kinematics",
            "format_version": 1,
            "source": scene.motion.source,
            "finger_width": scene.finger.width,
            "tip_thickness": family.tip_thickness,
            "peak_tip_speed": float(
                np.hypot(*(CubicSpline(knots, tip)(pressure, 1) * rate[:, None]).T).max()
            ),
            **summary,
            "scene_hash": digest(settings_of(scene, "kinematics")),
            "settings": json.dumps(settings_of(scene, "kinematics")),
        },
    )


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    dataset = rigid.kinematics_dataset(scene) if scene.body else kinematics_dataset(scene)
    write_dataset(dataset, scene.out / "kinematics.h5")
    if not quiet and scene.body:
        print(f"kinematics: a {scene.body.shape} in {dataset.sizes['shape_parameter']} places")
    elif not quiet:
        bend = np.degrees(dataset["shape_bend"].values)
        speed = dataset.attrs["peak_tip_speed"]
        print(
            f"kinematics: {bend.min():.1f}° … {bend.max():.1f}° of bend in {len(bend)} shapes, tip ≤ {speed:.3f} m/s"
        )
        if scene.pinch is not None:
            print(f"kinematics: {closing_sentence(dataset.attrs)}")


if __name__ == "__main__":
    run_stage("kinematics", __doc__, run)
