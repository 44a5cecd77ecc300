"""A scene's finger as a structure: its chain, the pressure in its chambers, where it hangs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pipeline.formats.bending_states import FloatArray, States
from pipeline.formats.mesh_intervals import PER_FINGER
from pipeline.kinematics.camera_window import TipPath, tip_path
from pipeline.kinematics.finger import axes, finger_states, law_times, pressure_law, within
from pipeline.kinematics.pressure_law import PressureLaw
from pipeline.openfoam.surface_vtk import wall_forces
from pipeline.scene.current import Stream
from pipeline.scene.read_toml import command
from pipeline.scene.scene import Scene
from pipeline.structure.chain import MIDDLE, Chain, ComplexArray, placed
from pipeline.structure.elastic_law import bending_law, constant_law
from pipeline.structure.motion import Surroundings, motion
from pipeline.structure.vibration import slowness
from piv.files.errors import StageError

_GRAVITY = 9.81  # m/s²
_STEPS, _MOST_STEPS = 150, 4000  # of the first vibration and in all, where no flow is computed
_STEPS_SEEN = 50  # of the first vibration for a camera's view, in which a tip is seen to 2 %
_ADDED_MASS, _DRAG = 0.87, 2.2  # where no run gives them (docs/coupling.md)


@dataclass(frozen=True)
class ElasticFinger:
    """A chain in its tank. `known`: whether its bending stiffness is known."""

    chain: Chain
    chambers: PressureLaw  # Pa over time, s
    frame: FloatArray  # rows: axes of the actuator in the tank
    root: FloatArray  # m
    water: Surroundings  # without modelled water
    model: Surroundings  # with it
    air: Surroundings
    known: bool
    period: float = 0.0  # s, of its first vibration in modelled water
    stream: Stream | None = None
    mounted: bool = False  # whether water behind the root presses on a mount

    @classmethod
    def of(cls, scene: Scene, states: States | None = None) -> ElasticFinger:
        """That of a scene; `states`: in place of its file."""
        chambers = pressure_law(scene.motion, scene.folder)
        pressure = chambers(law_times(scene.motion.end_time))
        if states is None:
            lowest, highest = float(pressure.min()), float(pressure.max())
            states = finger_states(scene.motion, scene.finger, scene.folder, lowest, highest)
            chambers = within(chambers, states)
        solid, width = scene.structure, scene.finger.width
        known = bending_law(states, solid.bending_stiffness, solid.density, width)
        law = known or constant_law(1.0, 0.0, len(states.pressure))
        frame = axes(scene.finger)
        gravity = _GRAVITY if solid.gravity is None else solid.gravity
        down = complex(*(frame @ [0.0, -gravity]))
        chain = Chain(states, law, width)
        swings_at = float(pressure[np.argmax(np.abs(pressure))])
        loss_factor = scene.structure.loss_factor
        wet, air = Surroundings(down, scene.fluid.density, _ADDED_MASS, _DRAG), Surroundings(down)
        in_water, in_air = (slowness(chain, swings_at, each) for each in (wet, air))
        model = replace(wet, damping=loss_factor * in_water)
        return cls(
            chain,
            chambers,
            frame,
            np.asarray(scene.finger.root),
            replace(model, added_mass=0.0, drag=0.0),
            model,
            replace(air, damping=loss_factor * in_air),
            known is not None,
            2 * np.pi * in_water,
            Stream.of(scene),
            scene.finger.mount is not None,
        )

    def streams(self, time: np.ndarray) -> ComplexArray:
        """Velocity (time,) m/s of a current at the root, in the actuator's frame; 0 without one."""
        speed = np.zeros(len(time)) if self.stream is None else self.stream.law(time)
        if self.stream is not None:
            speed = speed * self.stream.share(self.root[1])
        return self.in_actuator(np.outer(speed, [1.0, 0.0]))

    def in_water(
        self, end: float, steps: int = _STEPS
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time (s), pressure (Pa) and rotations (time, slice) in modelled water.

        However large the moments are. `steps`: of the first vibration. StageError where the chain
        finds no equilibrium.
        """
        step = max(self.period / steps, end / _MOST_STEPS)
        time = np.linspace(0.0, end, max(round(end / step), 10) + 1)
        pressure, none = self.chambers(time), np.zeros((len(time), self.chain.slices, 3))
        step, stream = float(time[1]), self.streams(time)
        turned = motion(self.chain, pressure, step, self.model, none, most=np.inf, streams=stream)
        return time, pressure, turned

    def shapes(self, time: np.ndarray, pressure: FloatArray, delta: FloatArray) -> States:
        """Shapes over `time` (s) in place of the pressure, under rotations (time, slice) rad."""
        chain = self.chain
        return States(time, chain.profile(pressure, delta), chain.thickness(pressure))

    def in_actuator(self, vectors: FloatArray) -> ComplexArray:
        """Vectors (…, 2) of the tank in the actuator's frame."""
        turned = vectors @ self.frame.T
        return np.asarray(turned[..., 0] + 1j * turned[..., 1], dtype=complex)

    def places(self, points: FloatArray) -> ComplexArray:
        """Points (…, 2) of the tank in the actuator's frame, from the root's ventral edge."""
        edge = -0.5j * self.chain.thickness(np.zeros(1))[0, 0]
        return self.in_actuator(points - self.root) + edge


def stiffness_remedy(scene: Scene) -> str:
    """How a bending stiffness comes to be known: imported states never have one."""
    given = "give structure.bending_stiffness (N m2)"
    analysed = scene.fea.get("engine") != "import" and scene.actuator
    return f"analyse it with {command('fea', scene.folder)}, or {given}" if analysed else given


def copies(scene: Scene) -> float:
    """Times that the loads of the computed part are those of the water on a whole finger."""
    return PER_FINGER[scene.model.kind] * scene.load_share


def modelled_share(scene: Scene, states: States) -> float:
    """Largest moment in modelled water over the table of `states`. StageError."""
    finger = ElasticFinger.of(scene, states)
    _, pressure, delta = finger.in_water(scene.motion.end_time)
    return finger.chain.share(finger.chain.moments(pressure, delta))


def modelled_speed(finger: ElasticFinger, end: float) -> float:
    """Largest speed (m/s) of the tip in modelled water until `end` (s); StageError."""
    time, pressure, delta = finger.in_water(end)
    tip = finger.chain.profile(pressure, delta)[:, -1]
    return float(np.hypot(*np.gradient(tip, time[1], axis=0).T).max())


def path_in_water(scene: Scene) -> TipPath:
    """The path of a scene's tip: of a coupled finger in modelled water, with the poses at rest.

    Prescribed, a finger may be several times as fast. StageError where it has no path.
    """
    still = tip_path(scene)
    if not scene.coupled:
        return still
    finger = ElasticFinger.of(scene)
    wet = tip_path(scene, finger.shapes(*finger.in_water(scene.motion.end_time, _STEPS_SEEN)))
    places = np.vstack([still.places, wet.places])
    carried = np.zeros((2, len(still.places)))  # the poses at rest leave no vortex
    travel = np.concatenate([carried[0], wet.travel])
    drift = np.concatenate([carried[1], wet.drift])
    return TipPath(places, wet.speed, wet.turns, travel, drift)


def modelled_shapes(scene: Scene) -> States:
    """Shapes over time (s) under modelled water; StageError where the finger cannot be coupled."""
    if scene.body is not None or not scene.motion.states:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: COUPLED=1 takes fingers with motion.source = 'fea': a"
            " rigid body does not bend, and other motions have no pressure"
        )
    if scene.both_fingers:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: COUPLED=1 computes one finger of a pinch, mirrored:"
            f" give model.kind = 'quarter' or '2d', not {scene.model.kind!r}"
        )
    finger = ElasticFinger.of(scene)
    if not finger.known:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: motion.states has no bending stiffness, which a"
            f" coupled motion needs: {stiffness_remedy(scene)}"
        )
    step, end = scene.numerics.time_step, scene.motion.end_time
    time = step * np.arange(round(end / step) + 1)
    pressure = finger.chambers(time)
    nothing = np.zeros((len(time), finger.chain.slices, 3))
    stream = finger.streams(time)
    delta = motion(finger.chain, pressure, step, finger.model, nothing, streams=stream)
    return finger.shapes(time, pressure, delta)


