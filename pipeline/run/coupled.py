"""A run whose finger is moved by pressure and water, step by step.

The solver stops at the end of each step (openfoam/gate.py). From the loads that it has sampled, the
structure gives the next rotations, the planform follows them, and the solver goes on with the next
displacement. Each step leaves a record, so that a run resumes as it would have gone on.
"""

from __future__ import annotations

import io
import shutil
import time as clock
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from fileio.atomic import write_bytes
from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray, States
from fileio.formats.elastic_motion import FILE, write_elastic_motion
from fileio.formats.kinematics import write_kinematics
from fileio.formats.mesh_intervals import PER_FINGER, IntervalMesh, NodeMotion, write_planform
from pipeline.case import build_mesh, write_interval
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import shape_quality
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
from pipeline.structure.coupling import Check, Coupling
from pipeline.structure.finger import ElasticFinger, Posed
from pipeline.structure.water_inertia import forces_of_water

_RECORDS = "coupling"  # folder in case/: a file for each step
_BEFORE = "first_run.npz"  # beside them: of a first run that failed its check
_FRAME = 0.25  # of a time step: the displacement of an instant stands before and after it
_STALE_TURN = np.radians(25.0)  # of the tip, after which the water's inertia is computed anew
_HESSIAN = 5  # steps that the mesh's Hessian serves, and between two checks of its quality
# deg above the limit of non-orthogonality, which the guessed shapes keep; the cycle needed 0.1
_BEYOND = 5.0
_PAUSE = 1e-3  # s
_CONTACT = 0.01  # N: the first force that is tried
_MODES = 8
_NUDGE = 1e-4  # rad


def _save(path: Path, **arrays: Any) -> None:
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_bytes(path, content.getvalue(), sync=False)


def _load(path: Path) -> dict[str, FloatArray]:
    try:
        with np.load(path) as file:
            return dict(file)
    except (ValueError, EOFError, OSError, KeyError) as error:
        raise StageError(
            f"{path}: damaged ({error}); delete the folder run and run make again"
        ) from None


