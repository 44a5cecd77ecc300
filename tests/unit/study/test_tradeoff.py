"""What accuracy costs: the front, errors of known size, and the choice by accuracy or by time."""

import re

import numpy as np
import pandas as pd
import pytest

from pipeline.formats.records import RUN
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from softfinger.study.accuracy import (
    Setting,
    choose,
    parse_accuracy,
    parse_budget,
    predicted_time,
    read_results,
    reference_warning,
    results_of,
    study_table,
)
from softfinger.study.errors import dorsal_error, force_error, own_errors, vortex_errors, worst
from softfinger.study.plan import Row
from softfinger.study.tradeoff import finest, front, write_results
from tests.conftest import ROOT

SINGLE = ROOT / "cases" / "single_finger"
SETTINGS = [
    Setting(Row("draft", "draft"), 0.2, {"run": 40.0, "mesh": 5.0}),
    Setting(Row("coarse", "coarse"), 0.04, {"run": 300.0, "mesh": 10.0}),
    Setting(Row("fine", "fine"), 0.01, {"run": 5000.0, "mesh": 60.0}),
]


def test_front_is_what_nothing_beats():
    cost = np.array([1.0, 2.0, 3.0, 4.0, 2.0])
    error = np.array([0.5, 0.6, 0.2, 0.2, np.nan])
    np.testing.assert_array_equal(front(cost, error), [True, False, True, False, False])


def test_errors_of_known_size():
    time = np.linspace(0, 0.4, 81)
    reference = pd.DataFrame({"time": time, "fx": np.sin(20 * time), "fy": np.cos(20 * time)})
    other = reference.assign(fx=1.1 * reference["fx"], fy=1.1 * reference["fy"])
    assert force_error(reference, other) == pytest.approx(0.1, rel=1e-6)
    table = pd.DataFrame({"time": time, "x": 0.01 * time, "y": 0.2, "circulation": -0.008})
    table["peak_vorticity"] = -100.0
    moved = table.assign(x=table["x"] + 0.003, y=table["y"] + 0.004, circulation=-0.0088)
    errors = vortex_errors(table, moved, (0.1, 0.3), 0.02)
    assert errors["error_circulation"] == pytest.approx(0.1)
    assert errors["error_peak_vorticity"] == 0.0
    assert errors["error_centre_mm"] == pytest.approx(5.0)
    # 5 mm of a tip of 20
    assert worst(errors | {"error_velocity": 0.05}) == {"error": pytest.approx(0.25)}
    assert vortex_errors(table[:0], moved, (0.1, 0.3), 0.02) == {}
    assert vortex_errors(table, moved[:0], (0.1, 0.3), 0.02) == {}
    assert worst({"error_velocity": 0.05}) == {}  # without a vortex nothing is judged


def test_the_error_of_the_dorsal_circulation_leaves_out_its_prescribed_part():
    """The finger's surface gives two thirds of it on every grid, which would hide any error."""
    columns = {"time": [0.1, 0.2], "circulation": [-6e-3, -9e-3], "of_water": [-2e-3, -3e-3]}
    reference = pd.DataFrame(columns)
    other = pd.DataFrame({"time": [0.1, 0.15, 0.2], "circulation": [-6.2e-3, -7.75e-3, -9.3e-3]})
    assert dorsal_error(reference, other) == pytest.approx(0.1)


def own_scene(folder, text):
    folder.mkdir()
    (folder / "scene.toml").write_text(f'extends = "{SINGLE}"\n{text}')
    return load_scene(folder)


