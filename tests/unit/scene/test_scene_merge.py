"""Inheritance of scenes: tables are merged by entry, a law's parameters go with their law."""

import pytest

from pipeline.scene.read_toml import merge, read_layers, resolve
from pipeline.scene.scene import load_scene
from tests.conftest import CASES


def test_tables_are_merged_entry_by_entry():
    assert merge({"a": {"b": 1, "c": 2}}, {"a": {"c": 3}}) == {"a": {"b": 1, "c": 3}}


def test_parameters_of_another_law_replace_those_of_the_first():
    base = {"upper": {"law": "mooney_rivlin", "bulk": 2.0, "parameters": {"C10": 1.0, "C01": 2.0}}}
    over = {"upper": {"law": "yeoh", "parameters": {"C10": 3.0, "C20": 4.0, "C30": 5.0}}}
    assert merge(base, over)["upper"] == {
        "law": "yeoh", "bulk": 2.0, "parameters": {"C10": 3.0, "C20": 4.0, "C30": 5.0},
    }  # fmt: skip


PARENT = """
title = "p"
[mesh]
tip_cell = 1.0
wall_layers = 2
[numerics]
max_courant = 5.0
[levels.smoke]
model = { kind = "2d" }
mesh = { tip_cell = 2.0, near_cell = 3.0 }
numerics = { time_step = 1e-3 }
[levels.smoother]
extends = "smoke"
mesh = { near_cell = 4.0 }
"""
CHILD = """
extends = "../parent"
[model]
kind = "half"
[mesh]
tip_cell = 7.0
wall_layers = 3
[numerics]
time_step = 5e-4
max_courant = 8.0
[levels.smoke]
numerics = { max_courant = 9.0 }
"""


@pytest.fixture
def child(tmp_path):
    """A scene.toml that gives for all levels what its parent gives for one."""
    for name, text in (("parent", PARENT), ("child", CHILD)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(text)
    return tmp_path / "child" / "scene.toml"


@pytest.mark.parametrize("level, near_cell", [("smoke", 3.0), ("smoother", 4.0)])
def test_what_a_child_says_wins_over_a_level_of_its_parent(child, level, near_cell):
    table, replaced = resolve(read_layers(child), level)
    assert table == {
        "title": "p",
        "model": {"kind": "half"},
        "mesh": {"tip_cell": 7.0, "near_cell": near_cell, "wall_layers": 3},
        "numerics": {"time_step": 5e-4, "max_courant": 9.0},
    }
    # of a parent's level, by a value for all levels
    assert replaced == dict.fromkeys(("model.kind", "mesh.tip_cell", "numerics.time_step"), child)


@pytest.mark.parametrize("motion, noted", [("", True), ("[motion]\nend_time = 1.0\n", False)])
def test_a_view_for_all_levels_is_noted_unless_the_motion_is_another(child, motion, noted):
    (child.parents[1] / "parent" / "scene.toml").write_text("[levels.smoke.sheet]\nspacing = 1.0\n")
    child.write_text(f'extends = "../parent"\n{motion}[sheet]\nspacing = 2.0\n')
    assert ("sheet.spacing" in resolve(read_layers(child), "smoke")[1]) is noted


@pytest.mark.parametrize(
    "more, gone",
    [
        ('[motion]\npressure_csv = "p.csv"', {"strokes", "start_pressure_kpa"}),
        ('[levels.smoke.motion]\npressure_csv = "p.csv"', {"strokes", "start_pressure_kpa"}),
        ('[motion]\nstrokes = []\npressure_csv = "p.csv"', set()),
    ],
)
def test_a_measured_pressure_takes_the_place_of_the_strokes_and_back(tmp_path, more, gone):
    (tmp_path / "child").mkdir()
    (tmp_path / "grandchild").mkdir()
    child = tmp_path / "child" / "scene.toml"
    child.write_text(f'extends = "{CASES / "single_deflate"}"\n{more}\n')
    motion = resolve(read_layers(child), "smoke")[0]["motion"]
    assert "pressure_csv" in motion
    assert not gone & motion.keys()
    back = tmp_path / "grandchild" / "scene.toml"
    own = "strokes = [{ pressure_kpa = 5.0, start = 0.0, duration = 0.2 }]"
    back.write_text(f'extends = "../child"\n[levels.smoke.motion]\n{own}\n')
    motion = resolve(read_layers(back), "smoke")[0]["motion"]
    assert motion["strokes"] == [{"pressure_kpa": 5.0, "start": 0.0, "duration": 0.2}]
    assert "pressure_csv" not in motion


def test_a_scenes_own_states_hold_in_place_of_its_parents(tmp_path):
    """As make fea writes them; where motion.states is given, that holds."""
    child = tmp_path / "scene.toml"
    parent = CASES / "single_finger"
    child.write_text(f'extends = "{parent}"\n')
    states = str(parent / "kinematics" / "states.h5")
    assert resolve(read_layers(child), "smoke")[0]["motion"]["states"] == states
    (tmp_path / "kinematics").mkdir()
    (tmp_path / "kinematics" / "states.h5").touch()
    assert resolve(read_layers(child), "smoke")[0]["motion"]["states"] == "kinematics/states.h5"
    child.write_text(f'extends = "{parent}"\n[motion]\nstates = "mine.csv"\n')
    assert resolve(read_layers(child), "smoke")[0]["motion"]["states"] == "mine.csv"


def test_a_remark_says_what_a_child_replaces(tmp_path):
    more = '[model]\nkind = "half"\n[mesh]\ntip_cell = 1.3e-3\n[numerics]\ntime_step = 5e-4\n'
    (tmp_path / "scene.toml").write_text(f'extends = "{CASES / "single_finger"}"\n{more}')
    remark = load_scene(tmp_path, "smoke").remarks()[0]
    for word in ("mesh.tip_cell", "model.kind", "numerics.time_step", "[levels.smoke]"):
        assert word in remark
