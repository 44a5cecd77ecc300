"""What accuracy costs: the front, errors of known size, and the choice by accuracy or by time."""

import re
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pipeline.formats.records import RUN
from pipeline.kinematics.camera_window import _turns
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from postprocess.report.trust import level_error
from softfinger.make import Machine
from softfinger.study.accuracy import (
    Setting,
    choose,
    finest_within,
    make_cheapest,
    parse_accuracy,
    parse_time,
    predicted_time,
    read_results,
    reference_warning,
    results_of,
    study_table,
)
from softfinger.study.errors import (
    _thinned,
    force_error,
    own_errors,
    same_vortex,
    stroke_windows,
    tip_vortex,
    vortex_errors,
    worst,
)
from softfinger.study.tradeoff import finest, front, write_results
from tests.conftest import CASES

SINGLE = CASES / "single_finger"
PROBE = {"solver": 0.5, "images": 0.2}
SETTINGS = [
    Setting("draft", 1, {0.1: 0.2, 0.2: 0.4}, {"solve": 40.0, "mesh": 5.0}),
    Setting("coarse", 1, {0.1: 0.04, 0.2: 0.1}, {"solve": 300.0, "mesh": 10.0}),
    Setting("fine", 1, {0.1: 0.01, 0.2: 0.03}, {"solve": 5000.0, "mesh": 60.0}),
]


def test_front_is_what_nothing_beats():
    cost = np.array([1.0, 2.0, 3.0, 4.0, 2.0])
    error = np.array([0.5, 0.6, 0.2, 0.2, np.nan])
    np.testing.assert_array_equal(front(cost, error), [True, False, True, False, False])


def test_errors_of_known_size():
    time = np.linspace(0, 0.4, 81)
    reference = pd.DataFrame({"time": time, "fx": np.sin(20 * time), "fy": np.cos(20 * time)})
    other = reference.assign(fx=1.1 * reference["fx"], fy=1.1 * reference["fy"])
    other.loc[time > 0.3, ["fx", "fy"]] = 0.0
    assert force_error(reference, other, (0.1, 0.3)) == pytest.approx(0.1, rel=1e-6)
    assert force_error(reference, other, (0.31, 0.4)) == pytest.approx(1.0)
    table = pd.DataFrame({"time": time, "x": 0.01 * time, "y": 0.2, "circulation": -0.008})
    table["peak_vorticity"] = -100.0
    moved = table.assign(x=table["x"] + 0.003, y=table["y"] + 0.004, circulation=-0.0088)
    errors = vortex_errors(table, moved, (0.1, 0.3), 0.02)
    assert errors["error_circulation"] == pytest.approx(0.1)
    assert errors["error_peak_vorticity"] == 0.0
    assert errors["error_centre_mm"] == pytest.approx(5.0)
    # 5 mm of a tip of 20
    assert worst(errors | {"error_velocity": 0.05}) == {"error": pytest.approx(0.25)}
    assert worst(errors | {"error_near_tip": 0.4}) == {"error": 0.4}
    assert vortex_errors(table[:0], moved, (0.1, 0.3), 0.02) == {}
    assert vortex_errors(table, moved[:0], (0.1, 0.3), 0.02) == {}
    assert worst({"error_velocity": 0.05}) == {}  # without a vortex nothing is judged


def vortices(time, **columns):
    """A table of one vortex near the tip that drifts in x."""
    table = pd.DataFrame({"time": time, "x": 0.1 * time, "y": 0.17, "circulation": -0.006})
    table = table.assign(peak_vorticity=-60.0, track=0, bridged=0, finger=0, tip_distance=1.0)
    return table.assign(**columns)


def test_a_vortex_is_compared_where_both_sources_have_found_it():
    """A track that goes on in another vortex after a gap made 3 mm of the centre 13 mm."""
    time, window = np.arange(0.28, 0.35, 0.01).round(3), (0.275, 0.345)
    other = vortices(time, x=0.1 * time + 0.003)
    weak = vortices(time, y=0.19, circulation=0.002, track=1)  # of the other sense
    known = vortices(time)
    lost = known["time"].between(0.295, 0.315)
    known.loc[lost, "bridged"] = 1
    known.loc[known["time"] == 0.32, ["y", "circulation"]] = 0.183, -0.0024
    known = pd.concat([known, weak]).sort_values("time", ignore_index=True)
    tip = tip_vortex(known, window)
    np.testing.assert_allclose(tip["time"], [0.28, 0.29, 0.33, 0.34])
    same = same_vortex(pd.concat([weak, other]), tip, window)
    np.testing.assert_allclose(same["time"], tip["time"])
    assert vortex_errors(tip, same, window, 0.02)["error_centre_mm"] == pytest.approx(3.0)
    assert same_vortex(weak, tip, window).empty
    assert tip_vortex(known.assign(tip_distance=3.0), window).empty
    # one as strong that lies nearer to the origin is another
    both = pd.concat([vortices(time, x=0.1 * time - 0.02), other], ignore_index=True)
    two = same_vortex(both, tip, window)
    assert list(two.columns) == list(other.columns)
    np.testing.assert_allclose(two["x"], 0.1 * tip["time"] + 0.003)
    # one instant of ten times the circulation, which is no vortex's, does not hide the others
    spike = vortices(time, circulation=np.where(time == 0.3, -0.06, -0.006))
    assert len(tip_vortex(spike, window)) == len(time)


