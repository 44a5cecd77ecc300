"""Stage loads: the water's loads along the finger, and the deflection they would cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from fileio.formats.bending_states import FloatArray
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import deflection_sentence, write_loads
from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.mesh_intervals import PER_FINGER, read_intervals
from pipeline.kinematics.finger import axes, finger_states
from pipeline.openfoam.surface_vtk import sampled_surfaces
from pipeline.scene.scene import Scene
from pipeline.structure.chain import Chain, ComplexArray, placed
from pipeline.structure.coupling import loads_at
from pipeline.structure.deflection import deflections, prescribed
from pipeline.structure.elastic_law import bending_law, constant_law
from pipeline.structure.energy import energies
from pipeline.structure.loads import slice_loads, surface_forces
from pipeline.structure.motion import STEP, Surroundings, motion

_GRAVITY = 9.81  # m/s²
_UNKNOWN = (
    "The motion is prescribed, and motion.states says no bending stiffness, so what the loads would"
    " bend is not known: analyse it with make fea, or give structure.bending_stiffness (N m2)."
)
_RIGID = "The body is rigid: no load bends it."
_COUPLED = (
    "The motion is not prescribed: it is what the pressure and the loads of the run before make of"
    " the finger."
)
_HELD = (
    "The motion is not prescribed until the tips are slowed down before their contact, which then"
    " holds them."
)


def gravity(frame: FloatArray) -> complex:
    """In the actuator's frame, m/s²; `frame` as `axes` gives it."""
    return complex(*(frame @ [0.0, -_GRAVITY]))


def _plane(vectors: FloatArray) -> ComplexArray:
    """Vectors (…, 2) as complex numbers."""
    return np.asarray(vectors[..., 0] + 1j * vectors[..., 1], dtype=complex)


@dataclass(frozen=True)
class _Finger:
    """A finger's chain in its tank, with its motion over time (s)."""

    chain: Chain
    chambers: CubicSpline  # their pressure, Pa
    turns: Callable[[FloatArray], FloatArray]  # elastic rotations (time, slice), rad
    frame: FloatArray  # of the actuator, as `axes` gives it
    root: FloatArray  # m
    water: Surroundings


def _elastic_turns(scene: Scene, slices: int) -> Callable[[FloatArray], FloatArray]:
    """Elastic rotations over time of the motion that was run; none of a prescribed one."""
    if scene.motion.shapes is None:
        return lambda time: np.zeros((len(time), slices))
    file = read_elastic_motion(scene.folder / scene.motion.shapes)
    return CubicSpline(file["time"].values, file["delta"].values)


def _measured_loads(
    scene: Scene, finger: _Finger, law: CubicSpline | None, quiet: bool
) -> dict[str, Any]:
    """Variables of loads.h5 from the samples of the run.

    `law`: time of the shape over time (s), where a contact stops a coupled finger.
    """
    chain, turn = finger.chain, finger.frame.T
    samples = sampled_surfaces(scene.out / "case", read_intervals(scene.out), "finger")
    copies = PER_FINGER[scene.model.kind]
    both = scene.pinch is not None and scene.model.kind in ("half", "full")
    time = np.array([time for time, _ in samples])
    shape_time = time if law is None else law(time)
    pressure, delta = finger.chambers(shape_time), finger.turns(shape_time)
    at = placed(chain.unloaded(pressure), slice(None), delta)
    profile, thickness = chain.profile(pressure, delta), chain.thickness(pressure)
    edge = -0.5j * chain.thickness(np.zeros(1))[0, 0]  # the root's middle from its ventral edge
    force, torque, root_moment = [], [], []
    for k, (_, path) in enumerate(tqdm(samples, "loads", disable=quiet or None)):
        centre, pushed = surface_forces(path, scene.fluid.density, both)
        place, push = _plane((centre - finger.root) @ turn), copies * _plane(pushed @ turn)
        along, about = slice_loads(chain, at.at(k), profile[k], thickness[k], place + edge, push)
        force.append(np.stack([along.real, along.imag], axis=-1))
        torque.append(about)
        root_moment.append(float(np.sum((np.conj(place) * push).imag)))
    middles = chain.arc[chain.joints[:-1]] + 0.5 * chain.lengths
    return {
        "time": time,
        "pressure": pressure,
        "arc": np.concatenate([[0.5 * chain.arc[chain.joints[0]]], middles]),
        "force": np.array(force),
        "torque": np.array(torque),
        "root_moment": np.array(root_moment),
    }


