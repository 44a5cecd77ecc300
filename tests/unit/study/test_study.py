"""A study's table to scenes: overrides, owners of equal stages, linked results, one sentence for what is wrong."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import pytest

from fileio.atomic import unlink_folders
from fileio.errors import StageError
from fileio.formats.records import COST
from fileio.lock import exclusive
from pipeline.scene.scene import load_scene
from pipeline.study.plan import folder_of, plan, scene_text, toml
from pipeline.study.reuse import reuse
from pipeline.study.table import Row, read_study
from postprocess.evidence.stage_files import StageFiles
from postprocess.studies.state import missing_runs
from postprocess.studies.table import read_plan, stage_costs, study_table
from tests.conftest import ROOT, write_scene

HEADER = "run, level, until, ranks, numerics.time_step, model.kind, piv.window, camera.centre\n"


def study(folder: Path, rows: str) -> Path:
    (folder / "studies").mkdir(parents=True, exist_ok=True)
    path = folder / "studies" / "trial.csv"
    path.write_text("# a comment\n" + HEADER + rows, encoding="utf-8")
    return path


def test_rows_become_scenes_that_differ_in_what_the_table_says(tmp_path):
    scene = write_scene(tmp_path / "small")
    table = study(
        scene.folder,
        'fine, tiny, run, 2, 5e-4, , , \nwide, tiny, vortices, , , half, 48, "[0.01, 0.2]"\n',
    )
    written_plan = json.loads(plan(table).read_text())
    assert written_plan["scene"] == "small"
    assert [row["ranks"] for row in written_plan["runs"]] == [2, 1]
    fine, wide = (load_scene(row["folder"], "tiny") for row in written_plan["runs"])
    assert fine.numerics.time_step == 5e-4
    assert (wide.model.kind, wide.piv.window, wide.camera.centre) == ("half", 48, (0.01, 0.2))
    assert wide.numerics == scene.numerics
    assert fine.mesh == wide.mesh == scene.mesh
    assert len({scene.digest(), fine.digest(), wide.digest()}) == 3
    assert (wide.out / "settings" / "piv.json").exists()
    assert (
        wide.folder / wide.motion.states
    ).exists()  # the parent's path, seen from the new folder


def test_a_table_that_changed_does_not_reach_under_a_stage_at_work(tmp_path):
    """It would end later than the new settings, and its results of the old numbers pass for results of the new."""
    scene = write_scene(tmp_path / "small")
    written_plan = json.loads(plan(study(scene.folder, "a, tiny, run, 1, , , 48, \n")).read_text())
    out = load_scene(written_plan["runs"][0]["folder"], "tiny").out
    with exclusive(out / "piv.h5"):
        plan(study(scene.folder, "a, tiny, run, 1, , , 48, \n"))
        with pytest.raises(StageError, match=r"another make is at work here \(piv.h5\)"):
            plan(study(scene.folder, "a, tiny, run, 1, , , 32, \n"))


def test_equal_stages_are_computed_once(tmp_path):
    scene = write_scene(tmp_path / "small")
    table = study(
        scene.folder,
        "a, tiny, run, 1, , , , \nb, tiny, run, 2, , , , \nc, tiny, run, 1, 5e-4, , , \nd, tiny, vortices, 1, , , 48, \n",
    )
    owners = {row["run"]: row["owners"] for row in json.loads(plan(table).read_text())["runs"]}
    assert {o["kinematics"] for o in owners.values()} == {"a"}
    assert [owners[r]["mesh"] for r in "abcd"] == [
        "a",
        "a",
        "c",
        "a",
    ]  # its intervals begin at time steps
    assert [owners[r]["run"] for r in "abcd"] == [
        "a",
        "b",
        "c",
        "a",
    ]  # other ranks and steps are other runs
    assert owners["d"]["images"] == "a"
    assert owners["d"]["piv"] == "d"


def test_the_plan_says_what_each_result_is_to_be_made_with(tmp_path):
    scene = write_scene(tmp_path / "small")
    written_plan = json.loads(
        plan(
            study(scene.folder, "a, tiny, vortices, 1, , , 48, \nb, tiny, run, 1, 5e-4, , , \n")
        ).read_text()
    )
    a, b = written_plan["runs"]
    assert a["stages"] == [
        "kinematics",
        "mesh",
        "case",
        "run",
        "sheet",
        "images",
        "piv",
        "vortices_cfd",
        "vortices_piv",
    ]
    assert b["stages"] == ["kinematics", "mesh", "case", "run"]
    names = ("kinematics.h5", "planform.h5", "sweep.h5", "run/run.json")
    assert b["wanted"] == [f"out/tiny/{name}" for name in names]
    assert "out/tiny/images.h5" not in a["wanted"]  # may go when PIV is done
    assert len(a["wanted"]) == len(a["stages"]) - 1
    assert a["settings"]["piv"]["window"] == 48
    assert b["settings"]["case"]["numerics"]["time_step"] == 5e-4
    assert (
        a["settings"]["kinematics"] == b["settings"]["kinematics"]
    )  # whatever the folders are called
    assert set(written_plan["files"]) >= set(a["stages"])


def test_scene_text_is_toml_that_says_only_what_differs():
    row = Row(
        "r",
        "coarse",
        overrides={"fluid.turbulence": "WALE", "sheet.rate_hz": 100, "actuator.width": 0.02},
    )
    table = tomllib.loads(scene_text("../..", row))
    assert table["extends"] == "../.."
    level = table["levels"]["coarse"]
    assert level["fluid"] == {"turbulence": "WALE"}
    assert level["actuator"] == {"width": 0.02}
    assert level["motion"] == {
        "source": "fea",
        "states": "kinematics/states.h5",
    }  # another actuator bends otherwise


@pytest.mark.parametrize(
    "rows, said",
    [("a, tiny, run, 0, , , , \n", "ranks = '0'"), ("a, tiny, dance, 1, , , , \n", "until = 'dance'"),
     ("../a, tiny, run, 1, , , , \n", "run = '../a'"), ("a, tiny, run, 1, , , , \na, tiny, run, 1, , , , \n", "occurs twice"),
     ("", "no rows"), ("a, tiny, run, 1, , 4d, , \n", "run a: "), ("a, tiny, run, 1, 3e-4, , , \n", "numerics.time_step")],
)  # fmt: skip
def test_a_bad_table_ends_with_one_sentence(tmp_path, rows, said):
    scene = write_scene(tmp_path / "small")
    with pytest.raises(StageError, match=r".") as error:
        plan(study(scene.folder, rows))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_columns_are_refused(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("run, level, colour\na, tiny, red\n")
    with pytest.raises(StageError, match="'colour'"):
        read_study(path)


def test_results_are_taken_over(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    (a / "run").mkdir(parents=True)
    (a / "costs").mkdir()
    (a / "case").mkdir()
    (a / "run" / "run.json").write_text("{}")
    (a / "costs" / "run.json").write_text('{"stage": "run"}')
    reuse(a, b, "run")
    reuse(a, b, "run")  # again, over what is there
    assert (b / "run" / "run.json").read_text() == "{}"
    assert (b / "costs" / "run.json").exists()
    assert (b / "case").resolve() == a / "case"


def test_a_run_that_is_no_longer_equal_leaves_the_other_alone(tmp_path):
    """What is deleted or written in a run that had taken over another's results is its own."""
    a, b = tmp_path / "a", tmp_path / "b"
    for name in ("run/run.json", "case/interval_0/U"):
        (a / name).parent.mkdir(parents=True)
        (a / name).write_text("of a")
    reuse(a, b, "run")
    (b / "run" / "run.json").unlink()  # as Snakemake does before it runs a rule again
    unlink_folders(b)  # as the case stage does first
    assert not (b / "case").exists()
    assert {(a / name).read_text() for name in ("run/run.json", "case/interval_0/U")} == {"of a"}