@pytest.mark.parametrize("step, kept", [(0.001, 13), (0.05, 2)])
def test_about_twelve_instants_of_a_window_are_compared(step, kept):
    times = np.arange(0.0, 0.2, step)
    found = _thinned(xr.Dataset(coords={"time": times}), (0.05, 0.1 + 1e-9))["time"].values
    assert len(found) == kept
    assert np.all((found >= 0.05) & (found < 0.101))


def test_windows_are_the_middle_of_the_stroke_and_three_parts_of_the_rest():
    assert stroke_windows((0.1, 0.16), 0.4) == [
        (0.1, 0.16), pytest.approx((0.16, 0.24)), pytest.approx((0.24, 0.32)),
        pytest.approx((0.32, 0.4)),
    ]  # fmt: skip


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
        short = (
            rf"softfinger tradeoff \S+/{name} --only smoke,draft,coarse, about [\d.]+ (h|min) of"
        )
        assert re.search(short, str(error.value))
        assert re.search(rf"softfinger tradeoff \S+/{name}, about [\d.]+ (h|min)", str(error.value))
    assert study_table(like) == SINGLE / "studies" / "tradeoff.csv"


def test_a_scene_that_was_not_analysed_is_first_told_so(tmp_path):
    """It was told that its length is not that of its parent's states."""
    own = own_scene(tmp_path / "own", "[actuator]\nchambers = 6\n[finger]\nlength = 0.052\n")
    with pytest.raises(StageError, match=r"chambers = 6.*analyse this scene's own with"):
        make_cheapest(own.folder, "12%", "", "", Machine(), True)


def test_a_budget_needs_no_measured_errors(tmp_path):
    """It asked a stranger's scene for a study of hours, though the predicted time suffices."""
    scene = own_scene(tmp_path / "own", "[finger]\nlength = 0.07\nwidth = 0.009\n")
    with pytest.raises(StageError, match=r"no settings|another motion"):
        results_of(scene)
    draft, cheap = finest_within(scene.folder, 300.0)
    finer, dear = finest_within(scene.folder, 3000.0)
    assert cheap <= 300 < dear <= 3000
    assert draft.scene.level != finer.scene.level
    with pytest.raises(StageError, match="the fastest, smoke, takes"):
        finest_within(scene.folder, 1.0)


def test_noise_of_a_sensor_is_no_turn_of_the_pressure():
    time = np.linspace(0, 1, 400)
    noise = 0.005 * np.random.default_rng(1).normal(size=400)
    assert _turns(np.minimum(5 * time, 1) + noise) == 0
    assert _turns(np.sin(2 * np.pi * time) + noise) == 2


def test_no_level_is_chosen_whose_page_then_states_a_larger_error():
    settings, _ = read_results(SINGLE / "studies" / "results" / "tradeoff.csv")
    errors = pd.read_csv(SINGLE / "studies" / "results" / "errors.csv", comment="#")
    assert {"draft", "coarse"} <= {setting.level for setting in settings}
    times, refused = [sum(setting.seconds.values()) for setting in settings], 0
    for until in (np.inf, *(errors["start_s"].unique() + 1e-3)):
        for most in np.geomspace(0.01, 2.0, 100):
            try:
                level = settings[choose(settings, times, most, None, until)].level
            except StageError:
                refused += 1
                continue
            _, windows = level_error([SINGLE], level).table
            stated = [
                float(error.partition("\u00a0")[0]) / 100
                for window, row in windows
                if float(window.partition(" ")[0]) < until
                for error in row
            ]
            assert max(stated) <= most + 5e-4, (level, most, until)  # the page has a tenth of a %
    assert 0 < refused < 500


def test_the_cheapest_accurate_setting_and_the_best_in_time():
    times = [45.0, 310.0, 5060.0]
    assert choose(SETTINGS, times, 0.1, None) == 1
    assert choose(SETTINGS, times, 0.05, None) == 2
    assert choose(SETTINGS, times, 0.05, None, until=0.2) == 1
    assert choose(SETTINGS, times, 0.05, None, until=0.05) == 1  # before all windows: the first
    assert choose(SETTINGS, times, 0.5, None) == 0
    assert choose(SETTINGS, times, None, 600.0) == 1
    with pytest.raises(StageError, match=r"the best, fine, is within 3 %.* a part of the stroke"):
        choose(SETTINGS, times, 0.001, None)
    with pytest.raises(StageError, match="give that, or set the scene finer yourself"):
        choose(SETTINGS, times, 0.001, None, until=0.2)
    with pytest.raises(StageError, match="the fastest, draft, takes 45 s"):
        choose(SETTINGS, times, None, 10.0)


