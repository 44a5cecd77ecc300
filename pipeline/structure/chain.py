"""A finger as a planar chain of rigid slices: the unloaded shape, and elastic rotations of it.

Complex numbers are places and vectors in the actuator's frame: the real axis along the finger from
the root, the imaginary one towards the ventral side. Slice k is turned by `delta` k against its
angle without load, which follows from the pressure.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from pipeline.formats.bending_states import BendingLaw, FloatArray, States
from pipeline.kinematics.shapes import arc_length, node_angle, profile_splines
from pipeline.structure.elastic_law import law_at

ComplexArray = NDArray[np.complex128]
_PIECES = 4  # of the profile to a slice: 31 slices of the shipped finger


RUBBER, GAP, AIR, MIDDLE = range(4)  # a slice's content: centres, of the water in gaps; half way up


@dataclass(frozen=True)
class Unloaded:
    """The chain without load."""

    root: ComplexArray  # (time): place of the first joint
    link: ComplexArray  # (time, slice): to the next joint
    heading: ComplexArray  # (time, slice): unit vector along the slice
    content: ComplexArray  # (time, 4, slice): from the slice's own joint


@dataclass(frozen=True)
class Placed:
    """The chain under load: places of its joints and of its slices' content."""

    joint: ComplexArray  # (…, slice + 1)
    heading: ComplexArray  # (…, slice)
    content: ComplexArray  # (…, 4, slice)


