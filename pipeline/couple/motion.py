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
from pipeline.scene.scene import Scene
from pipeline.solve.interval import SolverInterval
from pipeline.structure.coupling import Coupling
from pipeline.structure.finger import ElasticFinger, Posed, copies
from piv.files.errors import StageError

_CONTACT = 0.01  # N: the first force that is tried


class CoupledMotion:
    """A coupled motion as far as it is known."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.step = scene.numerics.time_step
        self.last = steps_of(scene.motion.end_time, self.step)
        self.finger, self.copies = ElasticFinger.of(scene), copies(scene)
        pressure = self.finger.chambers(self.step * np.arange(self.last + 1))
        self.history = Coupling(self.finger.chain, self.step, self.finger.water, pressure)
        self.force = np.zeros(self.last + 1)  # of the contact, N
        self.quality: list[tuple] = []  # rows of MESH_QUALITY
        self.inertia_turn: float | None = None  # bend (rad) in which the water's inertia is known
        start = self.finger.shapes(
            np.arange(3.0), pressure[[0, 0, 0]], self.history.delta[[0, 0, 0]]
        )
        motion = scene.motion.model_copy(update={"end_time": 2.0})
        self._motion = finger_motion(motion, scene.finger, None, scene.folder, start)

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

    @property
    def contact(self) -> float | None:
        """Time (s) of the first contact; None without one."""
        touched = self.history.touched
        return None if touched is None else self.step * touched

    def advance(self, number: int) -> None:
        """The rotations of the step after `number`, and the contact that they need.

        A contact is a force without friction that is as large as it takes to keep the residual gap.
        """
        later, pinch, history = number + 1, self.scene.pinch, self.history
        push = np.zeros_like(history.contact[later])

        def short(force: float) -> float:
            """By how much (m) the gap is too small."""
            assert pinch is not None
            history.contact[later] = force * push
            history.delta[later] = history.next_delta(number)
            self.force[later] = force
            return pinch.residual_gap - float(gap(self.outline(*self.state(later)), pinch))

        if pinch is None:
            history.delta[later] = history.next_delta(number)
        elif short(0.0) > 0:
            place, away = nearest(self.outline(*self.state(later)), pinch)
            posed = Posed(self.finger, *self.state(later))
            push = posed.of_forces(place[None], away[None])[1:]
            most = max(self.force[number], _CONTACT)
            while short(most) > 0:
                most *= 4
            short(brentq(short, 0.0, most, xtol=_CONTACT * 1e-3, rtol=1e-9))

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
                "first_order": int(h.first_order),
            },
        )
