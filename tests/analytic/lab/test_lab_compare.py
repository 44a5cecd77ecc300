"""Equal flows agree through the same virtual experiment; a stronger vortex is a model error."""

import numpy as np
import pytest

from docs.evidence.lab_renderer import Filmed
from piv.vortices.find import VortexSettings
from postprocess.lab.dpiv_toml import Evaluation
from postprocess.lab.flow import with_flow
from postprocess.lab.motion import Comparison
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.register import Law, Registration
from postprocess.lab.summary import compare
from postprocess.lab.validation import AGREES, ERROR, joint_level, judged, verdicts
from postprocess.lab.virtual_experiment import (
    MaskedRecording,
    MovedRecording,
    Sides,
    evaluate,
    outlines_px,
    with_finger,
)
from tests.lab_scene import finger_kinematics, vortex_series

PIV = Evaluation(window=24, spacing=8, pairing="1-2,3-4", interval_s=0.002)
SHAPE, FRAMES = (320, 400), np.arange(10)
TIMES = 0.10 + FRAMES // 2 / 50.0 + FRAMES % 2 * 0.002


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Results by the gain of the recording's vortex."""
    folder = tmp_path_factory.mktemp("compare")
    kinematics = finger_kinematics(folder)
    pose = Pose(0.404, np.radians(1.0), kinematics.root, (152.5, 268.5))
    shapes = outlines_px(kinematics, pose, kinematics.law(TIMES))
    clock, out = np.linspace(0.09, 0.20, 12), {}
    ours = vortex_series(kinematics, clock, spacing=2e-3)
    for gain in (1.0, 1.25):
        flow = vortex_series(kinematics, clock, gain=gain, spacing=2e-3)
        seen = kinematics, pose, kinematics.law(TIMES), SHAPE
        recording = Filmed(*seen, flow=flow, times=TIMES)
        frames = MaskedRecording(recording, FRAMES, TIMES, shapes, pose)
        data = evaluate(frames, PIV, folder / f"{gain}.h5")
        data = with_finger(data, kinematics, pose, kinematics.law(data["time"].values))
        moved = MovedRecording(recording, FRAMES[::2], TIMES, shapes, pose, sheet=ours)
        virtual = evaluate(moved, PIV, folder / f"v{gain}.h5")
        virtual = with_finger(virtual, kinematics, pose, kinematics.law(virtual["time"].values))
        x, y, instants = (data[name].values for name in ("x", "y", "time"))
        direct = camera_series(ours, pose, x, y, instants)
        law = Law(np.array([1.0, 0.0, 1.0]), np.diag([1e-3, 2e-4, 1e-3]) ** 2)
        none, covariance = np.empty(0), np.diag([0.1, 0.1, 1e-3, 1e-3]) ** 2
        registration = Registration(pose, covariance, 0.0, law, none, none, pose)
        settings = VortexSettings(scale=4e-3, min_circulation=2e-4, weights="equal")
        sides = Sides(data, virtual, direct, settings, 24 * pose.pixel)
        out[gain] = judged_of(with_flow(Comparison(kinematics, registration, 0.0), sides, {}))
    return out


def judged_of(case):
    """Quantities as comparison.json has them, with the verdict, and the series."""
    made = compare(None, case)
    rows = [judged(q, joint_level(2)) for q in made.quantities]
    return {"quantities": rows, **verdicts(rows)}, made.series


def by_name(result):
    return {q["name"]: q for q in result[0]["quantities"]}


def test_equal_flows_agree(compared):
    result, series = compared[1.0]
    assert result["verdict"] == AGREES, by_name(compared[1.0])
    assert {"circulation_data", "circulation_virtual", "circulation_direct"} <= set(series.columns)


def test_stronger_vortex_is_a_model_error_of_its_size(compared):
    quantities = by_name(compared[1.25])
    circulation = quantities["circulation"]
    assert circulation["verdict"] == ERROR
    # E is what the simulation lacks: a fifth of the recording's, to its own 95 % band
    expected = -0.2 * circulation["data"][0]
    assert abs(circulation["error"][0] - expected) < circulation["k"] * circulation["u_val"][0]
    assert compared[1.25][0]["verdict"] == ERROR
