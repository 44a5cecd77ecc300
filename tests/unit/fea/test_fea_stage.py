"""The stage as it is called: an import from a scene, one-sentence errors; the studies read what it wrote."""

import json
from pathlib import Path

import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.bending_states import read
from pipeline.fea.sensitivity import variations
from pipeline.fea.settings import Actuator, Fea, UnitCellMesh
from pipeline.fea.stage import run
from pipeline.fea.studies.studies import bends_of
from pipeline.scene.scene import load_scene
from pipeline.stage_settings import update_settings
from pipeline.study.plan import plan

ROOT = Path(__file__).parents[3]
SCENE = load_scene(ROOT / "cases" / "single_finger")
ACTUATOR = Actuator(**SCENE.actuator)
SMALL = UnitCellMesh(cavity=1, wall=1, gap=1, base=1, bridge=1, side=1, wedge=1, span=1)
FEW = Fea(first_pressure_kpa=-2.0, last_pressure_kpa=2.0, pressure_step_kpa=2.0, mesh=SMALL)


def write_case(folder, more):
    text = f'extends = "{ROOT / "cases" / "single_finger"}"\n{more}'
    (folder / "scene.toml").write_text(text, encoding="utf-8")


def test_import_writes_states_that_the_scene_finds(tmp_path, capsys):
    s = np.linspace(0, 0.07, 40)
    rows = [
        f"{p}, {a:.9f}, {r * np.sin(a / r):.9f}, {r * (1 - np.cos(a / r)):.9f}"
        for p, r in ((-10, -0.08), (10, 0.08), (20, 0.04))
        for a in s
    ]
    (tmp_path / "curves.csv").write_text("\n".join(["pressure_kpa, s, x, y", *rows]))
    write_case(
        tmp_path,
        '[fea]\nengine = "import"\n[fea.results]\nfile = "curves.csv"\nthickness = 0.0165\n',
    )
    run(load_scene(tmp_path), False, 1)
    assert "warning" not in capsys.readouterr().out
    update_settings(load_scene(tmp_path), quiet=True)  # refuses states of another actuator
    states = read(tmp_path / "kinematics" / "states.h5")
    np.testing.assert_allclose(states.radius, [-0.08, 0.08, 0.04], rtol=1e-6)
    assert states.about["solver"] == "imported from curves.csv"
    assert states.width == ACTUATOR.width
    with (tmp_path / "scene.toml").open("a") as file:
        file.write('[motion]\nstates = "curves.csv"\n')
    run(load_scene(tmp_path), False, 1)
    assert "nothing uses these states; give motion.source = 'fea'" in capsys.readouterr().out


@pytest.mark.parametrize(
    "more, words",
    [
        ("[actuator]\nh2 = 0.02\n", r"scene\.toml: actuator: h2 = 0\.02 m must be below h1"),
        ("[actuator]\nwidht = 0.02\n", r"actuator\.widht: this key is not known; 'width' is"),
        ("[fea]\nmesh = { wall = 0 }\n", r"fea\.mesh\.wall: .*\(got 0\)"),
    ],
)
def test_impossible_actuator_or_analysis_is_one_sentence(tmp_path, more, words):
    write_case(tmp_path, more)
    with pytest.raises(StageError, match=words) as error:
        run(load_scene(tmp_path), True, 1)
    assert "\n" not in str(error.value)


def test_pressure_that_is_not_reached_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.fea.cell.path.LARGEST_STEP", 4e4)  # give up soon
    monkeypatch.setattr("pipeline.fea.cell.path.LEAST_STEP", 1.5e4)
    write_case(
        tmp_path,
        "[fea]\nfirst_pressure_kpa = 0.0\nlast_pressure_kpa = 400.0\npressure_step_kpa = 100.0\n"
        "mesh = { cavity = 1, wall = 1, gap = 1, base = 1, bridge = 1, side = 1, wedge = 1, span = 1 }\n",
    )
    with pytest.raises(StageError, match=r"converges only between 0 and .* narrow"):
        run(load_scene(tmp_path), True, 1)


def test_states_that_converge_are_kept_where_that_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.fea.cell.path.LARGEST_STEP", 4e4)
    monkeypatch.setattr("pipeline.fea.cell.path.LEAST_STEP", 1.5e4)
    asked = (
        "[fea]\nfirst_pressure_kpa = 0.0\nlast_pressure_kpa = 400.0\npressure_step_kpa = 100.0\npartial = true\n"
        "mesh = { cavity = 1, wall = 1, gap = 1, base = 1, bridge = 1, side = 1, wedge = 1, span = 1 }\n"
    )
    write_case(tmp_path, asked + "uncertainty = true\n")
    with pytest.raises(StageError, match="goes with uncertainty = false"):
        run(load_scene(tmp_path), True, 1)
    write_case(tmp_path, asked + "uncertainty = false\n")
    run(load_scene(tmp_path), True, 1)
    states = read(tmp_path / "kinematics" / "states.h5")
    assert 1 <= len(states.pressure) < 5
    assert states.radius_std is None


def test_a_study_of_actuators_is_read_by_its_plan(tmp_path):
    """Two rows, planned and analysed as the Snakefile does; a row that was not analysed is named."""
    write_case(
        tmp_path,
        "[fea]\nmesh = { cavity = 1, wall = 1, gap = 1, base = 1, bridge = 1, side = 1, wedge = 1, span = 1 }\n",
    )
    (tmp_path / "studies").mkdir()
    table = tmp_path / "studies" / "bending.csv"
    table.write_text(
        "run, until, actuator.width, fea.first_pressure_kpa, fea.last_pressure_kpa, fea.pressure_step_kpa, fea.uncertainty\n"
        "narrow, fea, 0.02, -2, 2, 2, false\nwide, fea, 0.028, -2, 2, 2, false\n"
    )
    planned = json.loads(plan(table).read_text())
    run(load_scene(planned["runs"][0]["folder"]), True, 1)
    with pytest.raises(StageError, match="wide was not analysed"):
        bends_of(planned)
    run(load_scene(planned["runs"][1]["folder"]), True, 1)
    bends = bends_of(planned)
    assert abs(bends["narrow"].radius[-1]) > abs(
        bends["wide"].radius[-1]
    )  # the narrower one bends less


def test_split_of_the_material_keeps_its_small_strain_stiffness():
    split = next(v for v in variations(ACTUATOR, FEW) if v.name.startswith("C01"))
    for actuator, _ in (split.low, split.high):
        p = actuator.materials.upper.parameters
        assert p["C10"] + p["C01"] == pytest.approx(134.2e3 + 33.6e3, rel=1e-12)
