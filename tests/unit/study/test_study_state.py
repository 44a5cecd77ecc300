"""Results of a study pass for those of its plan only where they are all there and made with the plan's numbers."""

import json
from pathlib import Path

import h5py
import pytest

from fileio.stages import BY_NAME
from pipeline.scene.read_toml import FILE_KEYS, merge
from pipeline.study.plan import plan
from postprocess.__main__ import main as postprocess
from postprocess.studies.state import (
    UNASKED,
    differing,
    files_of,
    missing_runs,
    missing_sentence,
    unfinished,
)
from postprocess.studies.table import read_plan
from tests.conftest import write_scene

TABLE = "run, level, until, piv.window, numerics.time_step\nmedium, tiny, vortices_cfd, , \npiv, tiny, vortices, 32,\n"


def made(row, settings=None):
    """Every result of a run, each with the settings that it was made with (those of the plan where not said)."""
    settings = row["settings"] | (settings or {})
    for stage in row["stages"]:
        path = files_of(row).out / BY_NAME[stage].done
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(settings.get(stage, {}))
        if path.suffix == ".h5":
            with h5py.File(path, "w") as file:
                file.attrs["settings"] = text
        elif path.suffix == ".csv":
            path.write_text(
                "# " + json.dumps({"format": "vortices", "settings": text}) + "\ntime\n"
            )
        else:
            path.write_text("{}")


@pytest.fixture
def planned(tmp_path):
    scene = write_scene(tmp_path / "small")
    (scene.folder / "studies").mkdir()
    table = scene.folder / "studies" / "trial.csv"
    table.write_text(TABLE)
    return read_plan(plan(table))


def test_results_with_the_plans_numbers_are_finished(planned):
    assert missing_runs(planned) == dict.fromkeys(("medium", "piv"), "kinematics.h5 is not there")
    for row in planned["runs"]:
        made(row)
    assert missing_runs(planned) == {}


def test_a_hole_on_the_way_is_no_result_though_what_was_made_of_it_before_is_there(planned):
    """A job that fails takes its own result away, and leaves what an older plan had made of it."""
    medium, piv = planned["runs"]
    for row in (medium, piv):
        made(row)
    (files_of(piv).out / "run" / "run.json").unlink()
    assert missing_runs(planned) == {"piv": "run/run.json is not there"}
    made(piv)
    (files_of(piv).out / "images.h5").unlink()  # large: may go when PIV is done
    assert missing_runs(planned) == {}


@pytest.mark.parametrize(
    "stage, settings, words",
    [
        ("piv", {"window": 16}, "piv.h5 was made with another window (16, not 32)"),
        (
            "vortices_cfd",
            {"min_circulation": 1.0},
            "vortices_cfd.csv was made with another min_circulation (1.0",
        ),
        (
            "case",
            {"numerics": {"time_step": 2e-3}},
            "sweep.h5 was made with another numerics.time_step (0.002, not 0.001)",
        ),
        (
            "kinematics",
            {"files": {"other/states.h5": "0"}},
            "kinematics.h5 was made with another files",
        ),
    ],
)
def test_results_of_an_older_plan_are_not_taken_for_those_of_the_new(
    planned, stage, settings, words
):
    row = planned["runs"][1]
    made(row, {stage: merge(row["settings"][stage], settings)})
    assert words in unfinished(planned, row)


def test_names_of_files_do_not_count():
    wanted = {"motion": {"end_time": 0.4}, "files": ["1e3b"]}
    made = {
        "motion": {"end_time": 0.4, "states": "../a/states.h5"},
        "files": {"../a/states.h5": "1e3b"},
    }
    assert differing("kinematics", wanted, made) is None


def test_a_key_that_came_later_and_is_not_given_is_no_difference():
    assert (
        differing("kinematics", {"motion": {"path_csv": None}, "body": None}, {"motion": {}})
        is None
    )
    assert differing("kinematics", {"body": None}, {"body": {"length": 1.0}}) is not None
    assert differing("kinematics", {"body": {"length": 1.0}}, {"body": None}) is not None


