"""The page's first sentences: evidence, blame, missing runs; from results made up by hand."""

import numpy as np
import pytest

from postprocess.lab.judgement.compare import flow_verdict, motion_verdict, overall_verdict
from postprocess.lab.report import answers
from postprocess.words import pair, size


def quantity(
    name,
    error,
    u_val,
    verdict="agrees",
    explained=None,
    unit="m²/s",
    scale=1e-2,
    detectable=0.1,
    differs=False,
):
    """A judged quantity as in comparison.json; `detectable`: over its scale."""
    return {
        "name": name,
        "label": name.replace("_", " "),
        "unit": unit,
        "window": None,
        "simulation": [scale + error],
        "data": [scale],
        "error": [error],
        "u_val": [u_val],
        "u_D": [u_val / 10],
        "k": 1.96,
        "scale": scale,
        "verdict": verdict,
        "dominant": "grid",
        "detectable": detectable * scale,
        "differs": differs,
        "sources": [{"name": "grid", "kind": "numerical", "std": [u_val], "how": ""}],
        "explained_by_motion": None if explained is None else [explained],
    }


def result(*quantities, wrong=(), missing=()):
    """comparison.json as far as the wording reads it; the answers are those of `compare`."""
    law = {"pressure_factor": 1.05, "pressure_factor_std": 0.003}
    law |= {"stretch": 1.0, "stretch_std": 0.004}
    judged = list(quantities)
    motion, flow = motion_verdict(judged), flow_verdict(judged)
    return {
        "verdict": overall_verdict(motion, flow),
        "motion": motion,
        "flow": flow,
        "too_uncertain": 0.3,
        "wrong": list(wrong),
        "quantities": judged,
        "missing_runs": list(missing),
        "registration": law,
    }


BEND = quantity("final_bend", -0.078, 0.012, "model error", unit="rad", scale=1.6)
STRAIGHT = quantity("final_bend", 0.004, 0.012, unit="rad", scale=1.6, detectable=0.03)
LONGER = quantity("duration", -0.02, 0.023, unit="s", scale=0.22, differs=True)
UNSURE = quantity("final_bend", 0.1, 0.4, "too uncertain", unit="rad", scale=1.6, detectable=0.9)
SAME = quantity("circulation", -2e-4, 3e-4, explained=-2e-4)
WRONG = quantity("circulation", -2e-3, 3e-4, "model error", explained=-2e-4)
BARE = WRONG | {"explained_by_motion": None}
WIDE = quantity("circulation", -2e-4, 3e-3, "too uncertain", detectable=1.1)
PLACE = quantity("centre", 1e-3, 1e-3, unit="m", scale=0.0167, detectable=0.2)


def test_a_motion_that_is_to_blame_is_named_with_what_it_does_to_the_flow():
    text = answers.answer(result(BEND, SAME, wrong=["final_bend"]))
    assert text.startswith("Motion: no. Flow: yes. Final bend: the motion differs by about −4.47")
    assert "The motion is to blame" in text
    assert "5.0\u00a0% higher" in text
    assert "as PIV shows them, which is taken out: circulation -2\u00a0%" in text


def test_without_runs_nothing_is_said_to_follow_from_the_motion():
    runs, wrong = ["pressure", "duration"], ["final_bend", "circulation"]
    text = answers.answer(result(BEND, BARE, wrong=wrong, missing=runs))
    assert "is not known without the runs pressure and duration" in text
    assert "taken out" not in text
    assert "Whether motion or flow model is to blame is not known" in text


def test_a_stroke_that_the_registration_knows_better_than_the_input_is_no_green_yes():
    """10 % longer, and the input's band of ± 0.04 s would swallow it."""
    made = result(STRAIGHT, LONGER, SAME)
    text = answers.answer(made)
    assert made["verdict"] == "differs within the inputs"
    assert text.startswith("Motion: no, but within what is known of the inputs. Flow: yes.")
    assert "duration 200\u00a0ms against 220\u00a0ms (9%), which the registration knows to" in text
    assert "final bend" not in text.split("The flow")[0]


@pytest.mark.parametrize(
    "quantities, blamed",
    [
        ([STRAIGHT, BARE], "The finger moves as simulated, so the flow model is to blame"),
        ([STRAIGHT, WRONG], "At the recording's own motion the flow differs (circulation): the fl"),
        ([WRONG], "Vectors do not show the finger"),
    ],
)
def test_a_wrong_flow_is_blamed_on_what_was_tested(quantities, blamed):
    assert blamed in answers.answer(result(*quantities, wrong=["circulation"]))


@pytest.mark.parametrize("motion", [UNSURE, LONGER])
def test_without_runs_a_flow_is_not_blamed_where_the_motion_may_be(motion):
    text = answers.answer(result(motion, BARE, wrong=["circulation"]))
    assert "Whether motion or flow model is to blame is not known" in text
    assert "the flow model is to blame" not in text


def test_yes_names_the_runs_that_u_val_lacks():
    text = answers.answer(result(STRAIGHT, SAME, missing=["grid", "time_step"]))
    assert text.startswith("Motion: yes. Flow: yes. ")
    assert "these runs were not made: grid, time_step" in text


def test_a_flow_that_could_err_by_a_third_unseen_cannot_be_said():
    """However many other quantities are decided."""
    made = result(STRAIGHT, PLACE, WIDE)
    text = answers.answer(made)
    assert made["verdict"] == "too uncertain"
    assert text.startswith("Motion: yes. Flow: cannot be said.")
    assert "circulation (errors above 110\u00a0% would be found, mostly grid)" in text
    assert "98\u00a0cm²/s" not in text  # an undecided quantity is no evidence


def test_rows_of_the_table_hold_both_components():
    centre = quantity("centre", 0.0, 1.0, unit="m") | {"error": np.array([3e-4, 4e-4])}
    assert pair(centre["error"], "m") == "(0.30, 0.40)\u00a0mm"
    assert size(centre["error"], "m") == "0.5\u00a0mm"