class Chain:
    """Joints lie on the neutral axis at points of the profile."""

    def __init__(self, states: States, law: BendingLaw, width: float) -> None:
        self.pressure, self.law, self.width = states.pressure, law, width
        self._laws: dict[float, PchipInterpolator] = {}
        self._angle, self._length, self.thickness = profile_splines(states)
        tables = law.neutral_axis, law.air_height, law.air_section
        self._axis, self._air_height, self.air_section = (
            CubicSpline(states.pressure, table) for table in tables
        )
        rest = int(np.argmin(np.abs(states.pressure)))
        self.arc = arc_length(states.profile[rest])
        last = len(self.arc) - 1
        first = int(np.searchsorted(self.arc, law.clamped_length * (1 - 1e-6)))
        count = max(1, round((last - first) / _PIECES))
        self.joints = np.round(np.linspace(first, last, count + 1)).astype(int)
        self.lengths: FloatArray = np.diff(self.arc[self.joints])
        # means over each slice of values at the points, by the trapezoidal rule
        self._mean = np.zeros((last + 1, count))
        for k, (a, b) in enumerate(pairwise(self.joints)):
            step = np.diff(self.arc[a : b + 1]) / self.lengths[k]
            self._mean[a:b, k] += 0.5 * step
            self._mean[a + 1 : b + 1, k] += 0.5 * step
        # from the middle of one slice to that of the next; the first is clamped where it begins
        between = 0.5 * (self.lengths[1:] + self.lengths[:-1])
        self.springs: FloatArray = np.concatenate([[0.5 * self.lengths[0]], between])
        height = float(states.thickness[rest].mean())
        section = height * width
        at_rest = states.pressure[rest]
        air = float(self.air_section(at_rest))
        self.gap_section = max(section - law.rubber_section - air, 0.0)
        moment = 0.5 * height * section - law.rubber_height * law.rubber_section
        moment -= float(self._air_height(at_rest) * self.air_section(at_rest))
        self._gap_height = moment / self.gap_section if self.gap_section > 0 else 0.5 * height

    def law_at(self, pressure: float) -> PchipInterpolator:
        """Moment (N m) of a joint by its change of curvature (1/m) at `pressure` (Pa)."""
        if pressure not in self._laws:
            self._laws[pressure] = law_at(self.law, self.pressure, pressure)
        return self._laws[pressure]

    def moments(self, pressure: FloatArray, delta: FloatArray) -> FloatArray:
        """Elastic moments (time, slice) N m of the joints."""
        bent = np.diff(delta, axis=-1, prepend=0.0) / self.springs
        return np.array([self.law_at(p)(b) for p, b in zip(pressure, bent, strict=True)])

    def share(self, moments: FloatArray) -> float:
        """The largest of moments (N m) over that to which the bending was analysed."""
        table = self.law.moment
        return float(np.maximum(moments / table[0], moments / table[-1]).max())

    @property
    def slices(self) -> int:
        """Number of slices."""
        return len(self.lengths)

    def _profile(self, pressure: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Without load: points (time, point) of the profile from its root, and angles there."""
        angle, length = self._angle(pressure), self._length(pressure)
        steps = np.cumsum(length * np.exp(1j * angle), axis=-1)
        points = np.concatenate([np.zeros((*steps.shape[:-1], 1)), steps], axis=-1)
        return points, node_angle(angle)

    def unloaded(self, pressure: FloatArray) -> Unloaded:
        """The chain at pressures (time,) Pa."""
        points, angle = self._profile(pressure)
        dorsal = -1j * np.exp(1j * angle)
        joints = (points + self._axis(pressure)[:, None] * dorsal)[:, self.joints]

        heights = (
            self.law.rubber_height,
            self._gap_height,
            self._air_height(pressure)[:, None],
            0.5 * self.thickness(pressure),
        )
        places = np.stack([(points + height * dorsal) @ self._mean for height in heights], axis=1)
        heading = np.exp(1j * angle) @ self._mean
        return Unloaded(
            root=joints[:, 0],
            link=np.diff(joints, axis=1),
            heading=heading / np.abs(heading),
            content=places - joints[:, None, :-1],
        )

    def bend(self, pressure: FloatArray, delta: FloatArray) -> FloatArray:
        """Bend angle (time,) rad under load, positive towards the ventral side."""
        return np.asarray(self._profile(pressure)[1][:, -1] + delta[:, -1])

    def profile(self, pressure: FloatArray, delta: FloatArray) -> FloatArray:
        """Profile (time, point, 2) m under load.

        `delta` (time, slice) rad is linear between the middles of the slices.
        """
        points, angle = self._profile(pressure)
        height = self._axis(pressure)[:, None]
        axis = points - 1j * height * np.exp(1j * angle)
        start = self.arc[self.joints]
        knots = np.concatenate([start[:1], start[:-1] + 0.5 * self.lengths])
        none = np.zeros((len(delta), 1))
        turned = np.concatenate([none, delta], axis=1)
        turn = np.array([np.interp(self.arc, knots, row) for row in turned])
        middle = 0.5 * (turn[:, 1:] + turn[:, :-1])
        # the rotation is added to the steps, so that none gives back the points themselves
        moved = np.cumsum(np.diff(axis, axis=1) * (np.exp(1j * middle) - 1), axis=1)
        moved = np.concatenate([none, moved], axis=1)
        line = points + moved + 1j * height * np.exp(1j * angle) * (np.exp(1j * turn) - 1)
        return np.stack([line.real, line.imag], axis=-1)


def placed(unloaded: Unloaded, at: int | slice | NDArray[np.intp], delta: FloatArray) -> Placed:
    """The chain at one or several times `at`, its slices turned by `delta` (…, slice) rad."""
    turn = np.exp(1j * delta)
    steps = np.cumsum(unloaded.link[at] * turn, axis=-1)
    root = np.asarray(unloaded.root[at])[..., None]
    joint = np.concatenate([np.broadcast_to(root, (*steps.shape[:-1], 1)), root + steps], axis=-1)
    content = joint[..., None, :-1] + unloaded.content[at] * turn[..., None, :]
    return Placed(joint, unloaded.heading[at] * turn, content)


def joint_moments(chain: Placed, force: ComplexArray, torque: FloatArray) -> FloatArray:
    """Moment (…, slice) N m about each slice's joint of all that acts on it and beyond.

    `force` (…, 4, slice) N on its content; `torque` (…, slice) N m.
    """
    turning = torque + (np.conj(chain.content) * force).imag.sum(-2)
    start = chain.joint[..., :-1]
    return _beyond(turning) - (np.conj(start) * _beyond(force.sum(-2))).imag


def _beyond(values: NDArray) -> NDArray:
    """Sums over each slice and those beyond it."""
    return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]