def test_groups_of_flags_count_for_images_only():
    wanted = {
        "background": 8.0,
        "truth": True,
    }  # what is written beside the images is not recorded in them
    assert differing("images", wanted, {"camera": {"background": 8.0}}) is None
    assert (
        differing("images", wanted, {"camera": {"background": 9.0}}) == "background (9.0, not 8.0)"
    )
    assert (
        differing("piv", {"window": 32}, {"first": {"window": 32}})
        == "window (none is recorded, not 32)"
    )


def test_what_is_not_recorded_is_not_what_was_asked_for(planned):
    """A result of before a number was recorded may have been made with any."""
    row = planned["runs"][1]
    for stage, key in (
        ("mesh", "numerics"),
        ("piv", "window"),
        ("images", "seed"),
        ("case", "templates"),
    ):
        made(row, {stage: {k: v for k, v in row["settings"][stage].items() if k != key}})
        assert f"another {key}" in unfinished(planned, row)
        assert "none is recorded" in unfinished(planned, row)


def test_what_the_plan_leaves_out_at_its_default_must_not_be_recorded_otherwise(planned):
    row = planned["runs"][1]
    case = row["settings"]["case"]
    made(row, {"case": case | {"numerics": case["numerics"] | {"interpolation": "skewCorrected"}}})
    assert (
        'numerics.interpolation ("skewCorrected", which the plan does not ask for)'
        in unfinished(planned, row)
    )


def test_the_trade_is_not_written_with_runs_missing_unless_asked(planned, tmp_path, capsys):
    path = tmp_path / "small" / "out" / "studies" / "trial" / "plan.json"
    docs = tmp_path / "docs"
    made(planned["runs"][0])
    assert postprocess(["tradeoff", str(path), "--docs", str(docs)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for word in (
        "1 of 2 runs",
        "piv: kinematics.h5 is not there",
        "run make tradeoff SCENE=small",
        "--partial",
    ):
        assert word in said
    assert not docs.exists()


def test_a_damaged_result_is_one_sentence(planned, capsys, tmp_path):
    for row in planned["runs"]:
        made(row)
    (files_of(planned["runs"][0]).out / "planform.h5").write_text("no HDF5")
    path = tmp_path / "small" / "out" / "studies" / "trial" / "plan.json"
    assert postprocess(["tradeoff", str(path), "--docs", str(tmp_path / "docs")]) == 2
    said = capsys.readouterr().err
    assert "planform.h5: not readable" in said
    assert said.count("\n") == 1


def test_a_bending_analysis_and_a_run_that_may_fail_are_missing_until_they_are_there(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("pipeline.study.plan.foam_version", lambda: "v1912")
    scene = write_scene(tmp_path / "small")
    (scene.folder / "studies").mkdir()
    table = scene.folder / "studies" / "mixed.csv"
    table.write_text(
        "run, level, until, may_fail, actuator.width\nwide, tiny, fea, , 0.03\nedge, tiny, run, yes,\n"
    )
    planned = read_plan(plan(table))
    wanted = {"wide": "kinematics/states.h5", "edge": "outcome.json"}
    assert missing_runs(planned) == {run: f"{name} is not there" for run, name in wanted.items()}
    for row in planned["runs"]:
        [name] = row["wanted"]
        path = Path(row["folder"]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
        assert row["run"] not in missing_runs(planned)


def test_what_is_missing_is_said_in_one_sentence():
    said = missing_sentence({"a": "sheet.h5 is not there", "b": "x"}, 3, "make tradeoff")
    assert said == (
        "2 of 3 runs are not there as the study asks for them (a: sheet.h5 is not there; b: x): run make tradeoff to make them"
    )


def test_names_of_files_are_not_compared():
    """The plan leaves them out; it has what is in the files."""
    assert {f"motion.{key}" for key in FILE_KEYS} == UNASKED
