"""[current]: water that runs along the tank, in at one end and out at the other.

On the mesh's triangles OpenFOAM's gradient of a linear pressure errs. A stream that is accelerated
as a whole gets a few per cent of disturbances; one that runs is kept exactly. A current therefore
runs from the start, unless the scene gives a ramp or a table that begins at 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy import ndarray
from pydantic import model_validator
from scipy.interpolate import PchipInterpolator

from pipeline.scene.section import NotNegative, Positive, Section
from piv.files.errors import StageError
from piv.formats.user_tables import read_history

LEAD = "lead"  # folder in case/ of the stream before 0 s
_LEAD = 5.0  # widths of the body that the stream has run before the motion begins
_GRAVITY = 9.81  # m/s²
_FROUDE = 0.3  # by the depth: the surface then falls by less than 5 % of the depth
_BLOCKED = 0.3  # of the cross-section: water beside the body is faster by 1 / (1 - 0.3)
_NARROW = 0.05  # of it: forces are larger then, by about a tenth
_BEFORE, _BEHIND = 1.0, 2.0  # lengths of the body to the inflow and to the outflow, at least
_FASTER = 2.0  # speed beside a body in a current, over the current's
RAMP_STEPS = 20  # time steps in a ramp or a period
_MOST_STEPS = 20_000  # before 0 s
_FASTEST = 100.0  # m/s, of a table: more is another unit


class Current(Section):
    """Water that runs through the tank's ends along x."""

    speed: NotNegative | None = None
    """Beyond any boundary layer, after any ramp [m/s]"""
    direction: Literal["+x", "-x"] = "+x"
    """In which it runs where its speed is positive"""
    ramp: Positive | None = None
    """Time of a smooth start from rest; absent: it runs from the start [s]"""
    lead: Positive | None = None
    """For which a current that runs at 0 s has run past the body at rest; absent: 5 widths [s]"""
    amplitude: Positive | None = None
    """Of an oscillation that is added to the speed [m/s]"""
    frequency: Positive | None = None
    """Of that oscillation, a sine [Hz]"""
    table: str | None = None
    """CSV of the speed over time (t, u), in place of speed and oscillation"""
    profile: Literal["uniform", "boundary_layer", "channel"] = "uniform"
    """Of the inflow over the height; "channel": a parabola of mean `speed`, no-slip lid"""
    thickness: Positive | None = None
    """Of the boundary layer at the bottom [m]"""
    walls: Literal["no-slip", "slip"] = "no-slip"
    """Of the tank's bottom and sides; the lid slips, except in a channel"""

    @property
    def sign(self) -> int:
        """1 or -1: that of its direction along x."""
        return 1 if self.direction == "+x" else -1

    @property
    def channel(self) -> bool:
        """Whether the profile is a channel's, whose lid is a no-slip wall."""
        return self.profile == "channel"

    @model_validator(mode="after")
    def _whole(self) -> "Current":
        if (self.speed is None) == (self.table is None):
            raise ValueError("give either speed or table, not both and not neither")
        if (self.amplitude is None) != (self.frequency is None):
            raise ValueError("amplitude and frequency belong together; give both or neither")
        if self.table and self.amplitude:
            raise ValueError("amplitude goes with speed; remove it beside table")
        if not self.table and not self.speed and not self.amplitude:
            raise ValueError("speed = 0 without an amplitude is still water; remove [current]")
        if self.ramp and self.lead:
            raise ValueError("lead goes with a current that runs at 0 s; remove it, or ramp")
        if (self.profile == "boundary_layer") != (self.thickness is not None):
            raise ValueError("thickness goes with profile = 'boundary_layer'; give both or neither")
        if self.channel and self.walls == "slip":
            raise ValueError("water sticks to the walls of a channel; remove walls = 'slip'")
        return self


