"""The stage fea: an import from a scene, and one-sentence errors."""

import numpy as np
import pytest

from pipeline.fea.sensitivity import variations
from pipeline.fea.up_to_date import check_states
from pipeline.formats.bending_states import read
from pipeline.scene.scene import load_scene
from pipeline.structure.fea_stage import run
from piv.files.errors import StageError
from tests.finger_cell import ACTUATOR, CASE, FEA

SMALL = (
    "[fea]\nfirst_pressure_kpa = 0.0\nlast_pressure_kpa = 400.0\npressure_step_kpa = 100.0\n"
    "mesh = { cavity = 1, wall = 1, gap = 1, base = 1, bridge = 1, side = 1, wedge = 1,"
    " span = 1 }\n"
)


def write_case(folder, more):
    (folder / "scene.toml").write_text(f'extends = "{CASE}"\n{more}', encoding="utf-8")
    return load_scene(folder)


def test_import_writes_states_that_the_scene_finds(tmp_path, capsys):
    s = np.linspace(0, 0.07, 40)
    rows = ["pressure_kpa, s, x, y"]
    for p, r in ((-10, -0.08), (10, 0.08), (20, 0.04)):
        x, y = r * np.sin(s / r), r * (1 - np.cos(s / r))
        rows += [f"{p}, {a:.9f}, {b:.9f}, {c:.9f}" for a, b, c in zip(s, x, y, strict=True)]
    (tmp_path / "curves.csv").write_text("\n".join(rows))
    results = '[fea]\nengine = "import"\n[fea.results]\nfile = "curves.csv"\nthickness = 0.0165\n'
    run(write_case(tmp_path, results), False, None, 1)
    assert "warning" not in capsys.readouterr().out
    check_states(load_scene(tmp_path))
    states = read(tmp_path / "kinematics" / "states.h5")
    np.testing.assert_allclose(states.radius, [-0.08, 0.08, 0.04], rtol=1e-6)
    assert states.about["solver"] == "imported from curves.csv"
    assert states.width == ACTUATOR.width
    run(write_case(tmp_path, results + '[motion]\nstates = "curves.csv"\n'), False, None, 1)
    assert "nothing uses these states; give motion.source = 'fea'" in capsys.readouterr().out


@pytest.mark.parametrize(
    "more, words",
    [
        ("[actuator]\nh2 = 0.02\n", r"scene\.toml: actuator: h2 = 0\.02 m must be below h1"),
        ("[actuator]\nroof = 0.006\n", "gap between chambers"),
        ("[actuator]\nb1 = 0.014\n", "no cavity"),
        ("[actuator]\nh1 = 12.0\n", "less than 1"),
        ('[fea]\nengine = "import"\n', r"\[fea.results\]"),
        ("[actuator]\nwidht = 0.02\n", r"actuator\.widht: this key is .* did you mean width\?"),
        ("[fea]\nmesh = { wall = 0 }\n", r"fea\.mesh\.wall: .*\(got 0\)"),
        ('[fea]\nengine = "calculix"\n', r"fea\.engine: .*unit_cell"),
        ("[finger]\nlength = 0.05\n", r"\[actuator\] is 0\.07 m long, .* as chambers = 6"),
        (SMALL + "partial = true\nuncertainty = true\n", "goes with uncertainty = false"),
        (SMALL, r"converges only between 0 and .* narrow"),
    ],
)
def test_impossible_actuator_or_analysis_is_one_sentence(tmp_path, monkeypatch, more, words):
    monkeypatch.setattr("pipeline.fea.cell.path.LARGEST_STEP", 4e4)  # give up soon
    monkeypatch.setattr("pipeline.fea.cell.path.LEAST_STEP", 1.5e4)
    with pytest.raises(StageError, match=words) as error:
        run(write_case(tmp_path, more), True, None, 1)
    assert "\n" not in str(error.value)


def test_partial_keeps_the_states_that_converge(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.fea.cell.path.LARGEST_STEP", 4e4)
    monkeypatch.setattr("pipeline.fea.cell.path.LEAST_STEP", 1.5e4)
    run(write_case(tmp_path, SMALL + "partial = true\nuncertainty = false\n"), True, None, 1)
    states = read(tmp_path / "kinematics" / "states.h5")
    assert 1 <= len(states.pressure) < 5
    assert states.radius_std is None


def test_split_of_the_material_keeps_its_small_strain_stiffness():
    split = variations(ACTUATOR, FEA)["C01 = 0 or 0.4 of C10 + C01"]
    for actuator, _ in split:
        p = actuator.materials.upper.parameters
        assert p["C10"] + p["C01"] == pytest.approx(134.2e3 + 33.6e3, rel=1e-12)
