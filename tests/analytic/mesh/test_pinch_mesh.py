"""The mesh of a pinch: nodes slide on the plane; exact mirror images and volumes of bodies."""

import numpy as np
import pytest
import shapely

from pipeline.case.interval_case import build_mesh
from pipeline.formats.mesh_intervals import read_intervals, read_planform
from pipeline.geometry.quality import cell_areas
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from piv.files.errors import StageError
from tests.conftest import write_scene

# cells of 4 mm: fewer shapes fit
LIMITS = "[mesh]\nmax_non_orthogonality_deg = 85.0\nusual_non_orthogonality_deg = 80.0\n"
EARLY = "[motion]\nend_time = 0.3\n"  # the tips meet at 0.26 s


def meshed(folder, kind="quarter", more=""):
    """A pinch on a coarse planform, up to the mesh stage."""
    scene = write_scene(folder, kind, EARLY + LIMITS + more, parent="pinch")
    for stage in (kinematics, mesh):
        stage.run(scene, quiet=True)
    return scene


@pytest.fixture(scope="module")
def quarter(tmp_path_factory):
    return meshed(tmp_path_factory.mktemp("quarter") / "pinch")


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    return meshed(tmp_path_factory.mktemp("half") / "pinch", "half")


def stages_of(scene):
    count = 1 + max(interval.mesh for interval in read_intervals(scene.out))
    return [read_planform(scene.out, k) for k in range(count)]


def test_nodes_of_the_plane_stay_on_it_and_slide(quarter):
    slid = 0.0
    for stage in stages_of(quarter):
        points = stage["points"].values
        outer = stage["outer"].values
        plane = outer[points[0, outer, 0] == 0]
        assert len(plane) > 10
        assert (points[:, plane, 0] == 0).all()  # to the last bit: never touched
        # in order: no edge of the plane turns over
        assert (np.diff(points[:, plane, 1], axis=1) > 0).all()
        slid = max(slid, np.ptp(points[:, plane, 1], axis=0).max())
        for shape in points:
            assert cell_areas(shape, stage["triangles"].values, stage["quads"].values).min() > 0
            assert shape[:, 0].max() == 0
    assert slid > 1e-3


def test_four_cells_or_more_span_the_gap(quarter):
    """Along the shortest line from the wall to the plane, where the gap is 0.5 mm."""
    stage = stages_of(quarter)[-1]
    nodes = stage["points"].values[-1]
    wall = nodes[stage["wall"].values]
    nearest = wall[wall[:, 0].argmax()]
    # nodes lie up to half a cell beside the nearest point
    assert nearest[0] == pytest.approx(-0.5e-3, abs=0.1e-3)
    line = shapely.LineString([nearest, [0.0, nearest[1]]])
    water = stage["triangles"].values[stage["body"].values == 0]
    cells = [shapely.Polygon(nodes[c]) for kind in (water, stage["quads"].values) for c in kind]
    crossed = [cell.intersection(line).length for cell in cells if cell.intersects(line)]
    assert sum(length > 1e-6 for length in crossed) >= 4


def test_both_fingers_are_the_quarter_and_its_mirror_image(quarter, half):
    for one, both in zip(stages_of(quarter), stages_of(half), strict=True):
        nodes, whole = one["points"].values, both["points"].values
        count = nodes.shape[1]
        assert (whole[:, :count] == nodes).all()
        off = nodes[0, :, 0] != 0
        assert (whole[:, count:] == nodes[:, off] * [-1, 1]).all()
        area = cell_areas(whole[-1], both["triangles"].values, both["quads"].values)
        assert area.min() > 0
        assert area.sum() == pytest.approx(0.6 * 0.3, rel=1e-13)
        body, names = both["body"].values, both["body_name"].values.tolist()
        assert names == ["water", "finger", "mirrored_finger"]
        assert (body == 1).sum() == (body == 2).sum() == (one["body"].values == 1).sum()
        outer = whole[0, both["outer"].values]
        assert shapely.Polygon(outer).equals(shapely.box(-0.3, 0.0, 0.3, 0.3))
        assert shapely.Polygon(outer).exterior.is_ccw
    one, both = ((scene.out / "mesh_quality.csv").read_text() for scene in (quarter, half))
    assert one == both


