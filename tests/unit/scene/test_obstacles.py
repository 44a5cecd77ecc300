"""[[obstacle]]: what is refused, and what the mesh makes of the rest."""

import numpy as np
import pytest
import shapely

from pipeline.case.interval_case import build_mesh, obstacles_text
from pipeline.formats.mesh_intervals import read_intervals, read_planform
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.obstacle import Obstacle
from piv.files.errors import StageError
from tests.conftest import prepare, write_scene

BOX = '[[obstacle]]\nshape = "box"\ncentre = [-0.06, 0.17]\nsize = [0.02, 0.04]\n'
CROSSED = """[[obstacle]]
shape = "polygon"
points = [[0.1, 0.1], [0.12, 0.12], [0.12, 0.1], [0.1, 0.12]]
"""


def circle(x, y, more=""):
    return f'[[obstacle]]\nshape = "circle"\ncentre = [{x}, {y}]\ndiameter = 0.02\n{more}\n'


@pytest.mark.parametrize(
    "text, words",
    [
        (circle(0.0, 0.18), r"finger meets obstacle\[0\] \(circle\) at .*; move it"),
        (circle(0.04, 0.2), r"finger meets obstacle\[0\] \(circle\) at .*; move it"),
        (circle(0.295, 0.16), r"reaches x from 0\.285 .*; keep it within"),
        (circle(0.08, 0.16, "depth = 0.0281"), r"depth = 0\.0281 m .*; give 0\.028"),
        (circle(0.08, 0.16, "depth = 0.5"), r"depth = 0\.5 m .* give 0\.3"),
        (circle(0.08, 0.16, "size = [1, 1]"), "size is not of shape = 'circle'; remove"),
        (circle(0.08, 0.16) * 2, r"obstacle\[0\] and obstacle\[1\] are nearer"),
        (circle(0.08, 0.16) * 9, "9 tables; give at most 8"),
        (BOX.replace("0.04", "0.001"), "thinner than 2 mesh.wall_cell"),
        (BOX.replace("size = ", "points = "), "obstacle"),
        (CROSSED, "sides cross each other; give the corners in order"),
    ],
)
def test_an_impossible_obstacle_is_refused_in_one_sentence(tmp_path, text, words):
    with pytest.raises(StageError, match=words) as error:
        kinematics_values(write_scene(tmp_path / "s", more=text))
    assert "\n" not in str(error.value)


def test_outlines_run_counter_clockwise_around_the_stated_shape():
    disc = Obstacle(shape="circle", centre=(0.1, 0.2), diameter=0.04)
    assert disc.polygon.area == pytest.approx(np.pi * 0.02**2, rel=2e-5)  # 720 corners
    box = Obstacle(shape="box", centre=(0.1, 0.2), size=(0.04, 0.02))
    assert box.polygon.bounds == pytest.approx((0.08, 0.19, 0.12, 0.21))
    clockwise = Obstacle(shape="polygon", points=((0, 0), (0, 1), (1, 0)))
    for thing in (disc, box, clockwise):
        line = np.vstack(thing.pieces)
        assert (line[0] == line[-1]).all()
        assert shapely.LinearRing(line).is_ccw


def test_the_mesh_leaves_them_out_and_keeps_its_quality(tmp_path):
    """A short cylinder beside the moving tip, and a box from wall to wall, in half of the tank."""
    more = circle(0.07, 0.16, "depth = 0.06") + BOX
    scene = prepare(write_scene(tmp_path / "s", kind="half", more=more))
    names = ("obstacle_1", "obstacle_2")
    for interval in read_intervals(scene.out):
        planform = read_planform(scene.out, interval.mesh)
        assert set(names) <= set(planform["body_name"].values)
        swept = build_mesh(planform)
        patches = {name: count for name, _, count in swept.patches}
        assert all(patches[name] > 0 for name in names)
        points = planform["points"].values
        for name, thing in zip(names, scene.obstacle, strict=True):
            number = list(planform["body_name"].values).index(name)
            inside = planform["triangles"].values[planform["body"].values == number]
            corners = points[0][inside]
            a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
            # a circle of 20 mm in cells of 3.5 mm: 18 sides have 2 % less than it
            assert area == pytest.approx(thing.polygon.area, rel=0.03)
            nodes = points[:, np.unique(inside)]
            sides = shapely.distance(thing.polygon.exterior, shapely.points(nodes[0])) < 1e-9
            assert sides.sum() >= 8
            assert (nodes[:, sides] == nodes[:1, sides]).all()  # fixed
        text = (scene.out / "case" / interval.name / "system" / "obstacles").read_text()
        assert text == obstacles_text(list(names))
    quality = np.genfromtxt(scene.out / "mesh_quality.csv", delimiter=",", names=True, comments="#")
    assert quality["max_non_orthogonality_deg"].max() <= scene.mesh.max_non_orthogonality_deg


