"""A motion that pressure and water make together, step by step, as far as it is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from pipeline.formats.bending_states import FloatArray
from pipeline.formats.elastic_motion import FILE, write_elastic_motion
from pipeline.formats.mesh_intervals import write_planform
from pipeline.formats.records import MESH_QUALITY
from pipeline.kinematics.contact import gap, nearest
from pipeline.kinematics.finger import finger_motion
from pipeline.kinematics.values import kinematics_values, write_motion
from pipeline.openfoam.displacement_files import steps_of
from pipeline.scene.current import RAMP_STEPS, Stream, lead_steps
from pipeline.scene.scene import Scene
from pipeline.solve.interval import SolverInterval
from pipeline.structure.coupling import Coupling
from pipeline.structure.finger import ElasticFinger, Posed, copies, modelled_speed
from piv.files.errors import StageError

_CONTACT = 0.01  # N: the first force that is tried
_CLOSED = 1e-9  # of the film: what is left of it where its force has no bound


def _film_impulse(finger: ElasticFinger, end: float) -> float:
    """Impulse (N s) by the film's strain: a third of the tip's momentum in modelled water.

    As of an effective mass of half the finger and its water at the largest speed until `end` (s),
    which a film then stops within e^-4 of its thickness.
    """
    chain = finger.chain
    water = finger.water.fluid * finger.model.added_mass * np.pi / 4 * chain.width**2
    mass = 0.5 * (chain.law.rubber_mass + water) * chain.arc[-1]
    return mass * modelled_speed(finger, end) / 3


class CoupledMotion:
    """A coupled motion as far as it is known."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.step = scene.numerics.time_step
        self.last = steps_of(scene.motion.end_time, self.step)
        self.finger, self.copies = ElasticFinger.of(scene), copies(scene)
        pressure = self.finger.chambers(self.step * np.arange(self.last + 1))
        running = lead_steps(scene) > 0
        chain, water = self.finger.chain, self.finger.water
        passage = self._passage() if np.ptp(pressure) == 0 else None
        self.history = Coupling(chain, self.step, water, pressure, running, passage)
        self.force = np.zeros(self.last + 1)  # of the contact, N
        self._film = 0.0  # N s: the film's impulse by its strain (`_strain`)
        if scene.pinch is not None:
            self._film = _film_impulse(self.finger, scene.motion.end_time)
        self.quality: list[tuple] = []  # rows of MESH_QUALITY
        self.inertia_turn: float | None = None  # bend (rad) in which the water's inertia is known
        times = np.linspace(0.0, scene.motion.end_time, 3)
        start = self.finger.shapes(times, pressure[[0, 0, 0]], self.history.delta[[0, 0, 0]])
        self._motion = finger_motion(scene.motion, scene.finger, None, scene.folder, start)

    def _passage(self) -> int | None:
        """Time steps in which a current's peak goes a length of the finger; None without one.

        Over fewer than those that a ramp must have the work would be as small as its error.
        """
        scene, stream = self.scene, Stream.of(self.scene)
        speed = stream.peak(scene.motion.end_time, self.step) if stream else 0.0
        return max(RAMP_STEPS, round(scene.finger.length / speed / self.step)) if speed else None

    def outline(self, pressure: float, delta: FloatArray) -> FloatArray:
        """Closed outline (point, 2) m in the tank at a pressure (Pa) and rotations (slice,)."""
        chain, at = self.finger.chain, np.array([pressure])
        profile, thickness = chain.profile(at, delta[None])[0], chain.thickness(at)[0]
        return np.asarray(self._motion.outline_of(profile, thickness))

    def state(self, number: int) -> tuple[float, FloatArray]:
        """Pressure (Pa) and rotations (slice,) at the end of a step."""
        return float(self.history.pressure[number]), self.history.delta[number]

    def bend(self, number: int) -> float:
        """Bend angle (rad) at the end of a step."""
        pressure, delta = self.history.pressure, self.history.delta
        at = slice(number, number + 1)
        return float(self.finger.chain.bend(pressure[at], delta[at])[0])

    def _strain(self, number: int) -> float:
        """The film's logarithmic strain at the end of a step: 0 where it is as thick or thicker."""
        pinch = self.scene.pinch
        assert pinch is not None
        left = float(gap(self.outline(*self.state(number)), pinch)) - pinch.residual_gap
        share = min(max(left / pinch.slowing_distance, _CLOSED), 1.0)
        return share - 1 - float(np.log(share))

    def advance(self, number: int) -> None:
        """The rotations of the step after `number`, and the force of the contact then.

        A viscous film of the thickness `pinch.slowing_distance` on what the tip touches, outside of
        the residual gap, resists being squeezed. Its damping grows from nothing at its surface
        without bound towards the residual gap. It never pulls, and it only dissipates.
        """
        later, history = number + 1, self.history
        push = np.zeros_like(history.contact[later])
        before = self._strain(number) if self._film else 0.0

        def missing(force: float) -> float:
            """By how much (N) a force is smaller than that of the film."""
            history.contact[later] = force * push
            history.delta[later] = history.next_delta(number)
            self.force[later] = force
            return self._film * (self._strain(later) - before) / self.step - force

        if not self._film:
            history.delta[later] = history.next_delta(number)
        elif missing(0.0) > 0:
            assert self.scene.pinch is not None
            place, away = nearest(self.outline(*self.state(later)), self.scene.pinch)
            posed = Posed(self.finger, *self.state(later))
            push = posed.of_forces(place[None], away[None])[1:]
            most = max(self.force[number], _CONTACT)
            while missing(most) > 0:
                most *= 4
            missing(brentq(missing, 0.0, most, xtol=_CONTACT * 1e-3, rtol=1e-9))

    def write(self, parts: Sequence[SolverInterval]) -> None:
        """Check the motion and write it and its meshes to scene.motion_folder. StageError."""
        scene, h = self.scene, self.history
        result = h.check()
        if fault := result.fault(scene.finger.length):
            raise StageError(
                f"{scene.folder / 'scene.toml'}: the coupled motion fails its check: {fault};"
                " lower numerics.time_step"
            )
        time = self.step * np.arange(self.last + 1)
        shapes = self.finger.shapes(time, h.pressure, h.delta)
        write_motion(scene, scene.motion_folder, kinematics_values(scene, shapes, exact=True))
        planforms = [part.mesh.planform for part in parts]
        write_planform(
            scene.motion_folder / "planform.h5",
            [part.span for part in parts],
            {name: planforms[0].attrs[name] for name in ("model", "mirror")},
            [
                {n: p[n].values for n in p.variables} | {"corners": p.attrs["corners"]}
                for p in planforms
            ],
        )
        MESH_QUALITY.write(scene.motion_folder / "mesh_quality.csv", self.quality)
        write_elastic_motion(
            scene.out / FILE,
            {
                "time": time,
                "pressure": h.pressure,
                "delta": h.delta,
                "contact_force": self.force,
                "tip_change": result.tip,
                "open_energy": result.open_energy,
                "moment_share": result.moment,
                "alternated": len(h.alternating) * self.step,
            },
        )
