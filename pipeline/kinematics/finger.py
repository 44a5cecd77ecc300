"""A finger in motion: the pressure law, the shapes, and where it hangs in the tank."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from pipeline.fea import paper_equations as paper_model
from pipeline.formats.bending_states import States, read_states, shapes_of
from pipeline.formats.recorded_motion import read_recorded_motion
from pipeline.kinematics.contact import closing_law, gap
from pipeline.kinematics.pressure_law import PressureLaw, measured_law, stroke_law
from pipeline.kinematics.recorded_motion import recorded_law
from pipeline.kinematics.shapes import (
    FingerShapes,
    add_tip,
    arc_length,
    circular_states,
    pieces,
    rounded_strip,
    with_chambers,
    with_mount,
)
from pipeline.scene.pinch import Pinch
from pipeline.scene.sections import SMOOTHING, Finger, Motion
from piv.files.errors import StageError

_LAW_SAMPLES_PER_SECOND = 4000
# of finger.length against that of its states: digitised profiles are no better
_LENGTH_TOLERANCE = 0.02
_CLIPPED = 0.01  # of the range of the states: a sensor's offset and noise, not another stroke
_ROUNDING = 1e-6  # Pa
_POINTS, _MOUNTED_POINTS = 480, 9600  # of an outline; the latter are thinned out with the mount's


@dataclass(frozen=True)
class FingerMotion:
    """A law of the shape parameter and the shapes it runs through, with the placement in the tank.

    `free_law` is the chambers' own pressure: in a pinch it goes on after the shape has stopped. The
    parameter is a pressure or, where the shapes are given `over_time`, the time.
    """

    law: PressureLaw
    free_law: PressureLaw
    shapes: FingerShapes
    finger: Finger
    states: States
    over_time: bool = False

    def to_tank(self, points: ndarray) -> ndarray:
        """Points (…, 2) from the actuator's frame, origin at the root's middle, to the tank's."""
        return self.turn(points) + np.asarray(self.finger.root)

    def outline(self, pressure: float) -> ndarray:
        """Closed outline (point, 2) of finger 0 in the tank frame at a pressure of the shape."""
        return self.to_tank(self.shapes.outline(pressure))

    def outline_of(self, profile: ndarray, thickness: ndarray) -> ndarray:
        """The outline in another shape: profile (point, 2) without tip, and thickness (point,)."""
        other = States(np.zeros(1), profile[None], thickness[None])
        other = add_tip(other, self.finger.tip.length, self.finger.tip.thickness)
        (angle,), (length,) = pieces(other.profile)
        shapes = self.shapes
        return self.to_tank(shapes.place(shapes.strip, angle, length, other.thickness[0]))

    def turn(self, vectors: ndarray) -> ndarray:
        """Vectors (…, 2) from the actuator's axes to the tank's."""
        return vectors @ axes(self.finger)


def axes(finger: Finger) -> ndarray:
    """Rows: the actuator's axes, along the finger and to the ventral side, in the tank frame."""
    side = 1.0 if finger.ventral == "+x" else -1.0
    c, s = np.cos(np.radians(finger.tilt_deg)), np.sin(np.radians(finger.tilt_deg))
    return np.array([[0.0, -1.0], [side, 0.0]]) @ np.array([[c, s], [-s, c]])


def finger_motion(
    motion: Motion,
    finger: Finger,
    pinch: Pinch | None,
    folder: Path,
    over_time: States | None = None,
) -> FingerMotion:
    """The motion of a scene in `folder`; StageError where it cannot be.

    `over_time`: shapes at times (s) in place of those at pressures.
    """
    where = folder / "scene.toml"
    law = free_law = pressure_law(motion, folder)
    time = law_times(motion.end_time)
    if over_time is not None:
        law, states = _time_itself, over_time
    pressure = law(time)
    lowest, highest = float(pressure.min()), float(pressure.max())
    if over_time is None:
        states = finger_states(motion, finger, folder, lowest, highest)
        law = free_law = within(law, states)
        pressure = law(time)
        lowest, highest = float(pressure.min()), float(pressure.max())
    low, high = states.pressure[0], states.pressure[-1]
    if lowest < low - 1e-6 or highest > high + 1e-6:
        source = folder / (motion.recording or motion.pressure_csv or "scene.toml")
        raise StageError(
            f"{source}: the motion runs over {lowest / 1e3:.3g}…{highest / 1e3:.3g} kPa"
            f" but the states cover {low / 1e3:.3g}…{high / 1e3:.3g} kPa;"
            f" change it, or analyse more pressures ([fea] in {where})"
        )
    rest = int(np.argmin(np.abs(states.pressure)))
    length = arc_length(states.profile[rest])[-1]
    if abs(length - finger.length) > _LENGTH_TOLERANCE * finger.length:
        raise StageError(
            f"{where}: finger.length = {finger.length:g} m but the states of motion.states are"
            f" {length:.4g} m long; give that length, or states of a finger of yours"
        )
    states = add_tip(states, finger.tip.length, finger.tip.thickness)
    s, thickness = arc_length(states.profile[rest]), states.thickness[rest]
    root_radius = 0.0 if finger.mount else finger.root_corner_radius
    points = _MOUNTED_POINTS if finger.mount else _POINTS
    strip = rounded_strip(s[-1], thickness, s, root_radius, finger.tip.corner_radius, points)
    if finger.chambers is not None:
        try:
            strip = with_chambers(strip, finger.chambers, finger.length, thickness, s)
        except ValueError as error:
            raise StageError(f"{where}: {error}") from None
    if finger.mount is not None:
        strip = with_mount(strip, finger.mount, thickness, s)
    shapes = FingerShapes(states, strip)
    free = FingerMotion(law, free_law, shapes, finger, states, over_time is not None)
    if pinch is None:
        return free

    def gap_at(parameter: float) -> float:
        return float(gap(free.outline(parameter), pinch))

    start = float(law(np.zeros(1))[0])
    return replace(free, law=closing_law(law, gap_at, start, float(high), pinch, str(where)))


