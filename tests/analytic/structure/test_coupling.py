"""Coupling by whole runs, with a known water: what it converges to, how fast, its faults."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from fileio.errors import StageError
from fileio.formats.bending_states import read
from fileio.formats.elastic_motion import write_elastic_motion
from fileio.formats.kinematics import read_kinematics
from pipeline.kinematics.pressure_law import stroke_law
from pipeline.kinematics.stage import run as run_kinematics
from pipeline.scene.scene import load_scene
from pipeline.scene.sections import Structure
from pipeline.structure.chain import Chain
from pipeline.structure.coupling import (
    check_change,
    loads_at,
    loads_of_model,
    motion_values,
    next_delta,
)
from pipeline.structure.motion import Surroundings, motion

CASE = Path(__file__).parents[3] / "cases" / "single_finger"
STATES = read(CASE / "kinematics" / "states.h5")
STEP = 2e-3  # s: the test's own; errors of time are the same on both sides
TIME = STEP * np.arange(121)
PRESSURE = stroke_law(0.0, [(20e3, 0.005, 0.2)])(TIME)
TRUTH = Surroundings(9.81, 998.2, 0.87, 2.2, 0.004)  # near what the solver's water does
MODEL = Surroundings(9.81, 998.2, Structure().added_mass, Structure().drag, Structure().damping)


@pytest.fixture(scope="module")
def chain():
    return Chain(STATES, STATES.law, STATES.width)


@pytest.fixture(scope="module")
def wanted(chain):
    return motion(chain, PRESSURE, STEP, TRUTH, np.zeros((len(TIME), chain.slices, 3)))


@pytest.mark.parametrize("start", ["prescribed", "too far"])
def test_runs_converge_to_the_coupled_motion_from_either_side(chain, wanted, start):
    """Half the error or less with each run: the model is 50 % heavier, with twice the drag."""
    delta = 0 * wanted if start == "prescribed" else 2 * wanted
    errors = []
    for _ in range(5):
        computed = loads_of_model(chain, PRESSURE, delta, STEP, TRUTH)
        delta = next_delta(chain, PRESSURE, STEP, MODEL, delta, computed)
        errors.append(np.degrees(np.abs(delta - wanted)[:, -1].max()))
    assert errors[0] < 20  # of the 40° that the water holds back
    assert errors[-1] < 1
    assert errors[-1] < 0.5**4 * errors[0]


def test_the_model_leaves_no_trace_in_the_coupled_motion(chain, wanted):
    computed = loads_of_model(chain, PRESSURE, wanted, STEP, TRUTH)
    again = next_delta(chain, PRESSURE, STEP, MODEL, wanted, computed)
    # Newton's tolerance of 1e-10 rad a step, over 120 steps of a stiff chain
    assert np.abs(again - wanted).max() < 1e-6


def test_growing_changes_stop_with_a_sentence():
    where = Path("scene.toml")
    assert not check_change([5e-3], 1e-3, where)
    assert check_change([5e-3, 9e-4], 1e-3, where)
    with pytest.raises(
        StageError, match=r"diverges: .* 5 mm and then by 6 mm; raise structure\.added_mass"
    ):
        check_change([5e-3, 6e-3], 1e-3, where)


def test_loads_of_a_run_at_the_times_of_the_structure():
    time = np.array([0.002, 0.004, 0.006, 0.008])
    force = np.ones((4, 3, 2)) * time[:, None, None]
    loads = xr.Dataset(
        {"time": ("time", time), "force": (("time", "slice", "axis"), force),
         "torque": (("time", "slice"), 2 * force[..., 0])}
    )  # fmt: skip
    sampled_loads = loads_at(loads, np.array([0.0, 0.001, 0.005]))
    assert sampled_loads.shape == (3, 2, 3)  # without the clamped length
    np.testing.assert_allclose(
        sampled_loads[:, 0], [[0, 0, 0], [1e-3, 1e-3, 2e-3], [5e-3, 5e-3, 1e-2]], atol=1e-12
    )


def test_motion_without_elastic_turns_moves_the_mesh_as_the_prescribed_one(chain, tmp_path):
    """Shapes over time in place of pressure: within 10 µm, a tenth of the finest wall layer."""
    time = 1e-3 * np.arange(421)
    pressure = stroke_law(0.0, [(20e3, 0.005, 0.4)])(time)
    values = motion_values(chain, time, pressure, np.zeros((421, chain.slices)), None)
    write_elastic_motion(tmp_path / "m.h5", values | {"made_of": ""})
    text = f'extends = "{CASE}"\n[motion]\nsource = "structure"\nshapes = "m.h5"\n'
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "scene.toml").write_text(f'extends = "{CASE}"\n')
    motions = []
    for folder in (tmp_path, tmp_path / "plain"):
        scene = load_scene(folder, "smoke")
        scene.out.mkdir(parents=True)
        run_kinematics(scene, quiet=True)
        motions.append(read_kinematics(scene.out / "kinematics.h5"))
    over_time, plain = motions
    assert over_time.data["shape_parameter"].attrs["units"] == "s"
    np.testing.assert_allclose(over_time.data["pressure"], plain.data["pressure"], atol=1e-6)
    for at in np.linspace(0, 0.42, 85):
        one, other = over_time.at(at), plain.at(at)
        assert np.abs(one["outline"] - other["outline"]).max() < 1e-5
        # 1 % of the peak tip speed of 0.28 m/s
        assert np.abs(one["outline_velocity"] - other["outline_velocity"]).max() < 3e-3