def _check(finger: _Finger, kinematics: Kinematics, values: dict[str, Any]) -> dict[str, Any]:
    """What the loads would bend, for loads.h5; of a pinch before its contact."""
    chain = finger.chain
    time, pressure = values["time"], values["pressure"]
    at, rates = prescribed(chain, finger.chambers, time)
    loads = np.concatenate([values["force"], values["torque"][..., None]], axis=-1)[:, 1:]
    wet, dry = (deflections(chain, pressure, at, rates, finger.water, k * loads) for k in (1, 0))
    free = time < float(kinematics.data.attrs.get("contact_time", np.inf))
    most = int(np.argmax(np.where(free, np.abs(wet), -1.0)))
    bend = kinematics.bend(kinematics.law(time))
    return {
        "deflection": wet,
        "dry_deflection": dry,
        "largest_deflection": float(wet[most]),
        "largest_at": float(time[most]),
        "bend_then": float(bend[most]),
        "stroke": float(np.ptp(bend)),
    }


def _history(finger: _Finger, end: float, values: dict[str, Any]) -> dict[str, Any]:
    """The motion at the finger's time steps, also without load and without water; energies.

    `end`: of the motion, s.
    """
    chain, water = finger.chain, finger.water
    time = np.linspace(0.0, end, round(end / STEP) + 1)
    pressure, delta = finger.chambers(time), finger.turns(time)
    none = np.zeros((len(time), chain.slices, 3))
    in_air = motion(chain, pressure, time[1], replace(water, fluid=0.0), none)
    found: dict[str, Any] = {"step": time}
    for name, turn in {"": delta, "_unloaded": 0 * delta, "_in_air": in_air}.items():
        found[f"bend{name}"] = chain.bend(pressure, turn)
        found[f"tip{name}"] = chain.profile(pressure, turn)[:, -1] @ finger.frame + finger.root
    return found | energies(chain, pressure, delta, time[1], water, loads_at(values, time))


def run(scene: Scene, quiet: bool = False) -> None:
    """Write loads.h5."""
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    if scene.body is not None:
        write_loads(scene.out, {"unknown": _RIGID})
        return
    time, pressure = (kinematics.data[name].values for name in ("time", "pressure"))
    lowest, highest = float(pressure.min()), float(pressure.max())
    states = finger_states(scene.motion, scene.finger, scene.folder, lowest, highest)
    known = bending_law(states, scene.structure.bending_stiffness)
    law = known or constant_law(1.0, 0.0, len(states.pressure))
    chain = Chain(states, law, scene.finger.width)
    frame = axes(scene.finger)
    finger = _Finger(
        chain,
        CubicSpline(time, pressure),
        _elastic_turns(scene, chain.slices),
        frame,
        np.asarray(scene.finger.root),
        Surroundings(gravity(frame), scene.fluid.density, damping=scene.structure.damping),
    )
    coupled = scene.motion.shapes is not None
    touches = "contact_time" in kinematics.data.attrs
    stopped = kinematics.law if coupled and touches else None
    values = _measured_loads(scene, finger, stopped, quiet)
    if known and (scene.pinch is None or (coupled and not touches)):
        values |= _history(finger, scene.motion.end_time, values)
    if coupled:
        values["unknown"] = _HELD if touches else _COUPLED
    elif known:
        values |= _check(finger, kinematics, values) | {"unknown": ""}
    else:
        values["unknown"] = _UNKNOWN
    write_loads(scene.out, values)
    if not quiet:
        print(f"loads: {deflection_sentence(values)}")
