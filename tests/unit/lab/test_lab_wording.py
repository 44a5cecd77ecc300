"""The page's first sentences: evidence, blame, missing runs; from results made up by hand."""

import numpy as np
import pytest

from postprocess.lab.page import answer
from postprocess.lab.validation import AGREES, DIFFERS, ERROR, UNCERTAIN, verdicts
from postprocess.words import pair, size


def quantity(
    name,
    error,
    u_val,
    verdict=AGREES,
    explained=None,
    unit="m²/s",
    scale=1e-2,
    detectable=0.1,
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
        "finer": None,
        "explained": None if explained is None else [explained],
    }


def result(*quantities, missing=(), at_pressure=None):
    """comparison.json as far as the wording reads it."""
    law = {"pressure_factor": 1.05, "pressure_factor_std": 0.003}
    law |= {"stretch": 1.0, "stretch_std": 0.004}
    return {
        **verdicts(list(quantities)),
        "quantities": list(quantities),
        "missing_runs": list(missing),
        "registration": law,
        "at_pressure": at_pressure,
        "pressure_unused": False,
        "no_flow": "",
        "no_load": "The moment of the water is not compared.",
    }


BEND = quantity("final_bend", -0.078, 0.012, ERROR, unit="rad", scale=1.6)
STRAIGHT = quantity("final_bend", 0.004, 0.012, unit="rad", scale=1.6, detectable=0.03)
LONGER = quantity("duration", -0.02, 0.023, DIFFERS, unit="s", scale=0.22)
UNSURE = quantity("final_bend", 0.1, 0.4, UNCERTAIN, unit="rad", scale=1.6, detectable=0.9)
SAME = quantity("circulation", -2e-4, 3e-4, explained=-2e-4)
WRONG = quantity("circulation", -2e-3, 3e-4, ERROR, explained=-2e-4)
BARE = WRONG | {"explained": None}
WIDE = quantity("circulation", -2e-4, 3e-3, UNCERTAIN, detectable=1.1)
PLACE = quantity("centre", 1e-3, 1e-3, unit="m", scale=0.0167, detectable=0.2)


def test_a_motion_that_is_to_blame_is_named():
    text = answer(result(BEND, SAME))
    assert text.startswith("Motion: no. Flow: yes. Final bend: the motion differs by about −4.47")
    assert "The motion is to blame" in text
    assert "bends as at 1.050 ±\u00a00.006 times the pressure" in text
    assert "frame_rate_hz" not in text  # the stroke lasts as long as simulated


@pytest.mark.parametrize(
    "made, said",
    [
        (STRAIGHT, "has 91.9\u00a0° (final bend), as the recording: pressure and water explain it"),
        (BEND, "has 87.2\u00a0° (final bend), unlike the recording: the structure is to blame"),
    ],
)
def test_a_run_at_the_measured_pressure_tells_pressure_from_structure(made, said):
    text = answer(result(BEND, SAME, at_pressure=[made]))
    assert f"With the measured pressure a coupled run {said}" in text
    assert "Correct motion.strokes" not in text


def test_a_flow_that_is_not_compared_says_why():
    made = result(BEND, at_pressure=[BEND]) | {"no_flow": "the water contradicts the clock"}
    text = answer(made)
    assert "the structure or the clock is to blame" in text
    assert text.endswith("The flow is not compared: the water contradicts the clock.")


def test_a_measured_pressure_that_no_run_took_is_named():
    text = answer(result(BEND, SAME) | {"pressure_unused": True})
    assert "needs a coupled run at the measured pressure: compare at LEVEL=draft" in text


def test_a_stroke_that_the_registration_knows_better_than_the_input_is_no_green_yes():
    """10 % longer, and the input's band of ± 0.04 s would swallow it."""
    made = result(STRAIGHT, LONGER, SAME)
    made["registration"]["stretch"] = 1.1
    text = answer(made)
    assert made["verdict"] == DIFFERS
    assert text.startswith("Motion: no, but within what is known of the inputs. Flow: yes.")
    assert (
        "Duration: differs by −20\u00a0ms (9\u00a0%), known to ±\u00a04.51\u00a0ms, which the"
        in text
    )
    assert "Correct motion.strokes of the scene, or frame_rate_hz of dpiv.toml" in text
    assert "inal bend" not in text
    [quick] = [answer(result(STRAIGHT, LONGER))]
    assert "Flow: not tested." in quick
    assert "The flow" not in quick


@pytest.mark.parametrize(
    "quantities, blamed",
    [
        ([STRAIGHT, BARE], "at the recording's own motion: the flow model is to blame"),
        ([LONGER, WRONG], "at the recording's own motion: the flow model is to blame"),
        ([WRONG], "Vectors do not show the finger"),
    ],
)
def test_a_wrong_flow_is_blamed_on_what_was_tested(quantities, blamed):
    assert blamed in answer(result(*quantities))


@pytest.mark.parametrize("motion", [UNSURE, LONGER, BEND])
def test_without_runs_a_flow_is_not_blamed_where_the_motion_may_be(motion):
    text = answer(result(motion, BARE))
    assert "Whether motion or flow model is to blame is not known" in text
    assert "the flow model is to blame" not in text


def test_yes_names_the_runs_that_u_val_lacks():
    text = answer(result(STRAIGHT, SAME, missing=["grid", "time_step"]))
    assert text.startswith("Motion: yes. Flow: yes. ")
    assert "these runs were not made: grid, time_step" in text


def test_a_flow_that_could_err_by_a_third_unseen_cannot_be_said():
    """However many other quantities are decided."""
    made = result(STRAIGHT, PLACE, WIDE)
    text = answer(made)
    assert made["verdict"] == UNCERTAIN
    assert text.startswith("Motion: yes. Flow: cannot be said.")
    assert "circulation (errors above 110\u00a0% would be found, mostly grid)" in text
    assert "98\u00a0cm²/s" not in text  # an undecided quantity is no evidence


def test_rows_of_the_table_hold_both_components():
    centre = quantity("centre", 0.0, 1.0, unit="m") | {"error": np.array([3e-4, 4e-4])}
    assert pair(centre["error"], "m") == "(0.30, 0.40)\u00a0mm"
    assert size(centre["error"], "m") == "0.5\u00a0mm"