def test_a_vortex_that_was_not_found_makes_an_error_unbounded(tmp_path):
    path = tmp_path / "tradeoff.csv"
    write_results(path, *results(), "medium", PROBE, {})
    errors = pd.read_csv(path.with_name("errors.csv"), comment="#")
    lost = errors.assign(error=errors["error"].where(errors["start_s"] < 0.2))
    write_results(path, results()[0], lost, "medium", PROBE, {})
    settings, _ = read_results(path)
    assert settings[0].error(until=0.2) == 0.1
    assert settings[0].error() == np.inf


def test_a_machine_of_half_the_speed_takes_twice_as_long():
    there, here = {"solver": 0.5, "images": 0.2}, {"solver": 1.0, "images": 0.4}
    assert predicted_time(SETTINGS[0], there, here) == pytest.approx(90)
    assert predicted_time(SETTINGS[0], there, {"solver": 1.0, "images": 0.2}) == pytest.approx(85)


def test_accuracy_and_budget():
    for text, value in (("5%", 0.05), ("0.05", 0.05), (" 2.5 %", 0.025)):
        assert parse_accuracy(text) == pytest.approx(value)
    for text, value in (("10min", 600), ("2h", 7200), ("0.2s", 0.2)):
        assert parse_time(text, "BUDGET") == value


@pytest.mark.parametrize(
    "read, texts",
    [
        (parse_accuracy, ("five", "500%", "0.0.5")),
        (partial(parse_time, key="--until"), ("10", "0min", "1 year", ".min")),
    ],
)
def test_invalid_accuracies_and_budgets_are_refused(read, texts):
    for text in texts:
        with pytest.raises(StageError, match="give a"):
            read(text)


def results(own: float = np.nan) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of softfinger.study.tradeoff; `own`: error of the reference, medium."""
    table = pd.DataFrame(
        {
            "run": ["draft", "draft_2d", "medium", "piv"],
            "level": ["draft", "draft", "medium", "draft"],
            "kind": ["flow", "flow", "flow", "piv"], "ranks": 1, "error": [0.3, 1.7, own, 0.02],
            "predict_solve_s": [45.0, 9.0, 2500.0, np.nan],
        }
    )  # fmt: skip
    errors = pd.DataFrame(
        {
            "run": ["draft", "draft", "medium"], "start_s": [0.1, 0.2, 0.1],
            "error": [0.1, 0.3, own],
        }
    )  # fmt: skip
    return table, errors


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
    # a level that is coarser still is not used
    table.loc["smoke"] = table.loc["draft"]
    table.loc["smoke", ["cells", "error", "error_circulation"]] = 12.5, 0.9, 0.9
    runs.append(run | {"run": "smoke"})
    assert own_errors(table, runs, "medium")["error"] == pytest.approx(0.04)
    # in a plane eight times the cells are 8**0.5 times as fine
    plane = own_errors(table.assign(model="2d"), runs, "medium")
    assert plane["error"] == pytest.approx(0.12 / 7)
    # errors of first order: cells of half the size have the best run's own error as difference
    table.loc["draft", "error_circulation"] = 0.12 * (16 ** (1 / 3) - 1)
    assert own_errors(table, runs, "medium")["error"] == pytest.approx(0.12)
    # errors that hardly fall tell no order: at the first, 0.24 would follow
    table.loc["medium", "cells"] = 337.5
    table.loc["draft", "error_circulation"] = 0.13
    assert own_errors(table, runs, "medium")["error"] == pytest.approx(0.12)


def test_results_that_can_be_chosen_from(tmp_path):
    path = tmp_path / "tradeoff.csv"
    write_results(path, *results(), "medium", PROBE, {})
    settings, head = read_results(path)
    assert head["probe"] == {"solver": 0.5, "images": 0.2}
    # the reference has no error, a plane flow is no level, PIV is no flow
    assert [(s.level, s.errors, s.seconds) for s in settings] == [
        ("draft", {0.1: 0.1, 0.2: 0.3}, {"solve": 45.0})
    ]
    write_results(path, *results(own=0.06), "medium", PROBE, {})
    settings, head = read_results(path)
    assert [s.level for s in settings] == ["draft", "medium"]
    told = "relative to medium, whose own error is estimated at 6.0%"
    assert told in reference_warning(head, 0.05)
    assert reference_warning(head, 0.07) == ""
    path.with_name("errors.csv").unlink()
    with pytest.raises(StageError, match=r"errors\.csv: missing; make it anew"):
        read_results(path)


def test_the_finest_whole_stroke_is_the_reference(tmp_path):
    rows = []
    sizes = {"draft": (10, 400), "fine": (90, 400), "fine_dt": (90, 800), "grid_fine": (200, 100)}
    for name, (cells, steps) in (sizes | {"piv": (10, 400)}).items():
        out, until = tmp_path / name, "vortices" if name == "piv" else "vortices_cfd"
        row = {"run": name, "folder": "cases/single_finger", "level": "draft", "until": until}
        part = {"motion.end_time": 0.17} if name == "grid_fine" else {}
        rows.append(row | {"overrides": part, "out": str(out)})
        RUN.write(out / "run" / "run.json", {"cells": cells, "steps": steps})
    assert finest({"runs": rows}) == "fine_dt"
    with pytest.raises(ValueError, match="no run of a whole stroke"):
        finest({"runs": rows[3:]})
