"""The mesh of one interval that follows a coupled motion, step by step.

The solver stops at the end of each step (openfoam/gate.py). From the loads that it has sampled, the
structure gives the next rotations, the planform follows them, and the solver goes on with the next
displacement. A run that was killed repeats the motion from the samples, and resumes.
"""

from __future__ import annotations

import shutil
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from pipeline.case.interval_case import build_mesh, sides, write_interval
from pipeline.couple.motion import CoupledMotion
from pipeline.formats.bending_states import FloatArray
from pipeline.formats.mesh_intervals import Interval, IntervalMesh, NodeMotion
from pipeline.geometry.planform import Planform
from pipeline.geometry.quality import shape_quality
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.mesh.morph import Morph, MorphError, check_quality, corner_triangles
from pipeline.mesh.wall_layers import outline_at
from pipeline.openfoam.displacement_files import Frames, steps_of, time_name
from pipeline.openfoam.gate import clear_gates, close_gate, open_gate
from pipeline.openfoam.surface_vtk import is_whole_vtk
from pipeline.solve.checkpoint import prepared_for
from pipeline.solve.interval import KnownMotion, SolverInterval
from pipeline.structure.chain import Chain
from pipeline.structure.finger import Posed
from pipeline.structure.water_inertia import forces_of_water
from piv.files.errors import StageError

_FRAME = 0.01  # of a time step, by which the displacement of an instant stands after it
_STALE_TURN = np.radians(45.0)  # of the tip, after which the water's inertia is computed anew
_HESSIAN = 10  # steps that the mesh's Hessian serves, and between two checks of its quality
# deg above the limit of non-orthogonality, which the guessed shapes keep. The cycle needed 0.1,
# the pinch at 30 kPa and medium 5.7, at the peak of its impact.
_BEYOND = 8.0
_PAUSE = 1e-3  # s
_MODES = 8  # at least
_NUDGE, _NUDGE_PA = 1e-4, 10.0  # rad and Pa
_AT_A_TIME = 10_000_000  # coordinates whose curves are solved at a time: 80 MB


