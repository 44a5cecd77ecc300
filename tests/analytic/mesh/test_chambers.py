"""Gaps between chambers: their area, the clearance in them, a mesh that follows to contact."""

import numpy as np
import pytest
import shapely

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import read_planform
from pipeline.geometry.quality import cell_areas
from pipeline.kinematics import stage as kinematics
from pipeline.kinematics.shapes import Strip, rounded_strip, with_chambers
from pipeline.mesh import stage as mesh
from pipeline.scene.sections import Chambers
from piv.files.errors import StageError
from tests.conftest import write_scene

LENGTH, HEIGHT = 0.07, 0.0167
TABLE = """[finger.chambers]
count = 8
gap = 0.002
floor = 0.0069
wedge_from = 0.0095
wedge_deg = {}
"""


def strip(wedge_deg: float) -> Strip:
    s, thickness = np.linspace(0, LENGTH, 71), np.full(71, HEIGHT)
    chambers = Chambers(count=8, gap=0.002, floor=0.0069, wedge_from=0.0095, wedge_deg=wedge_deg)
    of = rounded_strip(LENGTH, thickness, s, 0.002, 0.002)
    return with_chambers(of, chambers, LENGTH, thickness, s)


@pytest.mark.parametrize("wedge_deg", [0.0, 15.0])
def test_seven_gaps_of_the_given_size_are_missing(wedge_deg):
    of = strip(wedge_deg)
    outline = shapely.Polygon(np.column_stack([of.s, of.eta * HEIGHT]))
    # its corners are rounded by 2 mm
    slab = shapely.box(0, 0, LENGTH, HEIGHT).area - (4 - np.pi) * 0.002**2
    wedge = HEIGHT - 0.0095
    gap = 0.002 * (HEIGHT - 0.0069) + np.tan(np.radians(wedge_deg)) * wedge**2
    # corners of 0.7 mm: those at the ground take as much as those at the top give
    assert slab - outline.area == pytest.approx(7 * gap, rel=0.02)
    assert outline.exterior.is_ccw
    assert np.ptp(of.s) == pytest.approx(LENGTH, rel=1e-6)  # root, tip and ventral side stay
    assert of.eta.min() == pytest.approx(0, abs=1e-9)


def test_a_floor_too_thin_for_the_gaps_rounding_is_refused():
    s, thickness = np.linspace(0, LENGTH, 71), np.full(71, HEIGHT)
    chambers = Chambers(count=8, gap=0.004, floor=0.0015, wedge_from=0.0095, wedge_deg=0.0)
    of = rounded_strip(LENGTH, thickness, s, 0.002, 0.002)
    with pytest.raises(ValueError, match=r"too thin below gaps of 0.004 m.*give more than 0.0028"):
        with_chambers(of, chambers, LENGTH, thickness, s)


def test_a_mesh_follows_the_gaps_until_the_tips_meet(tmp_path):
    limits = "[mesh]\nmax_non_orthogonality_deg = 85.0\nusual_non_orthogonality_deg = 80.0\n"
    more = "[motion]\nend_time = 0.3\n" + limits + TABLE.format(15.0)
    scene = write_scene(tmp_path / "pinch", "2d", more, parent="pinch")
    for stage in (kinematics, mesh):
        stage.run(scene, quiet=True)
    shapes = read_kinematics(scene.out / "kinematics.h5").data["shape_outline"].values
    areas = [shapely.Polygon(shape).area for shape in shapes]
    assert min(areas) < 0.85 * LENGTH * HEIGHT  # a fifth is gaps
    planform = read_planform(scene.out, 0)
    for points in planform["points"].values:
        assert cell_areas(points, planform["triangles"].values, planform["quads"].values).min() > 0


def test_chambers_without_walls_between_their_gaps_are_refused(tmp_path):
    with pytest.raises(ValueError, match="wedge_from"):
        Chambers(count=8, gap=0.002, floor=0.010, wedge_from=0.009)
    words = r"finger\.chambers: 8 chambers, 9 mm from one to the next"
    with pytest.raises(StageError, match=words):
        kinematics.kinematics_values(write_scene(tmp_path / "s", "2d", TABLE.format(40.0)))
