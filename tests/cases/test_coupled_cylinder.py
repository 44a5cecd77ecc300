"""A cylinder on a spring in water at rest, of the same density, by whole runs one after the other.

It is a chain of one rigid slice, so long that its turn about the clamp is a displacement.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import curve_fit

from fileio.formats.bending_states import States
from pipeline.run import stage as run
from pipeline.scene.scene import load_scene
from pipeline.structure.chain import Chain, placed
from pipeline.structure.elastic_law import constant_law
from pipeline.structure.motion import Surroundings, modelled_water, motion, rates_of
from tests.conftest import prepare
from tests.studies.validation.solve import CASES, forces

pytestmark = pytest.mark.openfoam

LENGTH = 100.0  # m, of the slice: amplitudes of some cm turn it by some 1e-4 rad
DRY_PERIOD = 1.0  # s
VISCOSITY = 1e-5  # m²/s, of the scene
STEP = 0.01  # s: Houbolt's period of 141 steps is 0.1 % long
REST = 0.02  # m, where the spring draws it to: KC = 0.12, far from separation
MODEL = Surroundings(fluid=1.0, added_mass=1.0, drag=0.01)


def cylinder():
    """A cylinder of 1 m and the water's density, with a spring for DRY_PERIOD."""
    still = np.zeros((3, 5))  # at three pressures, at five points
    profile = np.stack([still + np.linspace(0, LENGTH, 5), still], axis=-1)
    mass = np.pi / 4
    stiffness = 0.5 * LENGTH * mass * LENGTH * (0.5 * LENGTH) ** 2 * (2 * np.pi / DRY_PERIOD) ** 2
    # rubber in the whole of the square section: no water in gaps; its mass is the circle's
    rubber = {"rubber_mass": mass, "rubber_section": 1.0, "rubber_height": 0.5}
    law = replace(constant_law(stiffness, 0.5, 3), **rubber)
    return Chain(States(np.array([-1.0, 0.0, 1.0]), profile, still + 1.0), law, 1.0)


def water_force(folder, time, path):
    """Force (time,) N/m of the water on the cylinder that moves as `path` (time,) m."""
    folder.mkdir()
    rows = np.column_stack([time, path])
    np.savetxt(folder / "path.csv", rows, delimiter=",", header="t,x", comments="")
    text = (CASES / "accelerating_cylinder" / "scene.toml").read_text()
    text = re.sub(r"displacement = .*", 'path_csv = "path.csv"', text)
    text = re.sub(r"end_time = [\d.]+", f"end_time = {time[-1]}", text)
    text = re.sub(r"time_step = [\d.]+", f"time_step = {STEP}", text)
    (folder / "scene.toml").write_text(text)
    scene = prepare(load_scene(folder, "tiny"))
    run.run(scene, quiet=True)
    history = forces(scene)
    return np.interp(time, np.append(0.0, history.time), np.append(0.0, history.fx))


def test_period_and_contraction(tmp_path):
    chain = cylinder()
    time = STEP * np.arange(211)  # one and a half wet periods
    pressure = np.zeros(len(time))
    weight = chain.law.rubber_mass * LENGTH
    pull = REST * weight * (2 * np.pi / DRY_PERIOD) ** 2 * np.clip(time / (4 * STEP), 0, 1)

    def path(delta):
        middle = placed(chain.unloaded(pressure), slice(None), delta).middle[:, 0].imag
        return middle - middle[0]

    delta, changes = np.zeros((len(time), 1)), []
    for number in range(3):  # the first without the solver: the model alone
        loads = np.zeros((len(time), 1, 3))
        loads[:, 0, 1] = pull
        if number:
            loads[:, 0, 1] += LENGTH * water_force(tmp_path / str(number), time, path(delta))
        else:
            loads += loads_of_model(chain, pressure, delta)
        rest = loads - loads_of_model(chain, pressure, delta)
        after = motion(chain, pressure, STEP, MODEL, rest)
        changes.append(np.abs(path(after) - path(delta)).max() / REST)
        delta = after
    # a usable coupling contracts by 0.1 a run; this mesh gives the added mass to 4 %
    assert changes[1] < 0.1 * changes[0]
    assert changes[2] < 0.1 * changes[1]
    fit, _ = curve_fit(swing, time[8:], path(delta)[8:], [REST, 2**0.5 * DRY_PERIOD, 0.1, 0.02])
    assert fit[1] / DRY_PERIOD == pytest.approx(wet_over_dry(), rel=0.01)


def loads_of_model(chain, pressure, delta):
    """The modelled water's loads (time, slice, 3) on a motion."""
    at = placed(chain.unloaded(pressure), slice(None), delta)
    rates = rates_of(at, STEP)
    force = modelled_water(chain, MODEL, at.heading, rates.velocity, rates.middle)
    force = force * np.conj(at.heading)
    return np.stack([force.real, force.imag, np.zeros(force.shape)], axis=-1)


def swing(time, rest, period, decay, late):
    """A damped oscillation about `rest`, from 0."""
    since = time - late
    return rest * (1 - np.exp(-decay * since) * np.cos(2 * np.pi * since / period))


def wet_over_dry():
    """Equal masses, added mass 1 + 4/√(πβ), β = D²/(ν T) (Stokes 1851; thin layer)."""
    ratio = 2**0.5
    for _ in range(20):
        ratio = (2 + 4 * (np.pi / (VISCOSITY * ratio * DRY_PERIOD)) ** -0.5) ** 0.5
    return ratio
