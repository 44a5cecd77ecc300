"""The study of waters with known differences: what it holds each answer against, on flows that are known in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from piv.vortices.find import VortexSettings
from postprocess.lab.data.files import NO_NUISANCE, Law, Registration
from postprocess.lab.data.inputs_toml import Input, Numerics, read_inputs
from postprocess.lab.data.pose import Pose, camera_series
from postprocess.lab.judgement.motion import final_bend
from tests.lab_scene import CASE, finger_kinematics, set_up, vortex_series
from tests.studies.laboratory import protocol
from tests.studies.laboratory.causes import TRUTHS, recording_folder
from tests.studies.laboratory.seeds import below_target, publish, share_of, spans
from tests.studies.laboratory.virtual_lab import case_of, verdicts
from tests.studies.laboratory.waters import (
    SHEETS,
    WATERS,
    missed,
    rightly_judged,
    rightly_refused,
    true_errors,
)
from tests.studies.pages import between

TIMES, SPACING = np.linspace(0.09, 0.20, 12), 2e-3
INSTANTS = np.linspace(0.10, 0.18, 5)


class Faster:
    """The finger's motion with a tenth more pressure."""

    def __init__(self, kinematics):
        self.law = lambda time: 1.1 * kinematics.law(time)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A simulation, waters that are a quarter stronger, and runs of a grid and of an input."""
    kinematics = finger_kinematics(tmp_path_factory.mktemp("waters"))
    ours = vortex_series(kinematics, TIMES, spacing=SPACING)
    strong = vortex_series(kinematics, TIMES, gain=1.25, spacing=SPACING)
    grid = Numerics(name="grid", ratio=1.5, order=2.0, safety=3.0)
    settings = VortexSettings(stencil_radius=0.004, min_circulation=2e-4, weights="equal")
    waters = {
        "none": (ours, kinematics),
        "viscous": (strong, kinematics),
        "higher": (strong, Faster(kinematics)),
    }
    return SimpleNamespace(
        kinematics=kinematics,
        sheet=ours,
        settings=settings,
        runs=[(grid, strong, kinematics)],
        water=waters.get,
    )


def case_at(lab, turn_deg):
    """A recording through a camera that is turned so far."""
    pose = set_up(lab.kinematics, turn_deg=turn_deg).pose(lab.kinematics.root)
    law = Law(np.array([1.0, 0.0, 1.0]), np.diag([1e-3, 2e-4, 1e-3]) ** 2, 0.0)
    covariance = np.diag([0.1, 0.1, 1e-3, 1e-3]) ** 2
    registration = Registration(
        pose, covariance, NO_NUISANCE, law, INSTANTS, INSTANTS, INSTANTS, None
    )
    x, y = np.arange(0.01, 0.15, 2e-3), np.arange(0.01, 0.13, 2e-3)
    direct = camera_series(lab.sheet, pose, x, y, INSTANTS)
    return case_of(lab, registration, direct, direct, direct)


def test_runs_are_seen_as_the_recording_is(lab):
    """Each through its own pose; and the pairs of a virtual experiment in pairs have particles of their own."""
    for turn in (0.0, 2.0):
        case = case_at(lab, turn)
        assert case.fresh_pairs
        (grid,) = case.effects
        own = np.stack([case.direct[n].values for n in ("u", "v")], axis=1)
        np.testing.assert_allclose(
            np.nan_to_num(grid.field), 0.25 * np.nan_to_num(own), atol=1e-7
        )  # m/s: of single precision


@pytest.mark.parametrize("kind", ["viscous", "higher"])
def test_the_true_errors_are_those_of_the_waters(lab, kind):
    case, rows = case_at(lab, 1.0), np.arange(1, 5)
    field = SimpleNamespace(
        error=np.stack([case.direct[n].values for n in ("u", "v")], axis=1)[rows]
    )
    pose: Pose = case.registration.pose
    bare = replace(case, effects=[])
    difference, of_model, law = true_errors(lab, kind, bare, field, rows, pose, 0.0)
    middle = 0.012 * (
        0.3 + 0.14
    )  # m²/s: of the simulation's vortex; a core of 6 mm holds 0.94 of it within 0.75 tip widths
    assert 0.2 * middle < difference["circulation"][0] < 0.25 * middle  # the vortex turns clockwise
    speed = np.sqrt(np.nanmean(np.sum(field.error**2, axis=1)))
    if kind == "higher":  # a finger that moves otherwise is no error of the flow model
        assert of_model["circulation"][0] == of_model["velocity_field"][0] == 0.0
        assert law[0] == pytest.approx(1.1, abs=1e-3)
        less = final_bend(lab.kinematics, 1.0) - final_bend(lab.kinematics, 1.1)
        assert of_model["final_bend"][0] == pytest.approx(less, rel=0.02)
    else:
        assert of_model["circulation"][0] == difference["circulation"][0]
        assert of_model["velocity_field"][0] == pytest.approx(0.25 * speed, rel=1e-6)
        assert of_model["final_bend"][0] == pytest.approx(0.0, abs=1e-4)
    # the run of a finer grid has the water's vortex: S is that run's, and the model's error what it was
    finer, same, _ = true_errors(lab, kind, case, field, rows, pose, 0.0)
    assert (
        abs(finer["circulation"][0]) < 0.01 * difference["circulation"][0]
    )  # single precision, at other points
    assert same["circulation"][0] == of_model["circulation"][0]


def said(name, verdict="agrees", detectable=0.1):
    return {"name": name, "joint_verdict": verdict, "detectable": detectable}


@pytest.mark.parametrize(
    "name", ["final_bend", "duration", "circulation", "centre", "velocity_field"]
)
def test_an_agreement_with_a_larger_true_error_than_was_promised_is_missed(name):
    true = {name: np.array([0.0, 0.2]) if name == "centre" else np.array([-0.2])}
    assert missed({"quantities": [said(name)]}, true) == [name]
    assert missed({"quantities": [said(name, detectable=0.3)]}, true) == []
    assert missed({"quantities": [said(name, "too uncertain", None)]}, true) == []


BLAMED = "so the flow model is to blame"


@pytest.mark.parametrize(
    "kind, motion, flow, told, unseen, right",
    [
        ("none", "agrees", "agrees", "", [], True),
        ("none", "agrees", "agrees", "", ["circulation"], False),
        ("none", "differs within the inputs", "agrees", "", [], False),
        ("none", "agrees", "model error", BLAMED, [], False),
        ("higher", "model error", "too uncertain", "", [], True),
        ("higher", "model error", "agrees", "", ["duration"], False),
        ("higher", "model error", "model error", BLAMED, [], False),
        ("slower", "agrees", "agrees", "", [], False),
        ("viscous", "agrees", "model error", BLAMED, [], True),
        ("viscous", "agrees", "model error", "", [], False),
        ("viscous", "agrees", "agrees", "", ["velocity_field"], False),
        ("larger", "agrees", "agrees", "", [], False),
    ],
)
def test_what_is_right_to_say(kind, motion, flow, told, unseen, right):
    assert rightly_judged(kind, {"motion": motion, "flow": flow}, told, unseen) is right


def test_a_refusal_has_a_reason_or_none():
    assert rightly_refused("none", ["holder"], "misfit")
    assert not rightly_refused("none", [], "misfit")
    assert rightly_refused("larger", [], "the finger's length is 3 % more")
    assert not rightly_refused("larger", [], "misfit")


def test_waters_are_not_the_runs_that_the_correction_is_made_of():
    """But for those that say so: at such a run the linear correction is exact."""
    beside = {(one.key, one.step) for one in read_inputs(CASE / "reference" / "inputs.toml").input}
    own: list[Input] = [one for one in read_inputs(WATERS).input if one.name not in SHEETS]
    assert len(own) == 4
    assert not beside & {(one.key, one.step) for one in own}


def test_refusals_are_not_counted_as_judged():
    trials = pd.DataFrame(
        {
            "set": ["none"] * 5, "seed": [1, 2, 3, 4, 7], "faults": ["none", "holder", *["none"] * 3], "refused": ["so", "so", "", "", ""],
            "motion": ["", "", *["agrees"] * 3], "flow": ["", "", "agrees", *["too uncertain"] * 2], "missed": [*[""] * 4, "circulation"],
            "right": [False, True, True, True, False],
        }
    )  # fmt: skip
    text = "\n".join(verdicts(trials, trials["refused"] != ""))
    assert "| none | 5 | 2, 1 | agrees 3 | too uncertain 2, agrees 1 | 1 | 1 | 1 |" in text
    assert "right, in motion and flow: 1 of 3, 33%" in text
    assert "undecided: **2 of 3, 67% (9–99 %)** (target 90 %); wrong: 1 of 3," in text
    assert "Motion by itself right: 3 of 3, 100%" in text
    assert "Of those refused 1 of 2, 50%" in text
    assert "what would have been found: none 7: circulation." in text
    assert "0 of 3 (target 5 %; with 95 % not above 63%)" in text
    assert spans(trials["seed"]) == "1–4, 7"


def test_what_misses_its_target_is_named():
    held = {"scale": pd.Series([True] * 15 + [False] * 5), "turn": pd.Series([True] * 19 + [False])}
    assert (
        below_target(held) == "Coverage below 90% (95 % interval): scale 15 of 20, 75% (51–91 %)."
    )
    assert share_of(pd.Series([], dtype=bool)) == "0 of 0"


def test_a_page_has_the_table_that_its_numbers_are_of(tmp_path):
    page, trials = (
        tmp_path / "comparison.md",
        pd.DataFrame({"seed": [301, 302], "factor": [0.1, 0.2]}),
    )
    page.write_text("<!-- study at smoke -->\nold\n<!-- end of study at smoke -->\n")
    publish(page, "study at smoke", "new", trials)
    assert (
        "new\nEvery recording: [study_at_smoke.csv](comparison/study_at_smoke.csv).\n"
        in page.read_text()
    )
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "comparison" / "study_at_smoke.csv"), trials
    )


def test_another_seed_or_finger_is_another_recording():
    less = TRUTHS[0]
    others = [
        (less, 1),
        (less, 2),
        (replace(less, differs=less.differs.replace("18.0", "17.0")), 1),
        (TRUTHS[1], 1),
    ]
    folders = [recording_folder(truth, "draft", seed) for truth, seed in others]
    assert (
        len({folder.name for folder in folders}) == 4
    )  # results lie in a folder of the recording's name
    assert folders[0].parent == folders[1].parent  # one run of the solver for both seeds


def test_the_protocol_says_what_the_comparisons_tables_say():
    """A table that is renewed renews it: by python -m tests.studies.laboratory.protocol."""
    assert (
        between(protocol.DOCS / "lab_protocol.md", "seen")
        == f"{protocol.summary(protocol.DOCS / 'comparison.md')}\n"
    )


def test_what_a_verdict_can_see_follows_from_the_tables(tmp_path):
    page = tmp_path / "comparison.md"
    found = "\n".join(f"| {name} | {k}% | grid |" for k, name in enumerate(protocol.SEEN))
    page.write_text(
        "<!-- study at smoke -->\n| registration (8 recordings) | target | RMS error |\n|---|---|---|\n| pressure factor |  | 0.002 |\n"
        f"| duration factor |  | 0.004 |\n| circulation, cm²/s | 3.4 | 5 | 100% |\n{found}\n<!-- end of study at smoke -->\n"
        "<!-- study at coarse -->\n<!-- end of study at coarse -->\n"
    )
    text = protocol.summary(page)
    assert "(8 recordings at smoke) | 4.3 times that" in text
    assert "| pressure by the bend | 0.2 % (RMS error) | 0.9 % |" in text
    assert "| circulation | 5 cm²/s (mean u_D of five instants) | 22 cm²/s |" in text
    assert text.endswith("| smoke | 0% | 1% | 2% | 3% | 4% |")
