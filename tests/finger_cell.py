"""The shipped finger's actuator and analysis, and a coarse unit cell for fast tests."""

from pipeline.fea.settings import Actuator, Fea, UnitCellMesh
from pipeline.formats.bending_states import read
from pipeline.scene.scene import load_scene
from tests.conftest import CASES

CASE = CASES / "single_finger"
SCENE = load_scene(CASE)
ACTUATOR, FEA = Actuator(**SCENE.actuator), Fea(**SCENE.fea)
SMALL = UnitCellMesh(cavity=1, wall=1, gap=1, base=1, bridge=1, side=1, wedge=1, span=2)


def shipped_states():
    """What `make fea` has written of it."""
    return read(CASE / "kinematics" / "states.h5")
