"""Fluid-structure coupling by whole runs, a fixed-point iteration of the finger's motion.

The loads of each run give the motion of the next one. Fingers that touch are coupled until the
contact law slows them down. From there the modelled loads move them and that law stops them, as
it stops prescribed fingers: the elastic contact is not computed. The runs lie below
out/<level>/coupled and resume like any other.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.atomic import sha256
from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray
from fileio.formats.elastic_motion import read_elastic_motion, write_elastic_motion
from fileio.formats.finger_loads import read_loads
from fileio.provenance import digest
from pipeline.kinematics.contact import gap
from pipeline.kinematics.finger import axes, finger_motion, finger_states
from pipeline.runs.make import Machine, make
from pipeline.runs.run import Run, open_run
from pipeline.scene.scene import Scene
from pipeline.structure.chain import Chain
from pipeline.structure.coupling import check_change, knots, loads_at, motion_values, next_delta
from pipeline.structure.elastic_law import bending_law
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import STEP, Surroundings, motion
from pipeline.structure.stage import gravity

_CHEAP = "draft"  # level of the first runs of a scene at one of _FINE_LEVELS
_FINE_LEVELS = ("coarse", "medium", "fine", "reference")
_CHEAP_FACTOR = 5  # on the tolerance: a change of level moves the tip by as much
# fitted to the closing stroke of the shipped finger; they affect the first run alone
_FIRST_LOADS = {"added_mass": 0.87, "drag": 2.2}
_RESIDUAL_FACTOR = 4  # times the tolerance: allowed energy residual, share of the pressure's work
SHAPES = "elastic_motion.h5"
_AFTER = "after.h5"  # in the last run: the motion under its own loads, and its change


class _Structure:
    """The scene's finger: its chain, the pressure in its chambers over time, its surroundings."""

    def __init__(self, scene: Scene) -> None:
        if scene.body is not None or scene.motion.source != "fea":
            raise StageError(
                f"{scene.folder / 'scene.toml'}: COUPLED=1 takes fingers with motion.source ="
                " 'fea': a rigid body does not bend, and other motions have no pressure"
            )
        end = scene.motion.end_time
        self.time: FloatArray = np.linspace(0.0, end, round(end / STEP) + 1)
        self.pressure = finger_motion(scene.motion, scene.finger, None, scene.folder).free_law(
            self.time
        )
        lowest, highest = float(self.pressure.min()), float(self.pressure.max())
        states = finger_states(scene.motion, scene.finger, scene.folder, lowest, highest)
        law = bending_law(states, scene.structure.bending_stiffness)
        if law is None:
            raise StageError(
                f"{scene.folder / 'scene.toml'}: motion.states has no bending stiffness, which"
                " COUPLED=1 needs: analyse it with make fea, or give structure.bending_stiffness"
                " (N m2)"
            )
        self.chain = Chain(states, law, scene.finger.width)
        self.prescribed_first = scene.structure.first_motion == "prescribed"
        model = scene.structure
        self.around = Surroundings(
            gravity(axes(scene.finger)),
            scene.fluid.density,
            model.added_mass,
            model.drag,
            model.damping,
        )

    @property
    def step(self) -> float:
        return float(self.time[1])

    def modelled(self) -> FloatArray:
        """Rotations under modelled added mass and drag."""
        no_loads = np.zeros((len(self.time), self.chain.slices, 3))
        around = replace(self.around, **_FIRST_LOADS)
        return motion(self.chain, self.pressure, self.step, around, no_loads)

    def first(self) -> FloatArray:
        """Rotations of the first run."""
        still = np.zeros((len(self.time), self.chain.slices))
        return still if self.prescribed_first else self.modelled()

    def prolonged(self, delta: FloatArray) -> FloatArray:
        """Rotations over the whole time: `delta`, continued by the modelled motion."""
        whole, count = self.modelled(), len(delta)
        apart = delta - whole[:count]
        later = np.arange(1, len(whole) - count + 1)[:, None]
        whole[count:] += apart[-1] + later * (apart[-1] - apart[-2])
        whole[:count] = delta
        return whole

    def next(self, delta: FloatArray, loads: xr.Dataset) -> FloatArray:
        """Rotations under the loads of the run with the rotations `delta`."""
        computed = loads_at(loads, self.time)
        return next_delta(self.chain, self.pressure, self.step, self.around, delta, computed)

    def energy_residual(self, delta: FloatArray, loads: xr.Dataset) -> float:
        """Energy residual of the motion `delta` with its own run's loads, share of pressure work.

        It is 2e-4 with the loads that caused the motion: the rest is the work of their difference.
        """
        around = replace(self.around, added_mass=0.0, drag=0.0)
        computed = loads_at(loads, self.time)
        return open_share(energies(self.chain, self.pressure, delta, self.step, around, computed))