class Posed:
    """A finger in one shape, to which the water's forces are referred."""

    def __init__(self, finger: ElasticFinger, pressure: float, delta: FloatArray) -> None:
        """`pressure` in Pa; `delta` (slice,) rad."""
        chain, at = finger.chain, np.array([pressure])
        self._finger = finger
        self.placed = placed(chain.unloaded(at), 0, delta)
        points = chain.profile(at, delta[None])[0] @ [1, 1j]
        along = np.gradient(points)
        line = points - 0.5j * chain.thickness(at)[0] * along / np.abs(along)  # half way up
        pieces = 0.5 * (line[1:] + line[:-1])
        self._tree = cKDTree(np.column_stack([pieces.real, pieces.imag]))
        self._middle = np.append(line[: chain.joints[0] + 1].mean(), self.placed.content[MIDDLE])

    def loads(
        self, surface: Path, density: float, copies: float, left_alone: bool = False
    ) -> tuple[FloatArray, float]:
        """Loads (slice + 1, 3) of a sampled surface, as `of_forces`, and N m about the root.

        `copies`: of the computed part in the whole finger; `left_alone`: of two the left one.
        """
        centre, force, _ = wall_forces(surface, density)
        kept = centre[:, 0] < 0 if left_alone else slice(None)
        centre, push = centre[kept, :2], copies * force[kept, :2]
        root = self._finger.in_actuator(centre - self._finger.root)
        moment = float(np.sum((np.conj(root) * self._finger.in_actuator(push)).imag))
        return self.of_forces(centre, push), moment

    def of_forces(self, place: FloatArray, force: FloatArray) -> FloatArray:
        """Loads (slice + 1, 3) of forces (piece, 2) N at places (piece, 2) m of the tank.

        N along and across each slice, and N m about its middle; the clamped length comes first.
        Each force goes to the slice whose middle line is nearest.
        """
        chain, at = self._finger.chain, self._finger.places(place)
        push = self._finger.in_actuator(force)
        nearest = self._tree.query(np.column_stack([at.real, at.imag]))[1]
        owner = np.searchsorted(chain.joints, nearest, side="right")
        if self._finger.mounted:
            owner[(nearest == 0) & (at.real < 0)] = 0
        turning = (np.conj(at - self._middle[owner]) * push).imag
        x, y, torque = (
            np.bincount(owner, part, chain.slices + 1) for part in (push.real, push.imag, turning)
        )
        along = (x + 1j * y) * np.conj(np.concatenate([[1.0], self.placed.heading]))
        return np.column_stack([along.real, along.imag, torque])