def test_the_name_of_a_folder_does_not_lead_into_the_other_run(tmp_path):
    """Studies of before had run/ linked by name as well."""
    a, b = tmp_path / "a", tmp_path / "b"
    (a / "run").mkdir(parents=True)
    (a / "run" / "run.json").write_text('{"of": "a"}')
    b.mkdir()
    (b / "run").symlink_to("../a/run")
    reuse(a, b, "run")
    assert not (b / "run").is_symlink()
    assert (b / "run" / "run.json").read_text() == '{"of": "a"}'
    assert not (a / "run" / "run.json").samefile(b / "run" / "run.json")


def test_what_was_taken_over_of_a_run_stays_when_a_later_stage_is_taken_over(tmp_path):
    """Eleven PIV runs had lost their run.json so, and with it their rows on the page of the trade."""
    a, b = tmp_path / "a", tmp_path / "b"
    for name in ("run/run.json", "case/interval_0/U", "sheet.h5"):
        (a / name).parent.mkdir(parents=True, exist_ok=True)
        (a / name).write_text("of a")
    b.mkdir()
    (b / "run").symlink_to("../a/run")  # of before
    (b / "case").symlink_to("../a/case")
    reuse(a, b, "sheet")
    assert (b / "run" / "run.json").exists()
    assert (b / "case" / "interval_0" / "U").exists()
    reuse(a, b, "run")
    reuse(a, b, "sheet")
    assert (b / "run" / "run.json").exists()
    assert (b / "case" / "interval_0" / "U").exists()