class Follower(KnownMotion):
    """The motion of one mesh interval whose mesh follows the coupled motion."""

    def __init__(self, run: CoupledMotion, spans: Sequence[Interval], part: SolverInterval) -> None:
        """`part`: with the first guess of its motion, which this one replaces; `spans`: of all."""
        super().__init__(part)
        self._run, self._guess, self._folder = run, part.mesh, part.case.folder
        interval, file = part.span, self._guess.planform
        self._first, self._start, self._end = (
            steps_of(at, run.step) for at in (interval.begin, interval.start, interval.end)
        )
        self._known = self._start  # step to whose end the loads are known
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
        part.mesh = self._mesh()
        if interval.index and not prepared_for(self._folder):
            self._write_case(spans)

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
                run.quality.append((*about, *astuple(quality)))
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
        history.choose_order(number)
        if number < run.last:
            run.advance(number)
        if self._start < number < self._end:
            self._follow(number + 1)

    def _inertia(self, number: int) -> FloatArray:
        """The water's inertia (slice, 3, slice + 1), as Coupling's, at the end of a step.

        Angular accelerations are taken as polynomials along the finger.
        """
        run, planform, chain = self._run, self._planform, self._run.finger.chain
        pressure, delta = run.state(number)
        count = mode_count(chain, pressure, run.scene.fluid.density, run.step)
        arc = np.linspace(-1, 1, len(delta))
        modes = np.linalg.qr(np.polynomial.legendre.legvander(arc, count - 1))[0]
        now = run.outline(pressure, delta)
        nudged = [run.outline(pressure, delta + _NUDGE * mode) for mode in modes.T]
        moved = [(outline - now) / _NUDGE for outline in nudged]
        moved.append((run.outline(pressure + _NUDGE_PA, delta) - now) / _NUDGE_PA)
        walls = np.zeros((len(moved), *self.nodes[number].shape))
        walls[:, planform.wall] = outline_at(np.array(moved), planform.material)
        file, density = self._guess.planform, run.scene.fluid.density
        open_ends = [OUTER_PATCHES.index(name) for name in ("gap", "downstream")]
        gaps = np.isin(sides(file, run.scene.current), open_ends)
        place, force = forces_of_water(
            file, self._guess.sweep, self.nodes[number], walls, gaps, density, run.copies
        )
        posed = Posed(run.finger, pressure, delta)
        *turned, pushed = -np.array([posed.of_forces(place, one)[1:] for one in force])
        by_turns = np.einsum("msl,jm->slj", turned, modes)
        heading = chain.unloaded(np.array([pressure, pressure + _NUDGE_PA])).heading
        turn = np.angle(heading[1] / heading[0]) / _NUDGE_PA
        return np.concatenate([by_turns, (pushed - by_turns @ turn)[..., None]], axis=-1)

    def _mesh(self) -> IntervalMesh:
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
            motion=NodeMotion(CubicSpline(time, time), _spline(time, points)),
        )

    def _write_case(self, spans: Sequence[Interval]) -> None:
        """Write the interval's case in the shape that the finger has when it begins."""
        mesh = self._guess
        shutil.rmtree(self._folder, ignore_errors=True)
        swept = build_mesh(mesh.planform, self._run.scene.current)
        nodes = self.nodes[self._first]
        write_interval(self._run.scene, spans, mesh.interval, mesh.planform, swept, nodes)

    def write_frames(self, quiet: bool) -> None:
        """Write an empty frame for each instant: the solver finds them when it starts."""
        frames = Frames(self.part.case, self._guess)
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
        """Start the motion where the solver starts, at `time` (s)."""
        at = steps_of(time, self._run.step)
        self._catch_up(at)
        for path in self._samples.glob("*"):  # of a killed run
            if float(path.name) > time * (1 + 1e-9):
                shutil.rmtree(path)
        self._frames = Frames(self.part.case, self._guess)
        for number in range(max(at - 1, self._first), min(self._known + 1, self._end) + 1):
            self._frame(number)
        clear_gates(self._folder)
        if at + 1 < self._end:
            close_gate(self._folder, (at + 1) * self._run.step)

    def end(self) -> None:
        """The solver has ended, or was stopped."""
        clear_gates(self._folder)

    @property
    def _samples(self) -> Path:
        return self._folder / "postProcessing" / "fingerSurface"

    def _surface(self, number: int) -> Path:
        return self._samples / time_name(number * self._run.step) / "finger.vtk"

    def finish(self) -> None:
        """Repeat what is left of the motion; the part's mesh then has all of it."""
        super().finish()
        self._catch_up(self._end)
        self.part.mesh = self._mesh()

    def _catch_up(self, number: int) -> None:
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
            close_gate(self._folder, (number + 1) * self._run.step)
        if number < self._end:
            open_gate(self._folder, number * self._run.step, alive)


def mode_count(chain: Chain, pressure: float, density: float, step: float) -> int:
    """Polynomials along a chain at `pressure` (Pa) that hold the water's inertia in a `step` (s).

    Waves that are finer meet a chain that is stiff against them: within a step its stiffness weighs
    EI k⁴ step² / 2 against a wave of number k, the water (kg/m³) on both sides 2 ρ width / k, which
    is taken twice. Where that asks for more than _MODES, half as many again let a sudden load ring
    less.
    """
    stiffness = float(np.interp(pressure, chain.pressure, chain.law.stiffness))
    water = 8 * density * chain.width / stiffness / step**2
    needed = 0.5 * water**0.2 * chain.arc[-1]
    count = _MODES if needed <= _MODES else int(np.ceil(1.5 * needed))
    return min(count, chain.slices)


def _spline(time: FloatArray, points: FloatArray) -> BSpline:
    """Curves through points (time, node, 2): CubicSpline's, which took 13 times their memory."""
    degree, coefficients = min(3, len(time) - 1), np.empty_like(points)
    for some in np.array_split(np.arange(points.shape[1]), 1 + points.size // _AT_A_TIME):
        curve = make_interp_spline(time, points[:, some], degree)
        coefficients[:, some] = curve.c
    return BSpline(curve.t, coefficients, degree)