def within(law: PressureLaw, states: States) -> PressureLaw:
    """A law whose pressures beyond the states by less than 1 % of their range are clipped."""
    low, high = states.pressure[0], states.pressure[-1]
    band = _CLIPPED * (high - low)

    def clipped(time: ndarray, derivative: int = 0) -> ndarray:
        pressure = law(time)
        over = ((pressure < low) & (pressure >= low - band)) | (
            (pressure > high) & (pressure <= high + band)
        )
        if not over.any():
            return law(time, derivative) if derivative else pressure
        if derivative:
            return np.where(over, 0.0, law(time, derivative))
        return np.where(over, np.clip(pressure, low, high), pressure)

    return clipped


def clipping(motion: Motion, finger: Finger, folder: Path) -> str:
    """A remark on pressures that `within` clips, with how far they are beyond; "" without any."""
    raw = pressure_law(motion, folder)(law_times(motion.end_time))
    states = finger_states(motion, finger, folder, float(raw.min()), float(raw.max()))
    low, high = states.pressure[0], states.pressure[-1]
    beyond = max(low - raw.min(), raw.max() - high)
    if beyond <= _ROUNDING or motion.source == "recording":
        return ""
    return (
        f"{motion.pressure_csv or 'the pressure'} is up to {beyond / 1e3:.2g} kPa beyond the states"
        f" of {low / 1e3:g} to {high / 1e3:g} kPa: it is clipped there"
    )


def _time_itself(time: ndarray, derivative: int = 0) -> ndarray:
    """The law of shapes that are given over time."""
    time = np.asarray(time, float)
    return time if derivative == 0 else np.full(time.shape, float(derivative == 1))


def law_times(end_time: float) -> ndarray:
    """Instants (s) at which the law is written; a spline through them is exact to rounding."""
    return np.linspace(0.0, end_time, int(np.ceil(end_time * _LAW_SAMPLES_PER_SECOND)) + 1)


def pressure_law(motion: Motion, folder: Path) -> PressureLaw:
    """Pressure (Pa) in the chambers over time; of a recording the shape's parameter."""
    if motion.source == "recording":
        return recorded_law(folder / str(motion.recording), motion.recording_factor)
    if motion.pressure_csv:
        span = SMOOTHING if motion.smoothing is None else motion.smoothing
        return measured_law(folder / motion.pressure_csv, span, motion.end_time)
    strokes = [(s.pressure_kpa * 1e3, s.start, s.duration) for s in motion.strokes]
    return stroke_law(motion.start_pressure_kpa * 1e3, strokes)


def finger_states(
    motion: Motion, finger: Finger, folder: Path, lowest: float, highest: float
) -> States:
    """Shapes without a passive tip over pressures from `lowest` to `highest` (Pa); StageError."""
    if motion.source == "recording":
        path = folder / str(motion.recording)
        return shapes_of(read_recorded_motion(path), "state_pressure", path)
    if motion.source in ("fea", "structure"):
        return read_states(folder / str(motion.states), finger.thickness)
    valid = paper_model.LOWEST_VALID_PRESSURE
    if lowest < valid:
        raise StageError(
            f"{folder / 'scene.toml'}: motion reaches {lowest / 1e3:.3g} kPa, but equations (1)-(6)"
            f" let the chambers' walls cross below {valid / 1e3:g} kPa; set motion.source = 'fea'"
        )
    pressure = np.linspace(min(lowest, -1e3), max(highest, 1e3), 41)
    bend, _ = paper_model.bend(pressure, length=finger.length)
    return circular_states(pressure, bend, finger.length, finger.thickness)