def test_an_obstacle_that_leaves_no_room_to_mesh_is_refused(tmp_path):
    """0.3 mm from the finger's dorsal side, which bends away from it."""
    dorsal = kinematics_values(write_scene(tmp_path / "a"))["shape_outline"][..., 0].min()
    near = f'[[obstacle]]\nshape = "box"\ncentre = [{dorsal - 0.0103}, 0.2]\nsize = [0.02, 0.01]\n'
    with pytest.raises(StageError, match=r"obstacle\[0\] is 0\.3 mm from the finger .* move it by"):
        prepare(write_scene(tmp_path / "b", more=near))


def polygon(points) -> str:
    return f'[[obstacle]]\nshape = "polygon"\npoints = {[list(map(float, p)) for p in points]}\n'


def corners_of_a_circle(count: int) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.array([0.1, 0.16]) + 0.02 * np.column_stack([np.cos(turn), np.sin(turn)])


def test_repeated_corners_are_dropped_and_corners_without_area_refused():
    """gmsh did not end with one of them."""
    corners = [(0.1, 0.1), (0.1, 0.1), (0.2, 0.2), (0.2, 0.1), (0.2, 0.1), (0.1, 0.1)]
    thing = Obstacle(shape="polygon", points=corners)
    assert sorted(thing.points) == [(0.1, 0.1), (0.2, 0.1), (0.2, 0.2)]
    assert thing.polygon.area == pytest.approx(0.005)
    for line in ([(0, 0)] * 4, [(0, 0), (1, 1), (2, 2)], [(0, 0), (1, 0), (0, 0), (1, 0)]):
        with pytest.raises(ValueError, match="enclose no area"):
            Obstacle(shape="polygon", points=line)


@pytest.mark.parametrize("count, merged", [(60, False), (1000, True)])
def test_a_circle_as_cad_exports_it_is_meshed_as_a_circle(tmp_path, count, merged):
    """The mesh of 1,000 corners had no end, and that of 100 "shorten the stroke"."""
    scene = write_scene(tmp_path / "s", more=polygon(corners_of_a_circle(count)))
    cell = 0.5 * scene.mesh.wall_cell
    (thing,) = scene.obstacle
    sides = np.hypot(*np.diff([*thing.points, thing.points[0]], axis=0).T)
    assert sides.min() >= cell
    remarks = [remark for remark in scene.remarks() if "obstacle[0].points" in remark]
    assert len(remarks) == merged
    # a side of two half cells has a sagitta of 0.1 mm on this circle
    assert thing.polygon.area == pytest.approx(np.pi * 0.02**2, rel=0.02)
    assert len(thing.pieces) == 1
    prepare(scene)


def test_short_sides_between_sharp_corners_are_merged_and_a_box_stays(tmp_path):
    notched = [(0.1, 0.1), (0.13, 0.1), (0.13, 0.12), (0.1299, 0.12), (0.1299, 0.13), (0.1, 0.13)]
    scene = write_scene(tmp_path / "s", more=polygon(notched))
    (thing,) = scene.obstacle
    assert len(thing.points) == 5
    assert "by up to 0.05 mm" in " ".join(scene.remarks())
    box = [(0.1, 0.1), (0.13, 0.1), (0.13, 0.13), (0.1, 0.13)]
    (same,) = write_scene(tmp_path / "b", more=polygon(box)).obstacle
    assert len(same.pieces) == 4
