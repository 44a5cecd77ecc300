"""The page's first sentences: what they rest on, what is to blame, what is missing; from results made up by hand."""

import numpy as np
import pytest

from postprocess.lab.report import wording


def quantity(name, error, u_val, verdict="agrees", explained=None, unit="m²/s", scale=1e-2):
    """A judged quantity as in comparison.json."""
    return {
        "name": name, "label": name.replace("_", " "), "unit": unit, "simulation": [scale + error], "direct": [scale], "data": [scale],
        "error": [error], "u_val": [u_val], "k": 1.96, "scale": scale, "verdict": verdict, "dominant": "grid",
        "explained_by_motion": None if explained is None else [explained],
    }  # fmt: skip


def result(*quantities, wrong=(), missing=(), measured=False):
    """comparison.json as far as the wording reads it."""
    verdict = "model error" if wrong else "agrees"
    if not wrong and all(q["verdict"] == "too uncertain" for q in quantities):
        verdict = "too uncertain"
    law = {"pressure_factor": 1.05, "pressure_factor_std": 0.003, "stretch": 1.0, "stretch_std": 0.004}
    return {
        "verdict": verdict, "wrong": list(wrong), "quantities": list(quantities), "missing_runs": list(missing),
        "measured_motion": measured, "registration": law,
    }  # fmt: skip


BEND = quantity("final_bend", -0.078, 0.012, "model error", unit="rad", scale=1.6)
STRAIGHT = quantity("final_bend", 0.004, 0.012, unit="rad", scale=1.6)
SAME = quantity("circulation", -2e-4, 3e-4, explained=-2e-4)
WRONG = quantity("circulation", -2e-3, 3e-4, "model error", explained=-2e-4)
WIDE = quantity("circulation", -2e-4, 3e-3, "too uncertain")


def test_a_verdict_by_the_silhouette_says_so():
    told = wording.answer(result(BEND, SAME, wrong=["final_bend"]))
    assert told.startswith("No: final bend: the motion differs by about -4.47\u00a0° (5%)")
    assert "rests on the finger's silhouette, not on the flow" in told
    assert "The motion is to blame" in told
    assert "5.0\u00a0% higher" in told
    assert "make compare-measured" in told


def test_without_runs_nothing_is_said_to_follow_from_the_motion():
    unknown = WRONG | {"explained_by_motion": None}
    told = wording.answer(
        result(BEND, unknown, wrong=["final_bend", "circulation"], missing=["pressure", "duration"])
    )
    assert "is not known without the runs pressure and duration" in told
    assert "follows from that motion within" not in told


def test_a_flow_that_differs_beyond_the_motion_is_told():
    told = wording.answer(result(BEND, WRONG, wrong=["final_bend", "circulation"]))
    assert "not on the flow" not in told
    assert "Beyond the motion the flow differs (circulation)" in told


@pytest.mark.parametrize(
    "quantities, measured, blamed",
    [
        ([STRAIGHT, WRONG], False, "The finger moves as simulated, so the flow model is to blame"),
        ([WRONG], True, "driven by this recording's own motion"),
        ([WRONG], False, "Vectors do not show the finger"),
    ],
)
def test_a_wrong_flow_is_blamed_on_what_was_tested(quantities, measured, blamed):
    assert blamed in wording.answer(result(*quantities, wrong=["circulation"], measured=measured))


def test_yes_gives_the_band_and_what_u_val_lacks():
    told = wording.answer(result(STRAIGHT, SAME, missing=["grid", "time_step"]))
    assert told.startswith("Yes: ")
    assert "5.88" in told  # 1.96 of 3 cm²/s
    assert "these runs were not made: grid, time_step" in told


def test_what_is_undecided_names_its_source():
    told = wording.answer(result(WIDE))
    assert told.startswith("It cannot be said")
    assert "circulation (mostly grid)" in told


def test_a_single_limit_passed_may_be_chance():
    alone = quantity("core_radius", -7e-4, 3e-4, "model error", unit="m", scale=5e-3)
    told = wording.answer(result(STRAIGHT, SAME, alone))
    assert told.startswith("Yes: ")
    assert "core radius; among 3 quantities that may be chance" in told


def test_rows_of_the_table_hold_both_components():
    centre = quantity("centre", 0.0, 1.0, unit="m") | {"error": np.array([3e-4, 4e-4])}
    assert wording.pair(centre["error"], "m") == "(0.30, 0.40)\u00a0mm"
    assert wording.size(centre["error"], "m") == "0.5\u00a0mm"