class Coupled:
    """A coupled motion as far as it is known, and its records in the run's folder."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.step = scene.numerics.time_step
        self.last = steps_of(scene.motion.end_time, self.step)
        self.finger = ElasticFinger.of(scene)
        self.finger.need_stiffness(scene)
        pressure = self.finger.chambers(self.step * np.arange(self.last + 1))
        self.history = Coupling(self.finger.chain, self.step, self.finger.water, pressure)
        self.force = np.zeros(self.last + 1)  # of the contact, N
        self.inertia_turn: float | None = None  # bend (rad) in which the water's inertia is known
        self.folder = scene.out / "case" / _RECORDS
        start = self.finger.shapes(
            np.arange(3.0), pressure[[0, 0, 0]], self.history.delta[[0, 0, 0]]
        )
        motion = scene.motion.model_copy(update={"end_time": 2.0})
        self._motion = finger_motion(motion, scene.finger, None, scene.folder, start)
        self._rest = self._shape(float(pressure[0]), self.history.delta[0])
        before = self.folder / _BEFORE
        self.before: tuple[FloatArray, FloatArray] | None = None
        if before.exists():
            kept = _load(before)
            self.before = kept["delta"], kept["loads"]

    def _shape(self, pressure: float, delta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Profile and thickness at a pressure (Pa) and rotations (slice,)."""
        chain, at = self.finger.chain, np.array([pressure])
        return chain.profile(at, delta[None])[0], chain.thickness(at)[0]

    def outline(self, pressure: float, delta: FloatArray) -> FloatArray:
        """Closed outline (point, 2) m in the tank at a pressure (Pa) and rotations (slice,)."""
        rest, now = self._rest, self._shape(pressure, delta)
        profile, thickness = (np.stack([a, b, b]) for a, b in zip(rest, now, strict=True))
        states = States(np.arange(3.0), profile, thickness)
        return np.asarray(self._motion.with_states(states).outline(1.0))

    def outline_after(self, number: int) -> FloatArray:
        """The outline at the end of a step."""
        return self.outline(float(self.history.pressure[number]), self.history.delta[number])

    def bend(self, number: int) -> float:
        """Bend angle (rad) at the end of a step."""
        pressure, delta = self.history.pressure, self.history.delta
        at = slice(number, number + 1)
        return float(self.finger.chain.bend(pressure[at], delta[at])[0])

    def _records(self) -> list[Path]:
        return [path for path in self.folder.glob("*.npz") if path.stem.isdigit()]

    def restore(self, until: int) -> dict[int, FloatArray]:
        """Take the records of steps 0 to `until`, as many as are there; drop later ones.

        Returns the nodes of each step that they hold.
        """
        nodes, self.inertia_turn = {}, None
        for path in self._records():
            if int(path.stem) > until:
                path.unlink()
        for number in range(until + 1):
            path = self.folder / f"{number}.npz"
            if not path.exists():
                break
            record = _load(path)
            self.history.loads[number] = record["loads"]
            if number < self.last:
                self.history.delta[number + 1] = record["delta"]
                self.history.contact[number + 1] = record["contact"]
                self.force[number + 1] = record["force"]
            if record["nodes"].size:
                nodes[number + 1] = record["nodes"]
            self.history.inertia = record["inertia"]
            self.inertia_turn = float(record["inertia_turn"])
            self.history.first_order = bool(record["first_order"])
        return nodes

    def advance(self, number: int) -> None:
        """The rotations of the step after `number`, and the contact that they need.

        A contact is a force without friction that is as large as it takes to keep the residual gap.
        """
        later, pinch, history = number + 1, self.scene.pinch, self.history
        push = None

        def short(force: float) -> float:
            """By how much (m) the gap is too small."""
            nonlocal push
            history.contact[later] = 0.0 if push is None else force * push
            history.delta[later] = history.next_delta(number, self.before)
            self.force[later] = force
            return pinch.residual_gap - float(gap(self.outline_after(later), pinch)) if pinch else 0

        if short(0.0) > 0:
            assert pinch is not None
            place, away = nearest(self.outline_after(later), pinch)
            pressure = float(history.pressure[later])
            posed = Posed(self.finger, pressure, history.delta[later])
            push = posed.of_forces(place[None], away[None])[1:]
            most = max(self.force[number], _CONTACT)
            while short(most) > 0:
                most *= 4
            short(brentq(short, 0.0, most, xtol=_CONTACT * 1e-3, rtol=1e-9))

    def keep_as_first(self) -> None:
        """Begin again, guided by this run's loads."""
        _save(self.folder / _BEFORE, delta=self.history.delta, loads=self.history.loads)
        for path in self._records():
            path.unlink()

    def write(
        self, followers: list[Follower], meshes: list[IntervalMesh], result: Check
    ) -> list[IntervalMesh]:
        """Write the motion and its `meshes`, in place of the first guess; the meshes."""
        out, h = self.scene.out / "run", self.history
        time = self.step * np.arange(self.last + 1)
        shapes = self.finger.shapes(time, h.pressure, h.delta)
        values = kinematics_values(self.scene, shapes, exact=True)
        write_kinematics(out / "kinematics.h5", values, units=units_of(self.scene, values))
        intervals = [
            replace(mesh.interval, mesh=number, moving=True) for number, mesh in enumerate(meshes)
        ]
        attributes = {name: meshes[0].planform.attrs[name] for name in ("model", "mirror")}
        values_of = [follower.values() for follower in followers]
        write_planform(out / "planform.h5", intervals, attributes, values_of)
        write_elastic_motion(
            self.scene.out / FILE,
            {
                "time": time,
                "pressure": h.pressure,
                "delta": h.delta,
                "contact_force": self.force,
                "tip_change": result.tip,
                "open_energy": result.open_energy,
                "moment_share": result.moment,
                "runs": 1 if self.before is None else 2,
                "first_order": int(h.first_order),
            },
        )
        return [
            replace(mesh, interval=interval)
            for mesh, interval in zip(meshes, intervals, strict=True)
        ]


