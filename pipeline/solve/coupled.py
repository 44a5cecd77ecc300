"""A run whose finger is moved by pressure and water, step by step.

The solver stops at the end of each step (openfoam/gate.py). From the loads that it has sampled, the
structure gives the next rotations, the planform follows them, and the solver goes on with the next
displacement. A run that was killed repeats the motion from the samples, and resumes.
"""

from __future__ import annotations

import shutil
import time as clock
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from pipeline.case import build_mesh, sides, write_interval
from pipeline.formats.bending_states import FloatArray
from pipeline.formats.elastic_motion import FILE, write_elastic_motion
from pipeline.formats.kinematics import write_kinematics
from pipeline.formats.mesh_intervals import (
    Interval,
    IntervalMesh,
    NodeMotion,
    write_planform,
)
from pipeline.formats.records import MESH_QUALITY
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import shape_quality
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.kinematics.contact import gap, nearest
from pipeline.kinematics.finger import finger_motion
from pipeline.kinematics.values import kinematics_values, units_of
from pipeline.mesh.morph import Morph, MorphError, check_quality, corner_triangles
from pipeline.mesh.wall_layers import outline_at
from pipeline.openfoam.displacement_files import Frames, steps_of, time_name
from pipeline.openfoam.gate import clear_gates, close_gate, open_gate
from pipeline.openfoam.ranks import Ranks
from pipeline.openfoam.surface_vtk import is_whole_vtk
from pipeline.scene.scene import Scene
from pipeline.structure.coupling import Coupling
from pipeline.structure.finger import ElasticFinger, Posed, copies
from pipeline.structure.water_inertia import forces_of_water
from piv.files.errors import StageError

_FRAME = 0.01  # of a time step, by which the displacement of an instant stands after it
_STALE_TURN = np.radians(45.0)  # of the tip, after which the water's inertia is computed anew
_HESSIAN = 10  # steps that the mesh's Hessian serves, and between two checks of its quality
# deg above the limit of non-orthogonality, which the guessed shapes keep. The cycle needed 0.1,
# the pinch at 30 kPa and medium 5.7, at the peak of its impact.
_BEYOND = 8.0
_PAUSE = 1e-3  # s
_CONTACT = 0.01  # N: the first force that is tried
_MODES = 8
_NUDGE, _NUDGE_PA = 1e-4, 10.0  # rad and Pa