@dataclass(frozen=True)
class Stream:
    """A current as a field: `law`: its velocity along x (m/s) at times (s), beyond the layer.

    `depth` (m): of the water. `known`: first and last time (s) of its table, before and after which
    the law keeps a value.
    """

    current: Current
    law: Callable[[ndarray], ndarray]
    depth: float
    known: tuple[float, float] = (-math.inf, math.inf)

    @classmethod
    def of(cls, scene: Any) -> "Stream | None":
        """That of a scene, None without a current. StageError where its table is wrong."""
        depth = scene.tank.water_depth
        return None if scene.current is None else cls.read(scene.current, scene.folder, depth)

    @classmethod
    def read(cls, current: Current, folder: Path, depth: float) -> "Stream":
        """That of a scene in `folder`. StageError where its table is wrong."""
        sign, ramp = current.sign, current.ramp
        known = cls.known
        if current.table is None:
            mean, swing = current.speed or 0.0, current.amplitude or 0.0
            turning = 2 * np.pi * (current.frequency or 0.0)

            def steady(time: ndarray) -> ndarray:
                return np.asarray(mean + swing * np.sin(turning * time))
        else:
            path = folder / current.table
            times, speeds = read_history(path, "speed", least=2)
            known = float(times[0]), float(times[-1])
            if (fastest := float(np.abs(speeds).max())) > _FASTEST:
                raise StageError(
                    f"{path}: {fastest:.3g} m/s is no current's speed; give m/s, or name the"
                    " column u [cm/s] or u [mm/s]"
                )
            spline = PchipInterpolator(times, speeds)

            def steady(time: ndarray) -> ndarray:
                return np.asarray(spline(np.clip(time, times[0], times[-1])))

        def law(time: ndarray) -> ndarray:
            time = np.asarray(time, float)
            begun = 1.0 if ramp is None else _smooth(time / ramp)
            return np.asarray(sign * begun * steady(time))

        return cls(current, law, depth, known)

    def held(self) -> "Stream":
        """Return the same with the velocity that it begins with for ever."""
        begins = self.begins
        return Stream(self.current, lambda time: np.full(np.shape(time), begins), self.depth)

    @property
    def begins(self) -> float:
        """Velocity along x (m/s) at 0 s; 0: from rest."""
        return float(self.law(np.zeros(1))[0])

    def share(self, height: ndarray) -> ndarray:
        """Inflow at a `height` (m) above the bottom over the law's velocity."""
        if self.current.channel:
            part = np.clip(np.asarray(height, float) / self.depth, 0.0, 1.0)
            return np.asarray(6 * part * (1 - part))
        if self.current.thickness is None:
            return np.ones(np.shape(height))
        part = np.clip(np.asarray(height, float) / self.current.thickness, 0.0, 1.0)
        return np.asarray(2 * part - 2 * part**3 + part**4)

    def peak(self, end: float, step: float) -> float:
        """Largest speed (m/s) at the time steps until `end` (s)."""
        most = 1.5 if self.current.channel else 1.0
        return most * float(np.abs(self.law(step * np.arange(round(end / step) + 1))).max())


