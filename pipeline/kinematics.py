"""Stage kinematics: the pressure law and the family of finger shapes, checked and written to kinematics.h5."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from pipeline import paper_model
from pipeline.contact import closing_law, closing_sentence, closing_summary, gap
from pipeline.errors import StageError
from pipeline.motion_law import PressureLaw, measured_law, stroke_law
from pipeline.recorded import recorded_law, recorded_states
from pipeline.scene import Finger, Motion, Scene, digest
from pipeline.scene_pinch import Pinch
from pipeline.shape_checks import check_shapes
from pipeline.shapes import ShapeFamily, States, add_tip, circular_states, rounded_strip
from pipeline.stage import run_stage, write_dataset
from pipeline.states import read_states

PAPER_LOWEST_PRESSURE = paper_model.LOWEST_VALID_PRESSURE
LAW_SAMPLES_PER_SECOND = 4000
GAP_STEP = 0.2  # of the logarithm of the gap from shape to shape: the mesh between the tips shrinks with it
LENGTH_TOLERANCE = 0.02  # of finger.length against that of its states: digitised profiles are no better


@dataclass(frozen=True)
class Kinematics:
    """A pressure law and the shapes it runs through, with the placement in the tank.

    `law` is that of the shapes: in a pinch the fingers stop where they meet, while the chambers' own pressure,
    `free_law`, goes on.
    """

    law: PressureLaw
    free_law: PressureLaw
    family: ShapeFamily
    finger: Finger
    states: States

    def to_tank(self, points: np.ndarray) -> np.ndarray:
        """Points (…, 2) from the actuator's frame (origin at the middle of the root) to the tank's."""
        return self.turn(points) + np.asarray(self.finger.root)

    def outline(self, pressure: float) -> np.ndarray:
        """Closed outline (point, 2) of finger 0 in the tank frame at a pressure of the shape in Pa."""
        return self.to_tank(self.family.outline(pressure))

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (…, 2) from the actuator's axes to the tank's."""
        side = 1.0 if self.finger.ventral == "+x" else -1.0
        hanging = np.stack([side * vectors[..., 1], -vectors[..., 0]], axis=-1)
        c, s = np.cos(np.radians(self.finger.tilt_deg)), np.sin(np.radians(self.finger.tilt_deg))
        return hanging @ np.array([[c, s], [-s, c]])


def load_kinematics(scene: Scene) -> Kinematics:
    """The motion that a scene asks for. Raises StageError where it cannot be."""
    motion, finger = scene.motion, scene.finger
    law = _pressure_law(motion, scene.folder)
    time = law_times(motion.end_time)
    pressure = law(time)
    states = _states(motion, finger, scene.folder, float(pressure.min()), float(pressure.max()))
    low, high = states.pressure[0], states.pressure[-1]
    if pressure.min() < low - 1e-6 or pressure.max() > high + 1e-6:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: motion runs over {pressure.min() / 1e3:.3g}…{pressure.max() / 1e3:.3g} kPa"
            f" but the states cover {low / 1e3:.3g}…{high / 1e3:.3g} kPa; shorten the stroke or add states"
        )
    rest = int(np.argmin(np.abs(states.pressure)))
    length = float(np.hypot(*np.diff(states.profile[rest], axis=0).T).sum())
    if abs(length - finger.length) > LENGTH_TOLERANCE * finger.length:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: finger.length = {finger.length:g} m but the states of motion.states are"
            f" {length:.4g} m long; give that length"
        )
    states = add_tip(states, finger.tip.length, finger.tip.thickness)
    s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(states.profile[rest], axis=0).T))])
    strip = rounded_strip(
        s[-1], states.thickness[rest], s, finger.root_corner_radius, finger.tip.corner_radius
    )
    free = Kinematics(law, law, ShapeFamily(states, strip), finger, states)
    pinch = scene.pinch
    if pinch is None:
        return free
    closed = closing_law(
        law,
        lambda p: float(gap(free.outline(p), pinch)),
        float(law(np.zeros(1))[0]),
        float(high),
        pinch,
        str(scene.folder / "scene.toml"),
    )
    return replace(free, law=closed)


def law_times(end_time: float) -> np.ndarray:
    """Instants (s) at which the law is written; a spline through them is exact to rounding."""
    return np.linspace(0.0, end_time, int(np.ceil(end_time * LAW_SAMPLES_PER_SECOND)) + 1)


def _pressure_law(motion: Motion, folder: Path) -> PressureLaw:
    if motion.source == "recording":
        assert motion.recording is not None  # the scene's own check
        return recorded_law(folder / motion.recording, motion.recording_factor)
    if motion.pressure_csv:
        return measured_law(folder / motion.pressure_csv)
    strokes = [(s.pressure_kpa * 1e3, s.start, s.duration) for s in motion.strokes]
    return stroke_law(motion.start_pressure_kpa * 1e3, strokes)


def _states(motion: Motion, finger: Finger, folder: Path, lowest: float, highest: float) -> States:
    if motion.source == "recording":
        assert motion.recording is not None  # the scene's own check
        return recorded_states(folder / motion.recording)
    if motion.source == "fea":
        assert motion.states is not None  # the scene's own check
        return read_states(folder / motion.states, finger.thickness)
    if lowest < PAPER_LOWEST_PRESSURE:
        raise StageError(
            f"{folder / 'scene.toml'}: motion reaches {lowest / 1e3:.3g} kPa, but equations (1)-(6) let the chambers'"
            f" walls cross below {PAPER_LOWEST_PRESSURE / 1e3:g} kPa; set motion.source = 'fea'"
        )
    pressure = np.linspace(min(lowest, -1e3), max(highest, 1e3), 41)
    bend, _ = paper_model.bend(pressure, length=finger.length)
    return circular_states(pressure, bend, finger.length, finger.thickness)


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
            "scene_hash": digest(scene.settings("kinematics")),
            "settings": json.dumps(scene.settings("kinematics")),
        },
    )


def run(scene: Scene, quiet: bool = False) -> None:
    """Write kinematics.h5."""
    dataset = kinematics_dataset(scene)
    write_dataset(dataset, scene.out / "kinematics.h5")
    if not quiet:
        bend = np.degrees(dataset["shape_bend"].values)
        speed = dataset.attrs["peak_tip_speed"]
        print(
            f"kinematics: {bend.min():.1f}° … {bend.max():.1f}° of bend in {len(bend)} shapes, tip ≤ {speed:.3f} m/s"
        )
        if scene.pinch is not None:
            print(f"kinematics: {closing_sentence(dataset.attrs)}")


if __name__ == "__main__":
    run_stage("kinematics", __doc__, run)
