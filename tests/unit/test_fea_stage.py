"""The stage as it is called: an import from a scene, one-sentence errors; the sweep goes on where it stopped."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import StageError
from pipeline.fea.__main__ import run
from pipeline.fea.sensitivity import variations
from pipeline.fea.settings import Actuator, Fea, UnitCellMesh
from pipeline.fea.states import read
from pipeline.fea.sweep import sweep
from pipeline.scene import load_scene

ROOT = Path(__file__).parents[2]
SCENE = load_scene(ROOT / "cases" / "single_finger")
ACTUATOR = Actuator(**SCENE.actuator)
SMALL = UnitCellMesh(cavity=1, wall=1, gap=1, base=1, bridge=1, side=1, wedge=1, span=1)
FEW = Fea(first_pressure_kpa=-2.0, last_pressure_kpa=2.0, pressure_step_kpa=2.0, mesh=SMALL)


def write_case(folder, more):
    text = f'extends = "{ROOT / "cases" / "single_finger"}"\n{more}'
    (folder / "scene.toml").write_text(text, encoding="utf-8")


def test_import_writes_states(tmp_path):
    s = np.linspace(0, 0.07, 40)
    rows = [
        f"{p}, {a:.9f}, {r * np.sin(a / r):.9f}, {r * (1 - np.cos(a / r)):.9f}"
        for p, r in ((-10, -0.08), (10, 0.08), (20, 0.04))
        for a in s
    ]
    (tmp_path / "curves.csv").write_text("\n".join(["pressure_kpa, s, x, y", *rows]))
    write_case(tmp_path, '[fea]\nengine = "import"\n[fea.results]\nfile = "curves.csv"\nthickness = 0.0165\n')
    run(tmp_path, "coarse", 1)
    states = read(tmp_path / "kinematics" / "states.h5")
    np.testing.assert_allclose(states.radius, [-0.08, 0.08, 0.04], rtol=1e-6)
    assert states.about["solver"] == "imported from curves.csv"
    assert states.width == ACTUATOR.width


def test_impossible_actuator_is_one_sentence(tmp_path):
    write_case(tmp_path, "[actuator]\nh2 = 0.02\n")
    with pytest.raises(StageError, match=r"scene\.toml: .*must be below h1") as error:
        run(tmp_path, "coarse", 1)
    assert "\n" not in str(error.value)


def test_pressure_that_is_not_reached_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.fea.path.LARGEST_STEP", 4e4)  # give up soon
    monkeypatch.setattr("pipeline.fea.path.LEAST_STEP", 1.5e4)
    write_case(
        tmp_path,
        "[fea]\nfirst_pressure_kpa = 0.0\nlast_pressure_kpa = 400.0\npressure_step_kpa = 100.0\n"
        "mesh = { cavity = 1, wall = 1, gap = 1, base = 1, bridge = 1, side = 1, wedge = 1, span = 1 }\n",
    )
    with pytest.raises(StageError, match=r"converges only between 0 and .* narrow"):
        run(tmp_path, "coarse", 1)


def test_sweep_solves_only_what_is_missing(tmp_path):
    cases = {name: (ACTUATOR.model_copy(update={"width": w}), FEW) for name, w in (("a", 0.02), ("b", 0.028))}
    first = sweep(cases, tmp_path, 1)
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.csv")}
    assert len(stamps) == 2
    next(tmp_path.glob("a-*.csv")).unlink()
    again = sweep(cases, tmp_path, 1)
    kept = next(tmp_path.glob("b-*.csv"))
    assert kept.stat().st_mtime_ns == stamps[kept]
    for name in cases:
        np.testing.assert_array_equal(again[name].radius, first[name].radius)
    assert abs(first["a"].radius[-1]) > abs(first["b"].radius[-1])  # the narrower one bends less


def test_split_of_the_material_keeps_its_small_strain_stiffness():
    split = next(v for v in variations(ACTUATOR, FEW) if v.name.startswith("C01"))
    for actuator, _ in (split.low, split.high):
        p = actuator.materials.upper.parameters
        assert p["C10"] + p["C01"] == pytest.approx(134.2e3 + 33.6e3, rel=1e-12)
