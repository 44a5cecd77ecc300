"""The motion that pressure and water make together, by whole runs: each has the motion that the loads of the one before make.

Fingers that touch are coupled until the contact law slows them down. From there they go on as the modelled water has it,
slowed down and held by that law like prescribed ones: what a contact does to an elastic finger is not computed.

The runs lie below out/<level>/coupled, so that one that was cut off resumes like any other, and none is repeated.
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

CHEAP = "draft"  # level of the runs before the last ones
FINE_LEVELS = ("coarse", "medium", "fine", "reference")  # that are worth it
CHEAP_FACTOR = 5  # on the tolerance: a finer level moves the tip by as much itself, so that more cheap runs buy nothing
FIRST = {
    "added_mass": 0.87,
    "drag": 2.2,
}  # a fit to the closing stroke of the shipped finger: only where the runs begin
OPEN = 4  # times the tolerance, of the pressure's work: what may be open where a run's own loads stand for those its motion bears
SHAPES = "elastic_motion.h5"
AFTER = "after.h5"  # beside it in the last run: the motion that the loads of this one make, and its change


class Structure:
    """The scene's finger: its chain, its chambers' pressure at the structure's times, and what is around it."""

    def __init__(self, scene: Scene) -> None:
        if scene.body is not None or scene.motion.source != "fea":
            raise StageError(
                f"{scene.folder / 'scene.toml'}: COUPLED=1 takes fingers with motion.source = 'fea': a rigid body does not bend,"
                " and other motions have no pressure"
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
                f"{scene.folder / 'scene.toml'}: motion.states says no bending stiffness, which COUPLED=1 needs: analyse it with"
                " make fea, or give structure.bending_stiffness (N m2)"
            )
        self.chain = Chain(states, law, scene.finger.width)
        self.prescribed_first = scene.structure.first_motion == "prescribed"
        self.around = Surroundings(
            gravity(axes(scene.finger)),
            scene.fluid.density,
            scene.structure.added_mass,
            scene.structure.drag,
            scene.structure.damping,
        )

    @property
    def step(self) -> float:
        return float(self.time[1])

    def modelled(self) -> FloatArray:
        """Rotations under the modelled water."""
        nothing = np.zeros((len(self.time), self.chain.slices, 3))
        return motion(
            self.chain, self.pressure, self.step, Surroundings(**vars(self.around) | FIRST), nothing
        )

    def first(self) -> FloatArray:
        """Rotations of the first run."""
        return (
            np.zeros((len(self.time), self.chain.slices))
            if self.prescribed_first
            else self.modelled()
        )

    def prolonged(self, delta: FloatArray) -> FloatArray:
        """Rotations over the whole time: `delta` as far as it goes, then as the modelled water has it, from there on."""
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

    def open_energy(self, delta: FloatArray, loads: xr.Dataset) -> float:
        """Share of the pressure's work that is open in the motion `delta` with the loads of its own run.

        With the loads that the motion was made of it is 2e-4: what is open is the work of their difference.
        """
        water = replace(self.around, added_mass=0.0, drag=0.0)
        computed = loads_at(loads, self.time)
        return open_share(energies(self.chain, self.pressure, delta, self.step, water, computed))


def couple(scene: Scene, machine: Machine, quiet: bool = False, target: str = "report") -> Run:
    """The coupled run of a scene up to `target`, and those that its motion follows from. StageError."""
    structure = Structure(scene)
    end = _end_of_approach(scene, structure)
    if end is None:
        return _couple_free(scene, machine, quiet, target)
    approach = scene.motion.model_copy(update={"end_time": end})
    free = scene.model_copy(update={"motion": approach})
    last = _couple_free(free, machine, quiet, "loads").out / SHAPES
    out = scene.out / "coupled" / "contact"
    delta = structure.prolonged(read_elastic_motion(last)["delta"].values)
    _kept(structure, out / SHAPES, delta, None, digest([_numbers(scene), sha256(last)]))
    run = _coupled_run(scene, scene.level, out)
    make(run, target, machine, quiet)
    return run


def _couple_free(scene: Scene, machine: Machine, quiet: bool, target: str) -> Run:
    """Runs until the motion changes no more, the last one at the scene's level. StageError."""
    structure = Structure(scene)
    home = scene.out / "coupled"
    where = scene.folder / "scene.toml"
    limit = scene.structure.tolerance * scene.finger.length
    open_limit = OPEN * scene.structure.tolerance
    level = CHEAP if scene.level in FINE_LEVELS else scene.level
    delta, before, made_of = structure.first(), None, digest([_numbers(scene), "first"])
    changes: list[float] = []
    last = left = np.inf
    for number in range(1, scene.structure.iterations + 1):
        out = home / str(number)
        delta = _kept(structure, out / SHAPES, delta, before, made_of)
        run = _coupled_run(scene, level, out)
        make(run, "loads", machine, quiet)
        loads = read_loads(run.path("loads"))
        left = structure.open_energy(delta, loads)
        before, delta = delta, structure.next(delta, loads)
        made_of = digest([_numbers(scene), sha256(run.path("loads"))])
        values = motion_values(structure.chain, structure.time, structure.pressure, delta, before)
        last = values["tip_change"]
        changes.append(last)
        allowed = limit if level == scene.level else CHEAP_FACTOR * limit
        if not quiet:
            print(
                f"couple: run {number} ({level}): the tip's place changes by {last * 1e3:.2f} mm, its turn by"
                f" {np.degrees(values['bend_change']):.2f}°; {allowed * 1e3:.2g} mm are allowed; {left:.1%} of the energy is open",
                flush=True,
            )
        near = check_change(changes, allowed, where)
        if not near or (level == scene.level and left > open_limit):
            continue
        if level == scene.level:
            write_elastic_motion(out / AFTER, values | {"made_of": made_of})
            make(run, target, machine, quiet)
            for later in range(number + 1, scene.structure.iterations + 1):
                shutil.rmtree(home / str(later), ignore_errors=True)  # of another motion
            return run
        level, changes = scene.level, []
    raise StageError(
        f"{where}: after {scene.structure.iterations} runs the motion of level {scene.level} is not"
        f" reached: the last change was {last * 1e3:.2g} mm, {limit * 1e3:.2g} mm are allowed, and {left:.1%} of the energy was"
        f" open, {open_limit:.2g} is allowed; raise structure.iterations"
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
    """What a coupled motion follows from, but for the number of runs: where that is raised, the runs that are there stay."""
    about = scene.model_dump(mode="json", exclude={"folder", "out", "parents", "notes"})
    about["structure"].pop("iterations")
    files = Run(scene).made_from("kinematics")["files"]
    return [about, files]


def _kept(
    structure: Structure, path: Path, delta: FloatArray, before: FloatArray | None, made_of: str
) -> FloatArray:
    """The rotations of a motion that is there and made of the same; else `delta`, written to `path`."""
    if path.exists():
        file = read_elastic_motion(path)
        if file.attrs["made_of"] == made_of:
            return np.asarray(file["delta"].values)
    _write(structure, path, delta, before, made_of)
    return delta


def _write(
    structure: Structure, path: Path, delta: FloatArray, before: FloatArray | None, made_of: str
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    values = motion_values(structure.chain, structure.time, structure.pressure, delta, before)
    write_elastic_motion(path, values | {"made_of": made_of})


def _end_of_approach(scene: Scene, structure: Structure) -> float | None:
    """When (s) the contact law begins to slow down the fingers as the modelled water moves them; None where they do not touch."""
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
    return float(
        time[np.argmax(gaps <= scene.pinch.residual_gap + scene.pinch.slowing_distance) - 1]
    )
