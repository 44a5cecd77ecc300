"""What the head of a page says of the level and of the finger's work."""

import pytest

from postprocess.report import trust

TABLE = """# {"format": "tradeoff"}
run,level,kind,cells,error,error_circulation,error_centre,error_velocity,error_force
fine,fine,flow,600000,0.06,0.03,0.06,0.02,0.04
smoke,smoke,flow,3000,1.718,0.88,0.2,0.19,1.718
draft,draft,flow,30000,0.142,0.142,0.1,0.04,0.08
piv,draft,piv,30000,0.02,0.02,0.01,0.006,
"""


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "finger"
    (folder / "studies" / "results").mkdir(parents=True)
    (folder / "studies" / "results" / "tradeoff.csv").write_text(TABLE)
    (folder / "scene.toml").write_text('title = "A finger"\n')
    return folder


def test_a_level_is_as_wrong_as_the_trade_says(scene):
    told = trust.level_sentence(trust.level_errors(scene, "draft"), "finger", "draft").replace(
        "\u00a0", " "
    )
    assert "Level draft errs by 14.2 % at worst (circulation of the tip vortex)" in told
    assert "force on the finger 8.0 %" in told
    assert (
        "against level fine, the finest that was run, whose own error is estimated at 6.0 %" in told
    )
    assert trust.trial(trust.level_errors(scene, "draft"), "draft") == ""


def test_the_dorsal_side_is_said_where_it_was_measured(scene):
    results = scene / "studies" / "results" / "tradeoff.csv"
    head, columns, fine, smoke, draft, piv = TABLE.splitlines()
    results.write_text(
        "\n".join(
            [head, f"{columns},error_dorsal", f"{fine},0.1", f"{smoke},0.9", f"{draft},0.02", piv]
        )
    )
    errors = trust.level_errors(scene, "draft")
    assert "on the dorsal side of the tip 2.0\u00a0%" in trust.level_sentence(
        errors, "finger", "draft"
    )
    assert errors["error"] == 0.142


def test_the_finest_level_is_extrapolated(scene):
    assert "extrapolated" in trust.level_sentence(
        trust.level_errors(scene, "fine"), "finger", "fine"
    )


def test_a_run_of_the_family_of_grids_judges_where_it_is_the_finest(scene):
    table = scene / "studies" / "results" / "tradeoff.csv"
    table.write_text(TABLE + "grid_reference,reference,grid,1700000,0.04,0.04,0.03,0.02,0.02\n")
    told = trust.level_sentence(trust.level_errors(scene, "draft"), "finger", "draft")
    assert (
        "against level reference, the finest that was run, whose own error is estimated at 4.0\u00a0%"
        in told
    )


def test_smoke_is_a_trial(scene):
    assert trust.trial(trust.level_errors(scene, "smoke"), "smoke").endswith(
        "wrong by up to 172\u00a0%"
    )


def test_a_scene_that_extends_another_has_its_table(scene, tmp_path):
    child = tmp_path / "child"
    child.mkdir()
    (child / "scene.toml").write_text('extends = "../finger"\n')
    told = trust.level_sentence(trust.level_errors(child, "draft"), "child", "draft")
    assert told.endswith("on scene finger.")


def test_what_was_not_measured_is_said(scene):
    assert trust.level_errors(scene, "medium") == {}
    assert "was not measured" in trust.level_sentence({}, "finger", "medium")


def test_the_power_balance_in_short():
    taken = {"viscous": 0.1, "convection": 0.2, "coupling": 0.1}
    told = trust.power_sentence({"work": -1.0, "taken": taken, "unexplained_fraction": -0.006})
    assert "take 30\u00a0%" in told
    assert "0.6\u00a0% is unexplained" in told