def _smooth(part: ndarray) -> ndarray:
    """0 before 0, 1 after 1, twice continuously differentiable."""
    x = np.clip(part, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def lead_steps(scene: Any) -> int:
    """Time steps for which the current runs past the body at rest before 0 s; 0 from rest."""
    stream = Stream.of(scene)
    if stream is None or not stream.begins:
        return 0
    wide = _height(scene) if scene.model.kind == "2d" else min(_height(scene), scene.finger.width)
    lead = stream.current.lead or _LEAD * wide / abs(stream.begins)
    return max(1, round(lead / scene.numerics.time_step))


def _height(scene: Any) -> float:
    """Extent (m) of the straight body across the stream, in the plane."""
    if scene.body:
        return float(scene.body.size)
    finger = scene.finger
    across = (finger.length + finger.tip.length) * math.cos(math.radians(finger.tilt_deg))
    mount = finger.mount.diameter if finger.mount else 0.0
    return max(across, finger.thickness if not mount else 0.0) + mount


def _reaches(scene: Any) -> tuple[float, float]:
    """How far (m) the body reaches against the stream and with it, from where it stands."""
    if scene.body:
        return 0.5 * scene.body.size, 0.5 * scene.body.size
    finger = scene.finger
    length = finger.length + finger.tip.length
    along = math.sin(math.radians(finger.tilt_deg)) * scene.current.sign
    mount = finger.mount.diameter if finger.mount else 0.0
    return max(length * min(1.0, 1 - along), mount), max(length * min(1.0, 1 + along), mount)


def frontal_share(scene: Any) -> float:
    """Part of the tank's cross-section that the body takes, standing straight across the stream."""
    across = 1.0 if scene.model.kind == "2d" else scene.finger.width / scene.tank.size[2]
    return _height(scene) / scene.tank.water_depth * across


def check_current(scene: Any) -> None:
    """ValueError where tank, mesh or time step cannot carry the scene's current."""
    current, tank, depth = scene.current, scene.tank, scene.tank.water_depth
    if current is None:
        return
    if scene.pinch is not None and not scene.both_fingers:
        raise ValueError(
            f"current: crosses the plane of symmetry of model.kind = {scene.model.kind!r}; give"
            " 'half' or 'full', whose mesh has both fingers"
        )
    if current.thickness is not None and current.thickness > depth:
        raise ValueError(
            f"current.thickness = {current.thickness:g} m is more than tank.water_depth; give at"
            f" most {depth:g}"
        )
    _check_speed(scene)
    high, (before, behind) = _height(scene), _reaches(scene)
    half, x = 0.5 * tank.size[0], scene.finger.root[0] * current.sign
    ends = ("in", half + x, before + _BEFORE * high), ("out", half - x, behind + _BEHIND * high)
    for name, room, needed in ends:
        if room < needed * (1 - 1e-9):
            raise ValueError(
                f"current: the {name}flow is {room:.3g} m from the middle of the body, less than"
                f" its reach and the water that it needs, {needed:.3g} m; give tank.size[0] ="
                f" {_rounded(tank.size[0] + 2 * (needed - room), up=True):g}, or move the body"
            )
    blocked = frontal_share(scene)
    if blocked > _BLOCKED:
        raise ValueError(
            f"current: the body takes {100 * blocked:.0f} % of the tank's cross-section, more than"
            f" {100 * _BLOCKED:.0f} %; give tank.water_depth ="
            f" {_rounded(depth * blocked / _BLOCKED, up=True):g} or more (and tank.size[1]), or a"
            " wider tank"
        )


def _check_speed(scene: Any) -> None:
    """ValueError where the current's speed or its changes are too large."""
    current, mesh, n, end = scene.current, scene.mesh, scene.numerics, scene.motion.end_time
    stream, step = Stream.read(current, scene.folder, scene.tank.water_depth), n.time_step
    peak, most = stream.peak(end, step), _FROUDE * (_GRAVITY * scene.tank.water_depth) ** 0.5
    if not peak > 0:
        raise ValueError(
            f"current: it does not run before motion.end_time = {end:g} s; give a later end_time,"
            " or a table that begins earlier"
        )
    if stream.known[0] >= end or stream.known[1] <= 0:
        first, last = stream.known
        raise ValueError(
            f"current.table = {current.table!r} has times from {first:g} to {last:g} s, the motion"
            f" from 0 to {end:g} s; correct the table's times, or name its column t [ms]"
        )
    if peak > most and not current.channel and scene.body is None:  # whose units are its own
        raise ValueError(
            f"current: {peak:.3g} m/s make waves in water of this depth, which the rigid lid has"
            f" not (Froude number above {_FROUDE:g}); give at most {_rounded(most):g} m/s"
        )
    if current.lead is not None and not stream.begins:
        raise ValueError("current.lead goes with a current that runs at 0 s; remove it")
    if (steps := lead_steps(scene)) > _MOST_STEPS:
        raise ValueError(
            f"current: runs {steps * step:.3g} s past the body at rest, {steps:.3g} of"
            f" numerics.time_step = {step:g} s; give current.lead = {_MOST_STEPS * step:g} or less"
        )
    for key, time in (("ramp", current.ramp), ("frequency", 1 / (current.frequency or 1e-9))):
        if time is not None and time < RAMP_STEPS * step * (1 - 1e-9):
            value = getattr(current, key)
            least = f"at least {RAMP_STEPS * step:g}"
            bound = least if key == "ramp" else f"at most {_rounded(1 / (RAMP_STEPS * step)):g}"
            raise ValueError(
                f"current.{key} = {value:g} changes within {RAMP_STEPS} of numerics.time_step ="
                f" {step:g} s; give {bound}"
            )
    cell = min(mesh.wall_cell, mesh.tip_cell, mesh.near_cell)
    courant = _FASTER * peak * step / cell
    if courant > n.max_courant:
        raise ValueError(
            f"current: {peak:.3g} m/s along cells of {cell:.2g} m are a Courant number of about"
            f" {courant:.2g}, more than numerics.max_courant = {n.max_courant:g}; give"
            f" numerics.time_step = {step / math.ceil(courant / n.max_courant):.6g} or less"
        )


def _rounded(value: float, up: bool = False) -> float:
    """Round a positive number to three digits that keep to a limit."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{(math.ceil if up else math.floor)(value / unit) * unit:.6g}")


def current_remarks(scene: Any) -> list[str]:
    """Warnings about a current that the tank carries, but not as open water would."""
    if scene.current is None or (blocked := frontal_share(scene)) <= _NARROW:
        return []
    return [
        f"warning: the body takes {100 * blocked:.0f} % of the tank's cross-section: the current"
        f" runs up to {100 * blocked / (1 - blocked):.0f} % faster beside it than in open water"
    ]