def test_a_study_that_was_not_run_gives_a_table_of_what_was_asked(tmp_path):
    scene = write_scene(tmp_path / "small")
    path = plan(study(scene.folder, "a, tiny, run, 1, 5e-4, , , \n"))
    planned = read_plan(path)
    table = study_table(planned, missing_runs(planned))
    assert list(table["run"]) == ["a"]
    assert table["numerics.time_step"][0] == 5e-4
    assert table["missing"][0] == "kinematics.h5 is not there"


def test_the_table_says_how_runs_ended_and_what_actuators_gave(tmp_path):
    """What Snakemake leaves behind of a run that was stopped, and of a bending analysis."""
    scene = write_scene(tmp_path / "small")
    (scene.folder / "studies").mkdir()
    table = scene.folder / "studies" / "mixed.csv"
    table.write_text(
        "run, level, until, actuator.width\nwide, tiny, fea, 0.03\nplain, tiny, run, \n"
    )
    planned = read_plan(plan(table))
    wide, plain = (Path(row["folder"]) for row in planned["runs"])
    (wide / "kinematics").mkdir()
    shutil.copy2(ROOT / "cases" / "single_finger" / "kinematics" / "states.h5", wide / "kinematics")
    (plain / "out" / "tiny" / "outcome.json").write_text(
        json.dumps(
            {
                "format": "outcome",
                "format_version": 1,
                "ended": "stopped",
                "stopped_at_s": 0.1,
                "reason": "Courant",
            }
        )
    )
    missing = missing_runs(planned)
    assert missing == {"plain": "kinematics.h5 is not there"}
    rows = study_table(planned, missing).set_index("run")
    assert rows.loc["wide", "states"] == 81
    assert rows.loc["wide", "pressure_max_Pa"] == 40e3
    assert rows.loc["plain", "ended"] == "stopped"
    assert rows.loc["plain", "stopped_at_s"] == 0.1


def test_wall_time_is_not_taken_for_cpu_time(tmp_path):
    files = StageFiles(tmp_path, "tiny")
    cost = {"stage": "run", "wall_time": 10.0, "cpu_time": 38.0, "peak_memory": 4 * 10**8}
    COST.write(files.out / "costs" / "run.json", cost)
    assert stage_costs(files, ["run", "piv"]) == ({"cpu_run_s": 38.0}, 400.0)
    del cost["cpu_time"]
    COST.write(files.out / "costs" / "run.json", cost)
    with pytest.raises(KeyError, match="cpu_time"):
        stage_costs(files, ["run"])


def test_the_shipped_study_is_sound():
    """Every row of the study of the trade loads, and its runs are named by their level or as PIV."""
    rows = read_study(ROOT / "cases" / "single_finger" / "studies" / "tradeoff.csv")
    with open(ROOT / "cases" / "single_finger" / "scene.toml", "rb") as file:
        levels = tomllib.load(file)["levels"]
    assert {row.level for row in rows} <= set(levels)
    assert "medium" in {row.run for row in rows}


def test_a_row_may_name_another_scene_and_then_runs_where_that_does(tmp_path):
    """Rows of several scenes in one table; what changes nothing of its scene is that scene's own run."""
    for name in ("one", "two"):
        write_scene(tmp_path / name)
    (tmp_path / "studies").mkdir()
    table = tmp_path / "studies" / "all.csv"
    table.write_text(
        "run, scene, level, until, numerics.time_step\n"
        "one, one, tiny, run, \ntwo, two, tiny, run, \nfine, two, tiny, run, 5e-4\n"
    )
    runs = {row["run"]: row for row in json.loads(plan(table).read_text())["runs"]}
    assert Path(runs["one"]["folder"]) == tmp_path / "one"
    assert Path(runs["two"]["folder"]) == tmp_path / "two"
    assert Path(runs["fine"]["folder"]) == tmp_path / "out" / "studies" / "all" / "fine"
    assert load_scene(runs["fine"]["folder"], "tiny").numerics.time_step == 5e-4
    assert (tmp_path / "two" / "out" / "tiny" / "settings" / "case.json").exists()