def volume(scene, stage):
    """Volume of the swept mesh in its last shape (m³), and the depth of the sweep (m)."""
    mesh = build_mesh(stage)
    nodes, levels = stage["points"].values[-1], stage["levels"].values
    areas = cell_areas(nodes, stage["triangles"].values, stage["quads"].values)
    cells = areas[mesh.cell_column] * np.diff(levels)[mesh.cell_layer]
    return float(cells.sum()), levels[-1] - levels[0], mesh


def footprint(stage, name):
    """Area of a body's footprint in the last shape, m²."""
    number = stage["body_name"].values.tolist().index(name)
    areas = cell_areas(stage["points"].values[-1], stage["triangles"].values, stage["quads"].values)
    return float(areas[: stage.sizes["triangle"]][stage["body"].values == number].sum())


def faces(mesh, name):
    return next(((s, n) for patch, s, n in mesh.patches if patch == name), None)


def test_volume_of_both_fingers(half):
    stage = stages_of(half)[-1]
    water_volume, depth, mesh = volume(half, stage)
    body = footprint(stage, "finger") + footprint(stage, "mirrored_finger")
    assert water_volume == pytest.approx(0.6 * 0.3 * depth - body * 0.014, rel=1e-13)
    assert faces(mesh, "finger")[1] == faces(mesh, "mirrored_finger")[1]
    assert faces(mesh, "mirror") is None


OBJECT = '[pinch.object]\nshape = "{shape}"\ndiameter = {diameter}\ncentre_height = 0.188\n'
SUPPORT = "[support]\nsize = [0.12, 0.02, 0.05]\nbottom = 0.25\n"


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """A cylinder between the tips and a block above the roots."""
    more = OBJECT.format(shape="cylinder", diameter=0.024) + SUPPORT
    return meshed(tmp_path_factory.mktemp("held") / "pinch", more=more)


def test_bodies_are_left_out_exactly_and_have_patches(held):
    stage = stages_of(held)[-1]
    water_volume, depth, mesh = volume(held, stage)
    assert footprint(stage, "support") == pytest.approx(0.06 * 0.02, rel=1e-12)
    rim = 0.5 * np.pi * 0.012**2
    # half a circle, as a polygon of 4 mm edges
    assert 0.97 * rim < footprint(stage, "object") < rim
    bodies = 0.014 * (footprint(stage, "finger") + footprint(stage, "object")) + 0.025 * 0.06 * 0.02
    assert water_volume == pytest.approx(0.3 * 0.3 * depth - bodies, rel=1e-12)
    for name in ("finger", "object", "support", "mirror"):
        assert faces(mesh, name)[1] > 0


def test_bodies_do_not_move_and_the_gap_to_the_object_is_kept(held):
    for stage in stages_of(held):
        points = stage["points"].values
        names = stage["body_name"].values
        for number in (2, 3):
            nodes = np.unique(stage["triangles"].values[stage["body"].values == number])
            edge = nodes[stage_boundary(stage, number)[nodes]]
            assert np.ptp(points[:, edge], axis=0).max() == 0, names[number]
    wall = points[-1][stage["wall"].values]
    ring = shapely.Point(0, 0.188).buffer(0.012, quad_segs=500)
    assert shapely.distance(ring, shapely.Polygon(wall)) == pytest.approx(0.5e-3, abs=0.1e-3)


def stage_boundary(stage, number):
    """(node,) True for nodes that a body shares with the water."""
    inside = np.zeros(stage.sizes["node"], bool)
    outside = inside.copy()
    triangles, body = stage["triangles"].values, stage["body"].values
    inside[triangles[body == number]] = True
    outside[triangles[body == 0]] = True
    return inside & outside


def test_a_support_that_touches_the_finger_is_refused(tmp_path):
    words = r"support.bottom = 0.2455 m leaves 0.\d+ mm above the finger.*raise it"
    with pytest.raises(StageError, match=words):
        meshed(tmp_path / "low", more=SUPPORT.replace("0.25", "0.2455"))
