"""Stage loads: the water's loads along the finger, its energy, its motion in air and water."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from pipeline.formats.bending_states import FloatArray
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.formats.finger_loads import SETTLED, motion_sentence, write_loads
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import PER_FINGER, read_intervals
from pipeline.openfoam.surface_vtk import sampled_surfaces
from pipeline.scene.scene import Scene
from pipeline.structure.energy import energies
from pipeline.structure.finger import ElasticFinger, Posed, copies, stiffness_remedy
from pipeline.structure.motion import STEP, at_rest, motion
from pipeline.structure.vibration import LOSS_BAND
from piv.files.errors import StageError

_UNKNOWN = (
    "The motion is prescribed, and motion.states says no bending stiffness, so what the water would"
    " do to the finger is not known: "
)
# steps of the finger's own motion: in all where a vibration then has more than enough of them
_ENOUGH_STEPS, _LEAST = 3000, 40
_STEPS, _VIBRATIONS = 150, 8  # of a vibration; after the run: one loses a third of its energy
_NOT_FOLLOWED = "The finger's motion in air and in modelled water is not computed"
_RIGID = "The body is rigid: no load bends it."


def _measured_loads(
    scene: Scene, finger: ElasticFinger, pressures: CubicSpline, turns: CubicSpline, quiet: bool
) -> dict[str, Any]:
    """Variables of loads.h5 from the samples of the run.

    `pressures` (Pa) and elastic `turns` (slice,) over time.
    """
    chain = finger.chain
    samples = sampled_surfaces(scene.out / "case", read_intervals(scene.motion_folder), "finger")
    # a prescribed motion's loads are those of the flow that is shown
    parts = copies(scene) if scene.coupled else PER_FINGER[scene.model.kind]
    density = scene.fluid.density
    time = np.array([time for time, _ in samples])
    pressure, delta = pressures(time), turns(time)
    found = [
        Posed(finger, float(pressure[k]), delta[k]).loads(path, density, parts, scene.both_fingers)
        for k, (_, path) in enumerate(tqdm(samples, "loads", disable=quiet or None))
    ]
    loads = np.array([each for each, _ in found])
    middles = chain.arc[chain.joints[:-1]] + 0.5 * chain.lengths
    return {
        "time": time,
        "pressure": pressure,
        "arc": np.concatenate([[0.5 * chain.arc[chain.joints[0]]], middles]),
        "force": loads[..., :2],
        "torque": loads[..., 2],
        "root_moment": np.array([moment for _, moment in found]),
    }


def loads_at(values: dict[str, Any], time: FloatArray) -> FloatArray:
    """Loads (time, slice, 3) on the free slices at other times (s), of loads.h5; none at 0."""
    loads = np.concatenate([values["force"], values["torque"][..., None]], axis=-1)[:, 1:]
    known = np.concatenate([[0.0], values["time"]])
    return np.asarray(CubicSpline(known, np.concatenate([0 * loads[:1], loads]))(time))


def _band(finger: ElasticFinger, pressure: FloatArray, step: float) -> dict[str, FloatArray]:
    """Largest bend in modelled water and time of settling at both ends of the loss factor's band.

    The last pressure is kept for some vibrations; a finger that does not settle settles then.
    """
    chain, count = finger.chain, len(pressure) + int(_VIBRATIONS * finger.period / step)
    held = np.pad(pressure, (0, count - len(pressure)), mode="edge")
    none, stream = np.zeros((count, chain.slices, 3)), finger.streams(step * np.arange(count))
    end = replace(finger.model, stream=complex(stream[-1]))
    rest = at_rest(chain, float(held[-1]), end, none[0])
    goal = float(chain.bend(held[-1:], rest[None])[0])
    largest, settled = np.zeros(2), np.zeros(2)
    for k, loss_factor in enumerate(LOSS_BAND):
        around = replace(finger.model, damping=loss_factor * finger.period / (2 * np.pi))
        bend = chain.bend(held, motion(chain, held, step, around, none, streams=stream))
        largest[k] = bend[np.argmax(np.abs(bend))]
        away = np.flatnonzero(np.abs(bend - goal) > SETTLED * abs(goal))
        settled[k] = step * (away[-1] + 1 if away.size else 0)
    return {"loss_factor": np.array(LOSS_BAND), "largest_bend": largest, "settled": settled}


def _history(
    finger: ElasticFinger, time: FloatArray, pressure: FloatArray, delta: FloatArray,
    values: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """The motion over time, also without load, in air and in water; energies."""
    chain, none, step = finger.chain, np.zeros((*delta.shape, 3)), float(time[1])
    in_air = motion(chain, pressure, step, finger.air, none)
    wet = delta
    if not values["coupled"]:
        stream = finger.streams(time)
        wet = motion(chain, pressure, step, finger.model, none, streams=stream)
    found: dict[str, Any] = {"step": time}
    turns = {"": delta, "_unloaded": 0 * delta, "_in_air": in_air, "_in_water": wet}
    for name, turn in turns.items():
        found[f"bend{name}"] = chain.bend(pressure, turn)
    return found | energies(chain, pressure, delta, step, finger.water, loads_at(values, time))


def run(scene: Scene, quiet: bool = False) -> None:
    """Write loads.h5."""
    if scene.body is not None:
        write_loads(scene.out / "loads.h5", {"unknown": _RIGID, "coupled": 0})
        return
    finger, end = ElasticFinger.of(scene), scene.motion.end_time
    law = read_kinematics(scene.motion_folder / "kinematics.h5").data
    pressures = CubicSpline(law["time"].values, law["pressure"].values)
    step = max(STEP, min(end / _ENOUGH_STEPS, finger.period / _LEAST))
    time = np.linspace(0.0, end, round(end / step) + 1)
    delta = np.zeros((len(time), finger.chain.slices))
    values: dict[str, Any] = {"coupled": 0, "unknown": ""}
    if not finger.known:
        values["unknown"] = f"{_UNKNOWN}{stiffness_remedy(scene)}."
    if scene.coupled:
        file = read_elastic_motion(scene.out / FILE)
        time, delta = file["time"].values, file["delta"].values
        names = ("tip_change", "open_energy", "moment_share", "alternated")
        values |= {"coupled": 1} | {name: file.attrs[name] for name in names}
        pushed = file["contact_force"].values
        values["contact_force"] = float(pushed.max())
        values["contact_impulse"] = float(pushed.sum() * time[1])
    elif finger.known and scene.pinch is not None:
        values["unknown"] = (
            "The motion is prescribed; what the water does to it is computed for a finger that"
            " touches nothing."
        )
    values |= _measured_loads(scene, finger, pressures, CubicSpline(time, delta), quiet)
    if not values["unknown"]:
        try:
            values |= _history(finger, time, pressures(time), delta, values)
            if scene.pinch is None and "loss_factor" not in scene.structure.model_fields_set:
                every = max(1, round(finger.period / _STEPS / float(time[1])))
                values |= _band(finger, pressures(time)[::every], every * float(time[1]))
        except StageError as error:  # the page goes without
            values["unknown"] = f"{_NOT_FOLLOWED}: {error}."
    write_loads(scene.out / "loads.h5", values)
    if not quiet:
        print(f"loads: {motion_sentence(values)}")