def test_settings_of_another_scene_hold_for_one_like_it_alone(tmp_path):
    """Else the study of its own is offered, with its predicted time."""
    path, warning = results_of(load_scene(SINGLE))
    assert (path, warning) == (SINGLE / "studies" / "results" / "tradeoff.csv", "")
    like = own_scene(tmp_path / "like", "[finger]\ntilt_deg = 5.0\n")
    warning = "warning: the errors were measured on single_finger, a scene like it"
    assert results_of(like) == (path, warning)
    motion = '[motion]\nsource = "paper_equations"\nend_time = 0.42\n'
    back = "{ pressure_kpa = 20.0, start = 0.005, duration = 0.2 }"
    back += ", { pressure_kpa = 0.0, start = 0.2, duration = 0.2 }"
    for name, text, words in (
        ("short", f"{motion}[finger]\nlength = 0.035\n", r"length \(m\) 0\.035 against 0\.07"),
        ("back", f"[motion]\nstrokes = [{back}]\n", "turns of the pressure 2 against 1"),
    ):
        with pytest.raises(StageError, match=words) as error:
            results_of(own_scene(tmp_path / name, text))
        told = rf"softfinger tradeoff \S+/{name}, about [\d.]+ (h|min) of CPU time"
        assert re.search(told, str(error.value))
    assert study_table(like) == SINGLE / "studies" / "tradeoff.csv"


def test_a_turbulence_model_is_no_setting_of_accuracy():
    settings, _ = read_results(SINGLE / "studies" / "results" / "tradeoff.csv")
    assert len(settings) >= 4  # a level each, from smoke to medium
    assert not any("fluid.turbulence" in setting.row.overrides for setting in settings)


def test_the_cheapest_accurate_setting_and_the_best_in_time():
    times = [45.0, 310.0, 5060.0]
    assert choose(SETTINGS, times, 0.05, None) == 1
    assert choose(SETTINGS, times, 0.3, None) == 0
    assert choose(SETTINGS, times, None, 600.0) == 1
    with pytest.raises(StageError, match=r"the best, fine, is within 1 %"):
        choose(SETTINGS, times, 0.001, None)
    with pytest.raises(StageError, match="the fastest, draft, takes 45 s"):
        choose(SETTINGS, times, None, 10.0)


def test_a_machine_of_half_the_speed_takes_twice_as_long():
    there, here = {"solver": 0.5, "images": 0.2}, {"solver": 1.0, "images": 0.4}
    assert predicted_time(SETTINGS[0], there, here) == pytest.approx(90)
    assert predicted_time(SETTINGS[0], there, {"solver": 1.0, "images": 0.2}) == pytest.approx(85)


def test_accuracy_and_budget():
    for text, value in (("5%", 0.05), ("0.05", 0.05), (" 2.5 %", 0.025)):
        assert parse_accuracy(text) == pytest.approx(value)
    for text, value in (("10min", 600), ("2h", 7200), ("90s", 90)):
        assert parse_budget(text) == value


@pytest.mark.parametrize(
    "read, texts",
    [(parse_accuracy, ("five", "500%", "0.0.5")), (parse_budget, ("10", "0min", "1 year", ".min"))],
)
def test_invalid_accuracies_and_budgets_are_refused(read, texts):
    for text in texts:
        with pytest.raises(StageError, match="give a"):
            read(text)


def results() -> pd.DataFrame:
    """A table of softfinger.study.tradeoff, of three flow runs and two of PIV."""
    flow = pd.DataFrame(
        {
            "run": ["draft", "draft_2d", "medium"], "level": ["draft", "draft", "medium"],
            "kind": "flow", "ranks": 1, "model.kind": [np.nan, "2d", np.nan],
            "sheet.rate_hz": [100, 100, np.nan], "cells": [29800, 2846, 259300],
            "time_step_s": [1e-3, 1e-3, 2.5e-4], "end_time_s": 0.42,
            "cpu_flow_s": [50.0, 15.0, 2500.0], "peak_memory_MB": 300.0,
            "error_circulation": [0.1, 0.86, np.nan], "error_dorsal": [0.05, 0.9, np.nan],
            "error_centre_mm": [0.5, 2.7, np.nan], "error_velocity": [0.02, 0.1, np.nan],
            "error_force": [0.05, 1.7, np.nan], "error": [0.1, 1.7, np.nan], "tip_width_mm": 16.7,
            "openfoam": "v1912", "cpu_run_s": [45.0, 9.0, 2500.0], "peak_force_N": 0.07,
            "circulation_cfd_m2_per_s": [-0.0075, -0.0135, -0.0072],
            "predict_run_s": [45.0, 9.0, 2500.0], "front": [True, True, False],
        }
    )  # fmt: skip
    piv = pd.DataFrame(
        {
            "run": ["piv", "piv_fast"], "level": "draft", "kind": "piv", "vectors": [5000, 5000],
            "cpu_piv_per_field_s": [0.2, 0.1], "error_circulation": [0.01, 0.02],
            "error_centre_mm": [0.1, 0.1], "error_velocity": [0.004, 0.006],
            "error": [0.01, 0.02], "front": True,
        }
    )  # fmt: skip
    return pd.concat([flow, piv], ignore_index=True)


