"""Stage loads: the water's loads along the finger, and what they would bend that the prescribed motion does not show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from fileio.formats.bending_states import BendingLaw, BendingStates, FloatArray, States
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
from pipeline.structure.elastic_law import constant_law
from pipeline.structure.energy import energies
from pipeline.structure.loads import slice_loads, surface_forces
from pipeline.structure.motion import STEP, Surroundings, motion

GRAVITY = 9.81  # m/s²
UNKNOWN = (
    "The motion is prescribed, and motion.states says no bending stiffness, so what the loads would bend is not known: analyse"
    " it with make fea, or give structure.bending_stiffness (N m2)."
)
RIGID = "The body is rigid: no load bends it."
COUPLED = "The motion is not prescribed: it is what the pressure and the loads of the run before make of the finger."
HELD = "The motion is not prescribed until the tips are slowed down before their contact, which then holds them."


def bending_law(states: States, stiffness: float | None) -> BendingLaw | None:
    """That of the states, or where `stiffness` (N m²) is given, of that EI and else as the states say; None where neither is known."""
    law = states.law if isinstance(states, BendingStates) else None
    if stiffness is None:
        return law
    constant = constant_law(stiffness, 0.0, len(states.pressure))
    if law is None:
        return constant
    return replace(
        law, stiffness=constant.stiffness, moment=constant.moment, curvature=constant.curvature
    )


def finger_chain(scene: Scene, kinematics: Kinematics) -> tuple[Chain, bool]:
    """The finger as a chain, and whether its bending stiffness is known."""
    pressure = kinematics.data["pressure"].values
    lowest, highest = float(pressure.min()), float(pressure.max())
    states = finger_states(scene.motion, scene.finger, scene.folder, lowest, highest)
    law = bending_law(states, scene.structure.bending_stiffness)
    return Chain(
        states, law or constant_law(1.0, 0.0, len(states.pressure)), scene.finger.width
    ), law is not None


def gravity(scene: Scene) -> complex:
    """In the actuator's frame, m/s²."""
    along, ventral = axes(scene.finger) @ [0.0, -GRAVITY]
    return complex(along, ventral)


def plane(vectors: FloatArray) -> ComplexArray:
    """Vectors (…, 2) as complex numbers."""
    return np.asarray(vectors[..., 0] + 1j * vectors[..., 1], dtype=complex)


def elastic_turns(scene: Scene, chain: Chain, time: FloatArray) -> FloatArray:
    """Elastic rotations (time, slice) of the motion that was run; none of a prescribed one."""
    if scene.motion.shapes is None:
        return np.zeros((len(time), chain.slices))
    file = read_elastic_motion(scene.folder / scene.motion.shapes)
    return np.asarray(CubicSpline(file["time"].values, file["delta"].values)(time))


def measured_loads(
    scene: Scene, chain: Chain, chambers: CubicSpline, held: CubicSpline | None, quiet: bool
) -> dict[str, Any]:
    """Variables of loads.h5 from the samples of the run; `chambers`: their pressure (Pa) over time.

    `held`: over time (s), that of the shape, of a coupled finger that a contact holds.
    """
    samples = sampled_surfaces(scene.out / "case", read_intervals(scene.out), "finger")
    copies = PER_FINGER[scene.model.kind]
    both = scene.pinch is not None and scene.model.kind in ("half", "full")
    turn, root = axes(scene.finger).T, np.asarray(scene.finger.root)
    time = np.array([time for time, _ in samples])
    shape_time = time if held is None else held(time)
    pressure, delta = chambers(shape_time), elastic_turns(scene, chain, shape_time)
    at = placed(chain.unloaded(pressure), slice(None), delta)
    profile, thickness = chain.profile(pressure, delta), chain.thickness(pressure)
    edge = -0.5j * chain.thickness(np.zeros(1))[0, 0]  # the root's middle from its ventral edge
    force, torque, root_moment = [], [], []
    for k, (_, path) in enumerate(tqdm(samples, "loads", disable=quiet or None)):
        faces = surface_forces(path, scene.fluid.density, both)
        place, push = plane((faces.place - root) @ turn), copies * plane(faces.force @ turn)
        loads = slice_loads(chain, at.at(k), profile[k], thickness[k], place + edge, push)
        force.append(np.stack([loads.force.real, loads.force.imag], axis=-1))
        torque.append(loads.torque)
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


def check(
    chain: Chain,
    kinematics: Kinematics,
    chambers: CubicSpline,
    around: Surroundings,
    values: dict[str, Any],
) -> dict[str, Any]:
    """Variables and attributes of loads.h5 that say what the loads would bend; of a pinch before its contact."""
    time, pressure = values["time"], values["pressure"]
    at, rates = prescribed(chain, chambers, time)
    loads = np.concatenate([values["force"], values["torque"][..., None]], axis=-1)[:, 1:]
    wet = deflections(chain, pressure, at, rates, around, loads)
    dry = deflections(chain, pressure, at, rates, around, 0 * loads)
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


def history(
    scene: Scene, chain: Chain, chambers: CubicSpline, values: dict[str, Any]
) -> dict[str, Any]:
    """Variables of loads.h5 over the finger's own time steps: its motion beside those without load and without water, and energies."""
    end = scene.motion.end_time
    time = np.linspace(0.0, end, round(end / STEP) + 1)
    pressure, delta = chambers(time), elastic_turns(scene, chain, time)
    rubber = scene.structure.damping
    here, air = gravity(scene), Surroundings(gravity(scene), damping=rubber)
    none = np.zeros((len(time), chain.slices, 3))
    turns = {
        "": delta,
        "_unloaded": 0 * delta,
        "_in_air": motion(chain, pressure, time[1], air, none),
    }
    frame, root = axes(scene.finger), np.asarray(scene.finger.root)
    found: dict[str, Any] = {"step": time}
    for name, turn in turns.items():
        found |= {
            f"bend{name}": chain.bend(pressure, turn),
            f"tip{name}": chain.profile(pressure, turn)[:, -1] @ frame + root,
        }
    loads = loads_at(values, time)
    water = Surroundings(here, scene.fluid.density, damping=rubber)
    return found | energies(chain, pressure, delta, time[1], water, loads)


def run(scene: Scene, quiet: bool = False) -> None:
    """Write loads.h5."""
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    if scene.body is not None:
        write_loads(scene.out, {"unknown": RIGID})
        return
    chain, known = finger_chain(scene, kinematics)
    chambers = CubicSpline(kinematics.data["time"].values, kinematics.data["pressure"].values)
    coupled = scene.motion.shapes is not None
    touches = "contact_time" in kinematics.data.attrs
    values = measured_loads(
        scene, chain, chambers, kinematics.law if coupled and touches else None, quiet
    )
    if known and (scene.pinch is None or (coupled and not touches)):
        values |= history(scene, chain, chambers, values)
    if coupled:
        values["unknown"] = HELD if touches else COUPLED
    elif known:
        around = Surroundings(gravity(scene), scene.fluid.density)
        values |= check(chain, kinematics, chambers, around, values) | {"unknown": ""}
    else:
        values["unknown"] = UNKNOWN
    write_loads(scene.out, values)
    if not quiet:
        print(f"loads: {deflection_sentence(values)}")