class Coupled:
    """A coupled motion as far as it is known."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.step = scene.numerics.time_step
        self.last = steps_of(scene.motion.end_time, self.step)
        self.finger, self.copies = ElasticFinger.of(scene), copies(scene)
        pressure = self.finger.chambers(self.step * np.arange(self.last + 1))
        self.history = Coupling(self.finger.chain, self.step, self.finger.water, pressure)
        self.force = np.zeros(self.last + 1)  # of the contact, N
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

    def write(self, meshes: list[IntervalMesh], quality: list[tuple]) -> None:
        """Check the motion and write it and its meshes in place of the first guess. StageError."""
        scene, h = self.scene, self.history
        result = h.check()
        if fault := result.fault(scene.finger.length):
            raise StageError(
                f"{scene.folder / 'scene.toml'}: the coupled motion fails its check: {fault};"
                " lower numerics.time_step"
            )
        out, time = scene.out / "run", self.step * np.arange(self.last + 1)
        values = kinematics_values(scene, self.finger.shapes(time, h.pressure, h.delta), exact=True)
        write_kinematics(out / "kinematics.h5", values, units=units_of(scene, values))
        planforms = [mesh.planform for mesh in meshes]
        write_planform(
            out / "planform.h5",
            [mesh.interval for mesh in meshes],
            {name: planforms[0].attrs[name] for name in ("model", "mirror")},
            [
                {n: p[n].values for n in p.variables} | {"corners": p.attrs["corners"]}
                for p in planforms
            ],
        )
        MESH_QUALITY.write(out / "mesh_quality.csv", quality)
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


class Follower:
    """The solver of one mesh interval, whose mesh follows the coupled motion."""

    def __init__(self, run: Coupled, case: Path, guess: IntervalMesh, ranks: Ranks) -> None:
        """`guess`: the interval's mesh, with the first guess of its motion."""
        self._run, self._case, self._guess, self._ranks = run, case, guess, ranks
        interval, file = guess.interval, guess.planform
        self._first, self._start, self._end = (
            steps_of(at, run.step) for at in (interval.begin, interval.start, interval.end)
        )
        self._known = self._start  # step to whose end the loads are known
        self.quality: list[tuple] = []  # rows of MESH_QUALITY
        names = ("triangles", "quads", "body", "wall", "material", "outer")
        fixed = file["fixed"].values.astype(bool)
        parts: dict[str, Any] = {name: file[name].values for name in names}
        self._planform = Planform(nodes=file["built"].values, fixed=fixed, **parts)
        triangles = corner_triangles(self._planform.triangles, self._planform.quads)
        self._morph = Morph(self._planform.nodes, triangles, fixed)
        self._near = -1  # number of the step whose nodes give the mesh's Hessian
        shapes, bends = file["points"].values, file["bend"].values
        near = int(np.argmin(np.abs(bends - run.bend(self._first)))) if self._first else 0
        self.nodes = {self._first: self._at(self._first, shapes[near], self._morph.approach)}
        if self._first:
            run.inertia_turn = None  # known is that of the mesh before
        else:
            self._advance(0)
        # in the overlap with the interval before the motion is known
        for number in range(self._first + 1, min(self._start + 1, self._end) + 1):
            self._follow(number)

    def _at(
        self, number: int, nodes: FloatArray, move: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> FloatArray:
        """Nodes whose wall is the outline at the end of a step, from others. StageError."""
        run, target = self._run, nodes.copy()
        outline = run.outline(*run.state(number))
        target[self._planform.wall] = outline_at(outline, self._planform.material)
        try:
            nodes = move(nodes, target)
            if number % _HESSIAN == 0 or number in (self._first, self._end):
                quality, bend = shape_quality(self._planform, nodes), run.bend(number)
                check_quality(quality, bend, run.scene.mesh, _BEYOND)
                k, time = self._guess.interval.index, number * run.step
                about = k, k, _HESSIAN / run.last, np.degrees(bend), time
                self.quality.append((*about, *astuple(quality)))
        except MorphError as error:
            raise StageError(
                f"{run.scene.folder / 'scene.toml'}: at {number * run.step:.4g} s the mesh cannot"
                f" follow the finger: {error}; raise that limit, or change mesh.wall_cell"
            ) from None
        return nodes

    def _follow(self, number: int) -> None:
        near = number - 1 - (number - 1 - self._first) % _HESSIAN
        if near != self._near:
            self._near, self._pursue = near, self._morph.pursuit(self.nodes[near])
        self.nodes[number] = self._at(number, self.nodes[number - 1], self._pursue)

    def _advance(self, number: int) -> None:
        """From the loads at the end of a step to the rotations of the next."""
        run, history = self._run, self._run.history
        turn = run.bend(number)
        if run.inertia_turn is None or abs(turn - run.inertia_turn) > _STALE_TURN:
            history.inertia[number + 1 :], run.inertia_turn = self._inertia(number), turn
        history.first_order = history.first_order or history.alternates(number)
        if number < run.last:
            run.advance(number)
        if self._start < number < self._end:
            self._follow(number + 1)

    def _inertia(self, number: int) -> FloatArray:
        """The water's inertia (slice, 3, slice + 1), as Coupling's, at the end of a step.

        Angular accelerations are taken as polynomials along the finger: finer ones meet a chain
        that is stiff against them.
        """
        run, planform, chain = self._run, self._planform, self._run.finger.chain
        pressure, delta = run.state(number)
        arc = np.linspace(-1, 1, len(delta))
        modes = np.linalg.qr(np.polynomial.legendre.legvander(arc, min(_MODES, len(arc)) - 1))[0]
        now = run.outline(pressure, delta)
        nudged = [run.outline(pressure, delta + _NUDGE * mode) for mode in modes.T]
        moved = [(outline - now) / _NUDGE for outline in nudged]
        moved.append((run.outline(pressure + _NUDGE_PA, delta) - now) / _NUDGE_PA)
        walls = np.zeros((len(moved), *self.nodes[number].shape))
        walls[:, planform.wall] = outline_at(np.array(moved), planform.material)
        file, density = self._guess.planform, run.scene.fluid.density
        gaps = sides(file) == OUTER_PATCHES.index("gap")
        place, force = forces_of_water(
            file, self._guess.sweep, self.nodes[number], walls, gaps, density, run.copies
        )
        posed = Posed(run.finger, pressure, delta)
        *turned, pushed = -np.array([posed.of_forces(place, one)[1:] for one in force])
        by_turns = np.einsum("msl,jm->slj", turned, modes)
        heading = chain.unloaded(np.array([pressure, pressure + _NUDGE_PA])).heading
        turn = np.angle(heading[1] / heading[0]) / _NUDGE_PA
        return np.concatenate([by_turns, (pushed - by_turns @ turn)[..., None]], axis=-1)

    def mesh(self) -> IntervalMesh:
        """The interval's mesh with its motion as far as it is known."""
        run, guess, numbers = self._run, self._guess, sorted(self.nodes)
        time, points = run.step * np.array(numbers), np.array([self.nodes[n] for n in numbers])
        planform = guess.planform.drop_dims("shape_parameter").drop_vars(["built", "fixed"])
        return replace(
            guess,
            interval=replace(guess.interval, mesh=guess.interval.index, moving=True),
            planform=planform.assign(
                shape_parameter=("shape_parameter", time),
                points=(("shape_parameter", "node", "axis"), points),
                bend=("shape_parameter", np.array([run.bend(n) for n in numbers])),
            ),
            motion=NodeMotion(CubicSpline(time, time), CubicSpline(time, points)),
        )

    def write_case(self, intervals: list[Interval]) -> None:
        """Write the case of one of the `intervals`, in the shape that the finger has then."""
        mesh = self._guess
        shutil.rmtree(self._case, ignore_errors=True)
        swept = build_mesh(mesh.planform)
        nodes = self.nodes[self._first]
        write_interval(self._run.scene, intervals, mesh.interval, mesh.planform, swept, nodes)

    def lay_frames(self) -> None:
        """An empty frame for each instant: the solver finds them when it starts."""
        frames = Frames(self._case, self._guess.planform, self._guess.sweep, self._ranks)
        for number in range(self._first, self._end + 1):
            frames.write((number + _FRAME) * self._run.step, None)

    def _frame(self, number: int) -> None:
        """The frame after an instant: of one at the instant OpenFOAM would read the next, too.

        It continues the motion to its own time, so that between two the nodes are where they
        should be but for _FRAME² of the change of their step.
        """
        now = self.nodes[number]
        ahead = _FRAME * (now - self.nodes.get(number - 1, now))
        time = (number + _FRAME) * self._run.step
        self._frames.write(time, now + ahead - self.nodes[self._first])

    def begin(self, time: float) -> None:
        """The solver starts at `time` (s)."""
        at = steps_of(time, self._run.step)
        self.catch_up(at)
        for path in self._samples.glob("*"):  # of a killed run
            if float(path.name) > time * (1 + 1e-9):
                shutil.rmtree(path)
        self._frames = Frames(self._case, self._guess.planform, self._guess.sweep, self._ranks)
        for number in range(max(at - 1, self._first), min(self._known + 1, self._end) + 1):
            self._frame(number)
        clear_gates(self._case)
        if at + 1 < self._end:
            close_gate(self._case, (at + 1) * self._run.step)

    def end(self) -> None:
        """The solver has ended, or was stopped."""
        clear_gates(self._case)

    @property
    def _samples(self) -> Path:
        return self._case / "postProcessing" / "fingerSurface"

    def _surface(self, number: int) -> Path:
        return self._samples / time_name(number * self._run.step) / "finger.vtk"

    def catch_up(self, number: int) -> None:
        """Repeat the motion from the samples of a solver that has been at the end of a step."""
        while self._known < number:
            self._take(self._known + 1)

    def _take(self, number: int) -> None:
        """From the sample at the end of a step to the motion of the next."""
        run = self._run
        posed = Posed(run.finger, *run.state(number))
        loads, _ = posed.loads(self._surface(number), run.scene.fluid.density, run.copies)
        run.history.take(number, loads[1:])
        self._known = number
        self._advance(number)

    def answer(self, time: float, alive: Callable[[], bool]) -> None:
        """The solver has computed the step that ends at `time` (s): it gets the next one."""
        number = steps_of(time, self._run.step)
        while not is_whole_vtk(self._surface(number)):
            if not alive():
                return
            clock.sleep(_PAUSE)
        if number > self._start:
            self._take(number)
            if number < self._end:
                self._frame(number + 1)
        if number + 1 < self._end:
            close_gate(self._case, (number + 1) * self._run.step)
        if number < self._end:
            open_gate(self._case, number * self._run.step, alive)