def test_the_best_runs_own_error_is_extrapolated_from_the_next_level():
    errors = [np.nan, 0.12, 0.01, 0.3]
    zero = dict.fromkeys(("error_centre", "error_velocity", "error_force"), 0.0)
    columns = {"model": "half", "cells": [800.0, 100.0, 400.0, 50.0], "error_centre_mm": 0.3}
    columns |= zero | {"error_circulation": errors, "error": errors}
    table = pd.DataFrame(columns, index=["medium", "coarse", "coarse_dt", "draft"])
    step = {"numerics.time_step": 1e-3}
    run = {"until": "vortices_cfd", "overrides": {}}
    runs = [run | {"run": name} for name in table.index]
    runs[2] |= {"overrides": step}  # coarse_dt
    # cells of half the size: a quarter of the error, so a third of the difference
    assert own_errors(table, runs, "medium")["error"] == pytest.approx(0.04)
    assert own_errors(table, runs[:1], "medium") == {}
    # errors of first order: cells of half the size have the best run's own error as difference
    table.loc["draft", "error_circulation"] = 0.12 * (16 ** (1 / 3) - 1)
    assert own_errors(table, runs, "medium")["error"] == pytest.approx(0.12)


def test_results_that_can_be_chosen_from(tmp_path):
    table = results()
    path = tmp_path / "single_finger.csv"
    write_results(path, table, "medium", {"solver": 0.5, "images": 0.2})
    settings, head = read_results(path)
    assert head["probe"] == {"solver": 0.5, "images": 0.2}
    assert "best_error" not in head  # one level alone does not give it
    table.loc[table["run"] == "medium", "error"] = 0.06
    write_results(path, table, "medium", {"solver": 0.5, "images": 0.2})
    _, head = read_results(path)
    told = "relative to medium, whose own error is estimated at 6.0%"
    assert told in reference_warning(head, 0.05)
    assert reference_warning(head, 0.07) == ""
    assert reference_warning({"best": "medium"}, 0.01) == ""  # an older table
    # the best has no error, PIV is no flow
    assert [s.row.run for s in settings] == ["draft", "draft_2d"]
    # the sampling rate of the study is no setting
    assert settings[1].row.overrides == {"model.kind": "2d"}
    assert settings[1].seconds == {"run": 9.0}


def test_the_finest_finished_run_is_the_reference(tmp_path):
    rows = []
    sizes = {"draft": (10, 400), "fine": (90, 400), "fine_dt": (90, 800), "gone": (200, 400)}
    for name, (cells, steps) in (sizes | {"piv": (10, 400)}).items():
        out, until = tmp_path / name, "vortices" if name == "piv" else "vortices_cfd"
        row = {"run": name, "folder": "cases/single_finger", "level": "draft", "until": until}
        rows.append(row | {"overrides": {}, "out": str(out)})
        RUN.write(out / "run" / "run.json", {"cells": cells, "steps": steps})
    assert finest({"runs": rows}, {"gone": "sheet.h5 is not there"}) == "fine_dt"
    with pytest.raises(ValueError, match="no finished run"):
        finest({"runs": rows[3:]}, {"gone": "sheet.h5 is not there"})
