"""Equal flows agree through the same virtual experiment; a stronger vortex is a model error."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from piv.images.open_recording import open_recording
from piv.vortices.find import VortexSettings
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.files import Law, Registration
from postprocess.lab.data.inputs_toml import Inputs
from postprocess.lab.data.pictures import outline_mask
from postprocess.lab.data.pose import camera_series
from postprocess.lab.data.seeding import seeding_like
from postprocess.lab.judgement.case import Case, Effect
from postprocess.lab.judgement.compare import compare, quantity_table
from postprocess.lab.judgement.validation import AGREES, ERROR
from postprocess.lab.virtual.common_grid import appearance_of, outlines_px, with_finger
from postprocess.lab.virtual.virtual_experiment import evaluate, virtual_experiment
from postprocess.lab.virtual.virtual_laboratory import make_recording
from tests.lab_scene import finger_kinematics, set_up, vortex_series

PIV = Evaluation(window=24, spacing=8, pairing="1-2,3-4", interval_s=0.002)
START, RATE = 0.10, 50.0
INPUTS = Inputs(format="inputs", format_version=1, too_uncertain=0.3)


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Results by the gain of the recording's vortex."""
    folder = tmp_path_factory.mktemp("compare")
    kinematics = finger_kinematics(folder)
    lab = set_up(kinematics, turn_deg=1.0, start=START, end=START + 0.085)
    pose = lab.pose(kinematics.root)
    ours = vortex_series(kinematics, np.linspace(0.09, 0.20, 12), spacing=2e-3)
    out = {}
    for gain in (1.0, 1.25):
        flow = vortex_series(kinematics, np.linspace(0.09, 0.20, 12), gain=gain, spacing=2e-3)
        path = make_recording(flow, lab, kinematics.root, folder / f"{gain}", RATE)
        with open_recording(str(path)) as recording:
            frames = np.arange(len(recording))
            times = START + frames // 2 / RATE + frames % 2 * 0.002
            shapes = outlines_px(kinematics, pose, kinematics.law(times))
            seen_by = times, shapes, pose, PIV
            data = evaluate(recording, frames, *seen_by, folder / f"{gain}.h5")
            images = [recording.frame(i) for i in (0, 4)]
            seen = appearance_of(images, [outline_mask(shapes[i], recording.shape) for i in (0, 4)])
        data = with_finger(data, kinematics, pose, kinematics.law(data["time"].values))
        camera = pose, lab.camera, seeding_like(seen, 8, 1.5e-3)
        piv = times, shapes, PIV, folder / f"v{gain}"
        virtual = virtual_experiment(ours, *camera, *piv, seed=77)
        virtual = with_finger(virtual, kinematics, pose, kinematics.law(virtual["time"].values))
        instants = data["time"].values
        direct = camera_series(ours, pose, data["x"].values, data["y"].values, instants)
        law = Law(np.array([1.0, 0.0, 1.0]), np.diag([1e-3, 2e-4, 1e-3]) ** 2, 0.0)
        covariance = np.diag([0.1, 0.1, 1e-3, 1e-3]) ** 2
        none = np.empty(0)
        registration = Registration(pose, covariance, 0.0, law, none, none, none, None)
        settings = VortexSettings(scale=4e-3, min_circulation=2e-4, weights="equal")
        sides = data, virtual, direct
        known = settings, 24 * pose.pixel, False, 0.0, True
        case = Case(kinematics, registration, *sides, *known)
        case.effects.append(_grid_effect(instants.size))
        out[gain] = compare(case, INPUTS)
    # a run of finer numerics that has the stronger vortex of the last recording
    circulation = by_name(out[1.25])["circulation"]
    first, last = out[1.25][0]["window_s"]
    series = out[1.25][1].set_index("time").loc[first - 1e-6 : last + 1e-6]
    lacks = float(circulation["data"][0] - series["circulation_direct"].mean())
    effect = _grid_effect(instants.size, SMALL | {"circulation": lacks}, 0.1)
    out["finer"] = compare(replace(case, effects=[effect]), INPUTS)
    return out


SMALL = {"circulation": 5e-5, "x": 1e-4, "y": 1e-4}


def _grid_effect(count, change=SMALL, per_std=1.0) -> Effect:
    """A run of finer numerics: the same change at each instant."""
    table = pd.DataFrame({name: [value] * count for name, value in change.items()})
    return Effect("grid", "numerical", "stated", per_std, table, 0.0, 0.0)


def by_name(result):
    return {q["name"]: q for q in result[0]["quantities"]}


def test_equal_flows_agree(compared):
    result, series = compared[1.0]
    assert result["verdict"] == AGREES, result["wrong"]
    assert result["wrong"] == []
    assert {"circulation_data", "circulation_virtual", "circulation_direct"} <= set(series.columns)


def test_stronger_vortex_is_a_model_error_of_its_size(compared):
    quantities = by_name(compared[1.25])
    circulation = quantities["circulation"]
    assert circulation["verdict"] == ERROR
    # E is what the simulation lacks: a fifth of the recording's, to its own 95 % band
    expected = -0.2 * circulation["data"][0]
    assert abs(circulation["error"][0] - expected) < circulation["k"] * circulation["u_val"][0]
    assert compared[1.25][0]["verdict"] == ERROR


def test_what_a_finer_run_changes_is_no_model_error(compared):
    """A run of finer numerics has the vortex of the recording: S is that run's."""
    coarse, finer = by_name(compared[1.25]), by_name(compared["finer"])
    assert coarse["circulation"]["verdict"] == ERROR
    assert finer["circulation"]["verdict"] != ERROR
    # all that E was but what PIV takes off the stronger vortex, within its own 95 % band
    circulation = finer["circulation"]
    assert abs(circulation["error"][0]) < circulation["k"] * circulation["u_val"][0]
    assert circulation["u_num"][0] == pytest.approx(0.1 * abs(circulation["finer"][0]))


def test_table_for_a_paper(compared):
    table = quantity_table(compared[1.0][0])
    assert list(table["quantity"]).count("centre") == 2
    squares = table[["u_num", "u_input", "u_D"]] ** 2
    assert np.allclose(squares.sum(axis=1), table["u_val"] ** 2, rtol=1e-6)