def make_later_case(
    scene: Scene, guesses: list[IntervalMesh], number: int, nodes: FloatArray
) -> None:
    """Write the case of an interval after the first, in the shape that the finger then has."""
    mesh = guesses[number]
    intervals = [each.interval for each in guesses]
    shutil.rmtree(scene.out / "case" / mesh.interval.name, ignore_errors=True)
    swept = build_mesh(mesh.planform)
    write_interval(scene, intervals, mesh.interval, mesh.planform, swept, nodes)


class Follower:
    """The solver of one mesh interval, whose mesh follows the coupled motion."""

    def __init__(self, run: Coupled, case: Path, guess: IntervalMesh, ranks: Ranks) -> None:
        """`guess`: the interval's mesh, with the first guess of its motion."""
        self._run, self._case, self._guess, self._ranks = run, case, guess, ranks
        interval, file = guess.interval, guess.planform
        self._first, self._start, self._end = (
            steps_of(at, run.step) for at in (interval.begin, interval.start, interval.end)
        )
        names = ("triangles", "quads", "body", "wall", "material", "outer")
        fixed = file["fixed"].values.astype(bool)
        parts: dict[str, Any] = {name: file[name].values for name in names}
        self._planform = Planform(nodes=file["built"].values, fixed=fixed, **parts)
        triangles = corner_triangles(self._planform.triangles, self._planform.quads)
        self._morph = Morph(self._planform.nodes, triangles, fixed)
        self._near = -1  # number of the step whose nodes give the mesh's Hessian
        kept = run.restore(run.last)
        shapes, bends = file["points"].values, file["bend"].values
        near = int(np.argmin(np.abs(bends - run.bend(self._first)))) if self._first else 0
        self.nodes = {self._first: self._at(self._first, shapes[near], self._morph.approach)}
        if not self._first and not (run.folder / "0.npz").exists():
            self._advance(0)
        # in the overlap with the interval before the motion is known
        for number in range(self._first + 1, min(self._start + 1, self._end) + 1):
            self._follow(number)
        self.nodes |= {n: x for n, x in kept.items() if self._start + 1 < n <= self._end}

    def _at(
        self, number: int, nodes: FloatArray, move: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> FloatArray:
        """Nodes whose wall is the outline at the end of a step, from others. StageError."""
        run, target = self._run, nodes.copy()
        target[self._planform.wall] = outline_at(run.outline_after(number), self._planform.material)
        try:
            nodes = move(nodes, target)
            if number % _HESSIAN == 0 or number in (self._first, self._end):
                quality = shape_quality(self._planform, nodes)
                check_quality(quality, run.bend(number), run.scene.mesh, _BEYOND)
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
        """From the loads at the end of a step to the rotations of the next; leaves a record."""
        run, history = self._run, self._run.history
        turn = run.bend(number)
        if run.inertia_turn is None or abs(turn - run.inertia_turn) > _STALE_TURN:
            history.inertia, run.inertia_turn = self._inertia(number), turn
        history.first_order = history.first_order or history.alternates(number)
        later = min(number + 1, run.last)
        if number < run.last:
            run.advance(number)
        if self._start < number < self._end:
            self._follow(number + 1)
        _save(
            run.folder / f"{number}.npz",
            loads=history.loads[number],
            delta=history.delta[later],
            contact=history.contact[later],
            force=run.force[later],
            nodes=self.nodes.get(number + 1, np.zeros(0)) if number > self._start else np.zeros(0),
            inertia=history.inertia,
            inertia_turn=run.inertia_turn,
            first_order=history.first_order,
        )

    def _inertia(self, number: int) -> FloatArray:
        """The water's inertia (slice, 3, slice) in the shape at the end of a step.

        Angular accelerations are taken as polynomials along the finger: finer ones meet a chain
        that is stiff against them.
        """
        run, history = self._run, self._run.history
        pressure, delta = float(history.pressure[number]), history.delta[number]
        arc = np.linspace(-1, 1, len(delta))
        modes = np.linalg.qr(np.polynomial.legendre.legvander(arc, min(_MODES, len(arc)) - 1))[0]
        planform, nodes = self._planform, self.nodes[number]
        now = run.outline(pressure, delta)
        moved = np.zeros((modes.shape[1], *nodes.shape))
        for mode, by in zip(moved, modes.T, strict=True):
            outline = run.outline(pressure, delta + _NUDGE * by) - now
            mode[planform.wall] = outline_at(outline, planform.material) / _NUDGE
        place, force = forces_of_water(
            self._guess.planform, self._guess.sweep, nodes, moved, run.scene.fluid.density
        )
        posed = Posed(run.finger, pressure, delta)
        loads = np.array([posed.of_forces(place, one)[1:] for one in force])
        return -np.einsum("msl,jm->slj", loads, modes)

    def mesh(self) -> IntervalMesh:
        """The interval's mesh with its motion as far as it is known."""
        time, points = self._motion()
        return replace(
            self._guess, motion=NodeMotion(CubicSpline(time, time), CubicSpline(time, points))
        )

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        numbers = sorted(self.nodes)
        return self._run.step * np.array(numbers), np.array([self.nodes[n] for n in numbers])

    def values(self) -> dict[str, Any]:
        """Variables of the planform's group in planform.h5."""
        file, (time, points) = self._guess.planform, self._motion()
        other = ("shape_parameter", "points", "bend", "built", "fixed")
        same = {str(name): file[name].values for name in file.variables if name not in other}
        bends = np.array([self._run.bend(number) for number in sorted(self.nodes)])
        moved = {"shape_parameter": time, "points": points, "bend": bends}
        return same | moved | {"corners": file.attrs["corners"]}

    @property
    def first_nodes(self) -> FloatArray:
        """Nodes (node, 2) m of the planform at the interval's begin."""
        return self.nodes[self._first]

    def lay_frames(self) -> None:
        """A frame for each instant: those of steps that are not known are written in time."""
        frames = Frames(self._case, self._guess.planform, self._guess.sweep, self._ranks)
        for number in range(self._first, self._end + 1):
            self._frame(frames, number, self.nodes.get(number, self.nodes[self._first]))

    def _frame(self, frames: Frames, number: int, nodes: FloatArray) -> None:
        """Before and after its instant: of two frames OpenFOAM reads the later one too early."""
        for part in (-_FRAME, _FRAME):
            frames.write((number + part) * self._run.step, nodes - self.nodes[self._first])

    def begin(self, time: float) -> None:
        """The solver starts at `time` (s)."""
        run, at = self._run, steps_of(time, self._run.step)
        known = max(at, self._start)
        run.restore(known)
        if self._first and known == self._start:
            run.inertia_turn = None  # that of the mesh before
        self.nodes = {n: x for n, x in self.nodes.items() if n <= known + 1}
        self._frames = Frames(self._case, self._guess.planform, self._guess.sweep, self._ranks)
        for number in range(at, min(known + 1, self._end) + 1):
            self._frame(self._frames, number, self.nodes[number])
        clear_gates(self._case)
        if at + 1 < self._end:
            close_gate(self._case, (at + 1) * run.step)

    def end(self) -> None:
        """The solver has ended, or was stopped."""
        clear_gates(self._case)

    def answer(self, time: float, alive: Callable[[], bool]) -> None:
        """The solver has computed the step that ends at `time` (s): it gets the next one."""
        run, number = self._run, steps_of(time, self._run.step)
        samples = self._case / "postProcessing" / "fingerSurface"
        surface = samples / time_name(number * run.step) / "finger.vtk"
        while not is_whole_vtk(surface):
            if not alive():
                return
            clock.sleep(_PAUSE)
        if number > self._start:
            density, copies = run.scene.fluid.density, PER_FINGER[run.scene.model.kind]
            posed = Posed(
                run.finger, float(run.history.pressure[number]), run.history.delta[number]
            )
            loads, _ = posed.loads(surface, density, copies)
            run.history.loads[number] = loads[1:]
            self._advance(number)
            if number < self._end:
                self._frame(self._frames, number + 1, self.nodes[number + 1])
        if number + 1 < self._end:
            close_gate(self._case, (number + 1) * run.step)
        if number < self._end:
            open_gate(self._case, number * run.step, alive)
