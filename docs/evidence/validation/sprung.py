"""A cylinder on a spring in still water of its own density, moved by spring and water in one run.

It is a chain of one rigid slice, so long that its turn about the clamp is a displacement. The foot
of the spring is moved, as a pressure moves a finger's shape without load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
from scipy.optimize import curve_fit

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import CASES, provenance
from pipeline.case import stage as case
from pipeline.couple import motion as coupled
from pipeline.couple import stage as run
from pipeline.formats.bending_states import States
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.kinematics import stage as kinematics
from pipeline.kinematics.pressure_law import smooth_step
from pipeline.kinematics.rigid_body import rest_outline
from pipeline.mesh import stage as mesh
from pipeline.scene.scene import Scene, load_scene
from pipeline.structure.chain import Chain
from pipeline.structure.elastic_law import constant_law
from pipeline.structure.finger import ElasticFinger
from pipeline.structure.motion import Surroundings

NAME = "sprung_cylinder"
LENGTH = 100.0  # m, of the slice: amplitudes of some cm turn it by some 1e-4 rad
DRY_PERIOD = 1.0  # s
REST = 0.02  # m, by which the foot of the spring is moved
RISE = 0.3  # s, of the foot
FRAME = np.array([[0.0, -1.0], [1.0, 0.0]])  # the slice points downwards, and moves along x


def cylinder(density: float) -> Chain:
    """A cylinder of 1 m and the water's density, with a spring for DRY_PERIOD."""
    along, still = np.linspace(0, LENGTH, 5), np.zeros((3, 5))
    turned = np.array([-1.0, 0.0, 1.0]) * REST / (0.5 * LENGTH)
    profile = np.stack([still + along, np.outer(turned, along)], axis=-1)
    mass = np.pi / 4 * density
    stiffness = 0.5 * LENGTH * mass * (0.5 * LENGTH) ** 2 * (2 * np.pi / DRY_PERIOD) ** 2
    # rubber in the whole of the square section: no water in gaps; its mass is the circle's
    spring = constant_law(stiffness, 0.5, 3)
    law = replace(spring, rubber_mass=mass / LENGTH, rubber_section=1.0, rubber_height=0.5)
    return Chain(States(np.array([-1.0, 0.0, 1.0]), profile, still + 1.0), law, 1.0)


@dataclass(frozen=True)
class Circle:
    """In place of a finger's shape: the body's circle, displaced as the middle of the slice."""

    rest: np.ndarray

    def outline_of(self, profile: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Closed outline (point, 2) m in the tank, of the slice's profile (point, 2)."""
        along, across = profile[-1] - profile[-2]
        return self.rest + 0.5 * LENGTH * np.arctan2(across, along) * FRAME[1]


def _foot(time: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Place of the spring's foot over REST."""
    return smooth_step(time / RISE, derivative) / RISE**derivative


def solve(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and displacement (m) of the cylinder of a scene."""
    assert scene.body is not None
    centre, density = np.asarray(scene.body.centre), scene.fluid.density
    chain, water = cylinder(density), Surroundings(fluid=density)
    finger = ElasticFinger(
        chain=chain,
        chambers=_foot,
        frame=FRAME,
        root=centre - 0.5 * LENGTH * FRAME[0],
        water=water,
        model=water,
        air=water,
        known=True,
    )
    circle = Circle(rest_outline(scene.body) + centre)
    scene.out.mkdir(parents=True, exist_ok=True)
    kinematics.run(scene, quiet=True)
    with (
        patch.object(Scene, "coupled", property(lambda _: True)),
        patch.object(coupled.ElasticFinger, "of", lambda _: finger),
        patch.object(coupled, "finger_motion", lambda *_: circle),
    ):
        for stage in (mesh, case, run):
            stage.run(scene, quiet=True)
    file = read_elastic_motion(scene.out / FILE)
    turn = chain.bend(file["pressure"].values, file["delta"].values)
    return file["time"].values, 0.5 * LENGTH * turn


def swing(time, rest, swung, period, decay, late):
    """A damped oscillation about `rest`; a foot that takes time swings it by less than the rest."""
    since = time - late
    return rest - swung * np.exp(-decay * since) * np.cos(2 * np.pi * since / period)


def fitted(time: np.ndarray, path: np.ndarray) -> tuple[float, float]:
    """Wet period (s), and logarithmic decrement."""
    free = time > RISE + 0.05
    start = [REST, REST, 2**0.5 * DRY_PERIOD, 0.1, RISE / 2]
    fit, _ = curve_fit(swing, time[free], path[free], start)
    return float(fit[2]), float(fit[3] * fit[2])


def theory(viscosity: float) -> tuple[float, float]:
    """Wet period (s) and decrement: equal masses, and the thin layer at the wall (Stokes 1851).

    Added mass 1 + 4/√(πβ), drag in phase with the velocity 4/√(πβ) + 4/(πβ), β = D²/(ν T).
    """
    period = 2**0.5 * DRY_PERIOD
    for _ in range(20):
        beta = 1 / (viscosity * period)
        total = 2 + 4 * (np.pi * beta) ** -0.5
        period = total**0.5 * DRY_PERIOD
    lost = 4 * (np.pi * beta) ** -0.5 + 4 / (np.pi * beta)
    return float(period), float(np.pi * lost / total)


def measure() -> Result:
    """The wet period against theory."""
    scene = load_scene(CASES / NAME, "coarse")
    time, path = solve(scene)
    (period, decrement), (wanted, lost) = (
        fitted(time, path),
        theory(scene.fluid.kinematic_viscosity),
    )
    source = "Stokes 1851: added mass and thin layer of a cylinder"
    checks = (
        Check("sprung.period", "wet period over dry period", period / DRY_PERIOD, 0.01, "relative",
              "2 % of the mass of cylinder and water: the time step alone is 0.1 %",
              wanted / DRY_PERIOD, source),
        Check("sprung.decrement", "logarithmic decrement", decrement, 0.2, "relative",
              "theory of a steady oscillation; a fifth is 0.3 % of the amplitude a cycle",
              lost, source),
    )  # fmt: skip
    return Result(NAME, scene.title, checks, provenance=provenance(scene))
