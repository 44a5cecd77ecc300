"""The motion that pressure and water make together, by whole runs: each has the motion that the loads of the one before make.

Fingers that touch are coupled until the contact law slows them down. From there they go on as the modelled water has it,
slowed down and held by that law like prescribed ones: what a contact does to an elastic finger is not computed.

The runs are scenes of their own below out/coupled, so that one that was cut off resumes like any other, and none is repeated.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.atomic import update_text
from fileio.checksum import sha256
from fileio.command import add_scene
from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray
from fileio.formats.elastic_motion import read_elastic_motion, write_elastic_motion
from fileio.formats.finger_loads import read_loads
from fileio.key_reference import toml_value
from fileio.provenance import digest
from pipeline.kinematics.contact import gap
from pipeline.kinematics.finger import finger_motion, finger_states
from pipeline.scene.scene import Scene, load_scene
from pipeline.stage_settings import settings_of
from pipeline.structure.chain import Chain
from pipeline.structure.coupling import check_change, knots, loads_at, motion_values, next_delta
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import STEP, Surroundings, motion
from pipeline.structure.stage import bending_law, gravity

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    add_scene(parser)
    parser.add_argument("--ranks", type=int, default=1, help="MPI ranks (default: %(default)s)")
    parser.add_argument(
        "--target",
        default="report",
        help="stage up to which the last run goes (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> None:
    """Command `couple`."""
    couple(load_scene(args.scene, args.level), args.ranks, args.quiet, args.target)


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
        self.around = Surroundings(gravity(scene), scene.fluid.density, scene.structure.added_mass,
                                   scene.structure.drag, scene.structure.damping)  # fmt: skip

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


def couple(scene: Scene, ranks: int, quiet: bool = False, target: str = "report") -> Path:
    """The coupled run of a scene up to `target`, and those that its motion follows from; returns its folder. StageError."""
    structure = Structure(scene)
    end = _end_of_approach(scene, structure)
    if end is None:
        return couple_free(scene, ranks, quiet, target)
    approach = scene.motion.model_copy(update={"end_time": end})
    last = (
        couple_free(scene.model_copy(update={"motion": approach}), ranks, quiet, "loads") / SHAPES
    )
    folder = last.parents[1] / f"contact_{scene.level}"
    delta = structure.prolonged(read_elastic_motion(last)["delta"].values)
    _kept(structure, folder / SHAPES, delta, None, digest([scene.digest(), sha256(last)]))
    update_text(folder / "scene.toml", _scene_text(scene, folder))
    make_run(folder.parent, folder.name, scene.level, target, ranks, quiet)
    return folder


def couple_free(scene: Scene, ranks: int, quiet: bool, target: str) -> Path:
    """Runs until the motion changes no more, the last at the scene's level and up to `target`; returns its folder. StageError."""
    structure = Structure(scene)
    home = scene.folder / "out" / "coupled"
    limit, open_limit = (
        scene.structure.tolerance * scene.finger.length,
        OPEN * scene.structure.tolerance,
    )
    level = CHEAP if scene.level in FINE_LEVELS else scene.level
    # the content of its files too, but not the number of runs: where that is raised, the runs that are there stay
    one_run = scene.model_copy(
        update={"structure": scene.structure.model_copy(update={"iterations": 1})}
    )
    asked = digest([one_run.digest(), settings_of(scene, "kinematics")])
    delta, before, made_of = structure.first(), None, digest([asked, "first"])
    changes: list[float] = []
    last = left = np.inf
    for number in range(1, scene.structure.iterations + 1):
        folder = home / f"{scene.level}_{number}"
        delta = _kept(structure, folder / SHAPES, delta, before, made_of)
        update_text(folder / "scene.toml", _scene_text(scene, folder))
        make_run(home, folder.name, level, "loads", ranks, quiet)
        path = folder / "out" / level / "loads.h5"
        loads = read_loads(path)
        left = structure.open_energy(delta, loads)
        before, delta = delta, structure.next(delta, loads)
        made_of = digest([asked, sha256(path)])
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
        near = check_change(changes, allowed, scene.folder / "scene.toml")
        if not near or (level == scene.level and left > open_limit):
            continue
        if level == scene.level:
            write_elastic_motion(folder / AFTER, values | {"made_of": made_of})
            make_run(home, folder.name, level, target, ranks, quiet)
            for later in range(
                number + 1, scene.structure.iterations + 1
            ):  # of a motion that took more runs
                shutil.rmtree(home / f"{scene.level}_{later}", ignore_errors=True)
            return folder
        level, changes = scene.level, []
    raise StageError(
        f"{scene.folder / 'scene.toml'}: after {scene.structure.iterations} runs the motion of level {scene.level} is not"
        f" reached: the last change was {last * 1e3:.2g} mm, {limit * 1e3:.2g} mm are allowed, and {left:.1%} of the energy was"
        f" open, {open_limit:.2g} is allowed; raise structure.iterations"
    )


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
    shapes = Path("out", "coupled", f"modelled_{scene.level}.h5")
    _write(structure, scene.folder / shapes, structure.modelled(), None, "")
    motion = scene.motion.model_copy(update={"source": "structure", "shapes": str(shapes)})
    free = finger_motion(motion, scene.finger, None, scene.folder)
    time = knots(motion.end_time)
    gaps = gap(np.array([free.outline(float(t)) for t in time]), scene.pinch)
    if gaps.min() > scene.pinch.residual_gap:
        return None
    return float(
        time[np.argmax(gaps <= scene.pinch.residual_gap + scene.pinch.slowing_distance) - 1]
    )


def _scene_text(scene: Scene, folder: Path) -> str:
    parent = os.path.relpath(scene.folder.resolve(), folder.resolve())
    extends, title, shapes = map(toml_value, (parent, f"{scene.title}, coupled", SHAPES))
    motion = f'source = "structure"\nshapes = {shapes}\nend_time = {scene.motion.end_time!r}\n'
    return f"extends = {extends}\ntitle = {title}\n\n[motion]\n{motion}"


def make_run(
    home: Path, name: str, level: str, target: str, ranks: int, quiet: bool = False
) -> None:
    """Make a stage of the scene `name` in the folder `home`. StageError where it fails."""
    words = ["make", "--no-print-directory", f"CASES={home}", f"LEVEL={level}", f"NP={ranks}"]
    # what the make around this one was given is in the environment
    words += ["COUPLED=", f"SCENE={name}"]
    words += ["QUIET=1"] if quiet else []
    inner = {
        key: value
        for key, value in os.environ.items()
        if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    }
    done = subprocess.run([*words, f"{name}.{target}"], env=inner, check=False)
    if done.returncode:
        raise StageError(
            f"{home / name}: make {name}.{target} failed; see above, mend it, and start COUPLED=1 again"
        )