def test_two_rows_in_one_place_are_refused(tmp_path):
    write_scene(tmp_path / "one")
    (tmp_path / "studies").mkdir()
    table = tmp_path / "studies" / "all.csv"
    table.write_text(
        "run, scene, level, until, ranks\na, one, tiny, run, 1\nb, one, tiny, run, 2\n"
    )
    with pytest.raises(StageError, match=r"runs a and b: both are .*one at level tiny"):
        plan(table)


def test_the_states_of_a_shipped_scene_are_not_written_over(tmp_path):
    write_scene(tmp_path / "one")
    (tmp_path / "studies").mkdir()
    table = tmp_path / "studies" / "all.csv"
    table.write_text("run, scene, level, until\na, one, tiny, fea\n")
    with pytest.raises(StageError, match="would write over the states"):
        plan(table)


def test_a_refused_run_that_may_fail_is_planned_beside_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.study.plan.foam_version", lambda: "v1912")
    scene = write_scene(tmp_path / "small")
    (scene.folder / "studies").mkdir()
    table = scene.folder / "studies" / "edges.csv"
    table.write_text(
        "run, level, until, may_fail, numerics.time_step, model.kind\n"
        "good, tiny, run, yes, , \nodd, tiny, run, yes, 3e-4, \nsure, tiny, run, no, , \n"
    )
    runs = {row["run"]: row for row in json.loads(plan(table).read_text())["runs"]}
    assert runs["good"]["owners"] == {}  # shares nothing, and nobody shares it
    assert runs["sure"]["owners"]["mesh"] == "sure"
    asked = {
        name: json.loads((Path(runs[name]["folder"]) / "out" / "tiny" / "asked.json").read_text())
        for name in ("good", "odd")
    }
    assert "numerics.time_step" in asked["odd"]["scene"]
    assert runs["odd"]["estimates"] == {}
    before = (Path(runs["good"]["folder"]) / "out" / "tiny" / "asked.json").stat().st_mtime_ns
    plan(table)  # nothing changed: nothing is to be run again
    assert (
        Path(runs["good"]["folder"]) / "out" / "tiny" / "asked.json"
    ).stat().st_mtime_ns == before


@pytest.mark.parametrize(
    "rows, said",
    [("a, tiny, vortices, yes\n", "may fail ends with one of"), ("a, tiny, run, perhaps\n", "may_fail = 'perhaps'"),
     ("a, tiny, run, no, 7, 8\n", "more cells than columns")],
)  # fmt: skip
def test_what_may_fail_is_said_in_one_word(tmp_path, rows, said):
    path = tmp_path / "s.csv"
    path.write_text("run, level, until, may_fail\n" + rows)
    with pytest.raises(StageError) as error:
        read_study(path)
    assert said in str(error.value)


def test_tables_in_cells_are_toml():
    assert tomllib.loads(f"a = {toml([{'pressure_kpa': -20.0, 'start': 0}, True])}") == {
        "a": [{"pressure_kpa": -20.0, "start": 0}, True]
    }


def test_a_run_of_the_studys_own_scene_lies_beneath_the_study(tmp_path):
    assert folder_of(tmp_path, "s", Row("r", "coarse")) == tmp_path / "out" / "studies" / "s" / "r"


SHIPPED = sorted((ROOT / "cases").glob("*/studies/*.csv"))


@pytest.mark.parametrize(
    "table", SHIPPED, ids=lambda path: f"{path.parent.parent.name}-{path.stem}"
)
def test_every_row_of_a_shipped_study_is_a_scene(table, tmp_path):
    """A slip in a table is found here, not after the runs before it; rows that may fail may be refused."""
    for row in read_study(table):
        folder = tmp_path / row.run
        folder.mkdir()
        parent = ROOT / "cases" / table.parent.parent.name / (row.scene or ".")
        (folder / "scene.toml").write_text(scene_text(str(parent), row))
        (folder / "kinematics").symlink_to(ROOT / "cases" / "single_finger" / "kinematics")
        try:
            load_scene(folder, row.level)
        except StageError:
            assert row.may_fail, row.run


def test_snakemakes_settings_lie_where_it_looks_for_them():
    """Beside the Snakefile; elsewhere they are ignored without a word, and a study that was killed does not go on."""
    settings = ROOT / "pipeline" / "study" / "profiles" / "default" / "config.yaml"
    assert "rerun-incomplete: true" in settings.read_text()
    assert (settings.parents[2] / "Snakefile").exists()
