"""The whole finger by CalculiX, three chambers long, and the errors where it cannot run."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from fileio.errors import StageError
from pipeline.fea.cell.path import follow
from pipeline.fea.cell.unit_cell import UnitCell
from pipeline.fea.engines import solid
from pipeline.fea.finger import fit_circle
from pipeline.fea.settings import Actuator, Fea, Material, SolidMesh, UnitCellMesh
from pipeline.fea.solid import calculix
from pipeline.scene.scene import load_scene

ROOT = Path(__file__).parents[2]
SCENE = load_scene(ROOT / "cases" / "single_finger")
ACTUATOR = Actuator(**SCENE.actuator).model_copy(update={"chambers": 3})
COARSE = SolidMesh(cavity=2, wall=1, gap=2, base=1, bridge=1, side=1, wedge=1, span=2)
FEA = Fea(**SCENE.fea).model_copy(
    update={
        "first_pressure_kpa": 0.0,
        "last_pressure_kpa": 4.0,
        "pressure_step_kpa": 2.0,
        "solid_mesh": COARSE,
    }
)
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason=f"CalculiX (ccx) is not installed: {calculix.INSTALL}"
)


@needs_ccx
@pytest.mark.slow
def test_inner_chamber_turns_as_the_unit_cell_does(tmp_path):
    states = solid(tmp_path, ACTUATOR, FEA)
    np.testing.assert_allclose(states.pressure, [0, 2e3, 4e3])
    assert np.isinf(states.radius[0])
    assert (np.diff(states.bend_angle) > 0).all()

    same = UnitCellMesh(**COARSE.model_dump() | {"cavity": 1, "gap": 1})
    cell = UnitCell(ACTUATOR, same)
    expected = 2 * follow(cell, [4e3])[4e3].plane_angle
    steps = np.diff(states.profile[-1], axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    middles = np.linspace(0, ACTUATOR.length, len(states.profile[-1]))
    middles = (middles[1:] + middles[:-1]) / 2
    gaps = [k * ACTUATOR.pitch - ACTUATOR.gap / 2 for k in (1, 2)]
    turn = np.diff(np.interp(gaps, middles, heading))[0]
    # the ends of so short a finger matter; with eight chambers it is within 1 %
    assert turn == pytest.approx(expected, rel=0.08)
    assert fit_circle(states.profile[-1])[0] == pytest.approx(states.radius[-1], rel=0.02)


def test_suction_is_refused(tmp_path):
    with pytest.raises(StageError, match=r"suction .* first_pressure_kpa = 0"):
        solid(tmp_path, ACTUATOR, FEA.model_copy(update={"first_pressure_kpa": -4.0}))


def test_missing_program_is_named_with_its_package(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(StageError, match=r"ccx.*apt-get install calculix-ccx"):
        calculix.executable()


def test_law_that_calculix_has_not():
    with pytest.raises(ValueError, match="arruda_boyce"):
        calculix.hyperelastic(
            Material(law="arruda_boyce", parameters={"C1": 1.0, "limit": 3.0}, bulk=1e6)
        )
