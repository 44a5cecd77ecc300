"""The page's first sentences: evidence, blame, missing runs; from results made up by hand."""

import pytest

from postprocess.lab.page import answer
from postprocess.lab.validation import AGREES, DIFFERS, ERROR, LEVEL_ERROR, UNCERTAIN, verdicts
from postprocess.words import pair, size


def quantity(
    name, error, u_val, verdict=AGREES, moved=None, unit="m²/s", scale=1e-2, found=0.1
):  # fmt: skip
    """A judged quantity as in comparison.json; `found`: detectable error over its scale."""
    values = {
        "error": [error],
        "data": [scale],
        "u_val": [u_val],
        "u_D": [u_val / 10],
        "u_input": [u_val],
    }
    words = {"name": name, "label": name.replace("_", " "), "unit": unit, "dominant": "grid"}
    limits = {"k": 1.96, "scale": scale, "verdict": verdict, "detectable": found * scale}
    return values | words | limits | {"moved": None if moved is None else [moved]}


def result(*quantities, missing=()):
    """comparison.json as far as the wording reads it."""
    law = {"pressure_factor": 1.05, "pressure_factor_std": 0.003}
    law |= {"stretch": 1.0, "stretch_std": 0.004}
    return {
        **verdicts(list(quantities)),
        "quantities": list(quantities),
        "not_varied": list(missing),
        "registration": law,
        "all_water": None,
        "plane": True,
        "coupled": False,
        "level": "smoke",
        "levels": {"smoke": {}},
    }


BEND = quantity("final_bend", -0.078, 0.012, ERROR, unit="rad", scale=1.6)
STRAIGHT = quantity("final_bend", 0.004, 0.012, unit="rad", scale=1.6, found=0.03)
LONGER = quantity("duration", -0.02, 0.023, DIFFERS, unit="s", scale=0.22)
UNSURE = quantity("final_bend", 0.1, 0.4, UNCERTAIN, unit="rad", scale=1.6, found=0.9)
SAME = quantity("circulation", -2e-4, 3e-4, moved=-2e-4)
WRONG = quantity("circulation", -2e-3, 3e-4, ERROR, moved=-2e-4)
BARE = WRONG | {"moved": None}
WIDE = quantity("circulation", -2e-4, 3e-3, UNCERTAIN, found=1.1)
PLACE = quantity("centre", 1e-3, 1e-3, unit="m", scale=0.0167, found=0.2)


def test_a_motion_that_is_to_blame_is_named():
    text = answer(result(BEND, SAME))
    assert text.startswith("Motion: no. Flow: yes. Final bend: the motion differs by about 4.47")
    assert "The motion is to blame" in text
    assert "bends as at 1.050 ±\u00a00.006 times the pressure" in text
    assert "frame_rate_hz" not in text  # the stroke lasts as long as simulated
    assert "COUPLED=1" in text
    assert "COUPLED=1" not in answer(result(BEND, SAME) | {"coupled": True})


def test_a_level_whose_own_error_hides_the_flow_names_the_level_that_decides():
    """Level smoke of single_finger: 32 % of the circulation."""
    wide = WIDE | {"dominant": LEVEL_ERROR}
    made = result(STRAIGHT, wide) | {"levels": {"smoke": {"circulation": 0.32}}}
    assert "is a plane flow, and its own numerical error hides" in answer(made)
    made["levels"] |= {"draft": {"circulation": 0.12}, "coarse": {"circulation": 0.02}}
    assert "compare at LEVEL=coarse or finer (errors above 8\u00a0% would be found)" in answer(made)
    made["levels"] |= {"coarse": {"circulation": 0.12}}
    assert "no level whose error was measured decides it" in answer(made)


def test_water_that_is_slower_at_every_instant_points_to_the_interval_first():
    made = result(STRAIGHT, BARE) | {"all_water": 0.84}
    text = answer(made)
    first = text.index(
        "All water moves 0.84 times as fast as the simulation's at every instant: check"
    )
    assert first < text.index("the flow model is to blame")


def test_a_stroke_that_the_registration_knows_better_than_the_input_is_no_green_yes():
    """10 % longer, and the input's band of ± 0.04 s would swallow it."""
    made = result(STRAIGHT, LONGER, SAME)
    made["registration"]["stretch"] = 1.1
    text = answer(made)
    assert made["verdict"] == DIFFERS
    assert text.startswith("Motion: no, but within what is known of the inputs. Flow: yes.")
    off = (
        "Duration: differs by 20\u00a0ms (9\u00a0% less in the simulation); the recording knows it"
    )
    assert f"{off} to ±\u00a04.51\u00a0ms" in text
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
        ([WRONG], "is to blame, or a motion other than the simulated one"),
        *(([one, BARE], "Whether motion or flow model is") for one in (UNSURE, LONGER, BEND)),
    ],
)
def test_a_wrong_flow_is_blamed_on_what_was_tested(quantities, blamed):
    text = answer(result(*quantities))
    assert blamed in text
    assert text.count("to blame") == 1 + (quantities[0] is BEND)


def test_yes_names_the_runs_that_u_val_lacks():
    text = answer(result(STRAIGHT, SAME, missing=["duration", "pressure"]))
    assert text.startswith("Motion: yes. Flow: yes. ")
    assert (
        "because not varied or measured: the input duration, the input pressure; differences"
        in text
    )


def test_a_flow_that_could_err_by_a_third_unseen_cannot_be_said():
    """However many other quantities are decided."""
    made = result(STRAIGHT, PLACE, WIDE)
    text = answer(made)
    assert made["verdict"] == UNCERTAIN
    assert text.startswith("Motion: yes. Flow: undecided.")
    assert "circulation (found above 110\u00a0%; the largest uncertainty is grid)" in text
    assert "98\u00a0cm²/s" not in text  # an undecided quantity is no evidence


def test_a_place_has_both_components():
    assert pair([3e-4, 4e-4], "m") == "(0.30, 0.40)\u00a0mm"
    assert size([3e-4, 4e-4], "m") == "0.5\u00a0mm"