def couple(scene: Scene, machine: Machine, quiet: bool = False, target: str = "report") -> Run:
    """Make the coupled run of a scene up to `target`, and the runs of its iteration."""
    structure = _Structure(scene)
    end = _end_of_approach(scene, structure)
    if end is None:
        return _couple_free(scene, machine, quiet, target)
    approach = scene.motion.model_copy(update={"end_time": end})
    free = scene.model_copy(update={"motion": approach})
    last = _couple_free(free, machine, quiet, "loads").out / SHAPES
    out = scene.out / "coupled" / "contact"
    delta = structure.prolonged(read_elastic_motion(last)["delta"].values)
    _read_or_write(structure, out / SHAPES, delta, None, digest([_numbers(scene), sha256(last)]))
    run = _coupled_run(scene, scene.level, out)
    make(run, target, machine, quiet)
    return run


def _couple_free(scene: Scene, machine: Machine, quiet: bool, target: str) -> Run:
    """Make runs until the motion converges, the last at the scene's level. StageError."""
    structure = _Structure(scene)
    home = scene.out / "coupled"
    where = scene.folder / "scene.toml"
    limit = scene.structure.tolerance * scene.finger.length
    residual_limit = _RESIDUAL_FACTOR * scene.structure.tolerance
    level = _CHEAP if scene.level in _FINE_LEVELS else scene.level
    delta, before, origin = structure.first(), None, digest([_numbers(scene), "first"])
    changes: list[float] = []
    last = residual = np.inf
    for number in range(1, scene.structure.iterations + 1):
        out = home / str(number)
        delta = _read_or_write(structure, out / SHAPES, delta, before, origin)
        run = _coupled_run(scene, level, out)
        make(run, "loads", machine, quiet)
        loads = read_loads(run.path("loads"))
        residual = structure.energy_residual(delta, loads)
        before, delta = delta, structure.next(delta, loads)
        origin = digest([_numbers(scene), sha256(run.path("loads"))])
        values = motion_values(structure.chain, structure.time, structure.pressure, delta, before)
        last = values["tip_change"]
        changes.append(last)
        allowed = limit if level == scene.level else _CHEAP_FACTOR * limit
        if not quiet:
            print(
                f"couple: run {number} ({level}): the tip moves by {last * 1e3:.2f} mm and turns by"
                f" {np.degrees(values['bend_change']):.2f}°; {allowed * 1e3:.2g} mm are allowed;"
                f" energy residual {residual:.1%}",
                flush=True,
            )
        near = check_change(changes, allowed, where)
        if not near or (level == scene.level and residual > residual_limit):
            continue
        if level == scene.level:
            write_elastic_motion(out / _AFTER, values | {"made_of": origin})
            make(run, target, machine, quiet)
            for later in range(number + 1, scene.structure.iterations + 1):
                shutil.rmtree(home / str(later), ignore_errors=True)  # of another motion
            return run
        level, changes = scene.level, []
    raise StageError(
        f"{where}: after {scene.structure.iterations} runs the motion of level {scene.level} has"
        f" not converged: the last change was {last * 1e3:.2g} mm, {limit * 1e3:.2g} mm are"
        f" allowed, and the energy residual was {residual:.1%}, {residual_limit:.2g} is allowed;"
        " raise structure.iterations"
    )


def _coupled_run(scene: Scene, level: str, out: Path) -> Run:
    """The run whose motion lies in its folder."""
    overrides = {
        "title": f"{scene.title}, coupled",
        "motion.source": "structure",
        "motion.shapes": os.path.relpath(out / SHAPES, scene.folder),
        "motion.end_time": scene.motion.end_time,
    }
    return open_run(scene.folder, level, overrides, out)


def _numbers(scene: Scene) -> list[Any]:
    """What a coupled motion depends on, without the number of runs."""
    structure = scene.structure.model_dump(mode="json", exclude={"iterations"})
    return [Run(scene).digest("loads"), structure]


def _read_or_write(
    structure: _Structure, path: Path, delta: FloatArray, before: FloatArray | None, origin: str
) -> FloatArray:
    """Rotations of the file `path` if it has this origin; else `delta`, written to it."""
    if path.exists():
        file = read_elastic_motion(path)
        if file.attrs["made_of"] == origin:
            return np.asarray(file["delta"].values)
    _write(structure, path, delta, before, origin)
    return delta


def _write(
    structure: _Structure, path: Path, delta: FloatArray, before: FloatArray | None, origin: str
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    values = motion_values(structure.chain, structure.time, structure.pressure, delta, before)
    write_elastic_motion(path, values | {"made_of": origin})


def _end_of_approach(scene: Scene, structure: _Structure) -> float | None:
    """Time (s) at which the contact law slows down the modelled motion; None without contact."""
    if scene.pinch is None:
        return None
    shapes = scene.out / "coupled" / "modelled.h5"
    _write(structure, shapes, structure.modelled(), None, "")
    motion = scene.motion.model_copy(
        update={"source": "structure", "shapes": os.path.relpath(shapes, scene.folder)}
    )
    free = finger_motion(motion, scene.finger, None, scene.folder)
    time = knots(motion.end_time)
    gaps = gap(np.array([free.outline(float(t)) for t in time]), scene.pinch)
    if gaps.min() > scene.pinch.residual_gap:
        return None
    slow = scene.pinch.residual_gap + scene.pinch.slowing_distance
    return float(time[np.argmax(gaps <= slow) - 1])
