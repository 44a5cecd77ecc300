"""The morph: exact derivatives, exact invariants, no inversion."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.geometry.quality import Quality, planform_edges, shape_quality
from pipeline.mesh.morph import Morph, MorphError, corner_triangles
from pipeline.mesh.planform import build_planform
from pipeline.mesh.shape_sequence import ShapeSequence, morph_shapes
from pipeline.mesh.stage import check_quality
from pipeline.mesh.sweep_levels import graded_layers
from pipeline.mesh.wall_layers import outline_at
from pipeline.scene.sections import Mesh
from tests.conftest import write_scene

CELLS = {"wall_cell": 3e-3, "tip_cell": 2e-3, "near_cell": 4e-3, "far_cell": 0.04}
MESH = Mesh(wall_first_layer=1e-3, wall_layers=2, near_distance=0.01, **CELLS)


def slab(angle=0.0, at=(0.0, 0.15)):
    """Outline of a 14 x 60 mm slab turned by `angle` about its middle."""
    t = np.linspace(0, 1, 20, endpoint=False)
    corners = np.array([[-0.007, -0.03], [0.007, -0.03], [0.007, 0.03], [-0.007, 0.03]])
    sides = zip(corners, np.roll(corners, -1, 0), strict=True)
    loop = np.vstack([begin + t[:, None] * (end - begin) for begin, end in sides])
    c, s = np.cos(angle), np.sin(angle)
    return loop @ np.array([[c, s], [-s, c]]) + np.array(at)


@pytest.fixture(scope="module")
def planform():
    return build_planform(slab(), np.array([0, 0.12]), 0.1, 0.3, MESH, np.array([[0, 0.12]]))


def morph_of(planform, free_outer=False):
    fixed = np.zeros((len(planform.nodes), 2), bool)
    fixed[planform.wall] = True
    fixed[planform.outer] = not free_outer
    return Morph(planform.nodes, corner_triangles(planform.triangles, planform.quads), fixed)


@pytest.mark.parametrize("stretch", [1.3, 0.8])
def test_gradient_and_hessian_are_those_of_the_energy(planform, stretch):
    """Squeezed to 0.8, triangles are not convex: the made-positive Hessian is another."""
    morph, rng = morph_of(planform), np.random.default_rng(2)
    x = stretch * planform.nodes + rng.normal(size=planform.nodes.shape) * 2e-5
    d = rng.normal(size=x.shape) * 1e-5
    gradient, positive = morph.derivatives(x)
    _, hessian = morph.derivatives(x, exact=True)
    h = 1e-3
    numeric = (morph.energy(x + h * d) - morph.energy(x - h * d)) / (2 * h)
    # cancellation in an energy of some 1e3
    assert numeric == pytest.approx(gradient @ d.ravel(), rel=1e-6)
    ahead, behind = (morph.derivatives(x + k * h * d)[0] for k in (1, -1))
    curve = d.ravel() @ (ahead - behind) / (2 * h)
    exact, made = (d.ravel() @ matrix @ d.ravel() for matrix in (hessian, positive))
    assert curve == pytest.approx(exact, rel=1e-5)
    assert made == exact if stretch > 1 else made > exact * (1 + 1e-3)


def test_a_rigidly_turned_body_turns_the_whole_mesh_rigidly(planform):
    """With the tank free nothing resists a rotation: the energy stays at its minimum."""
    morph = morph_of(planform, free_outer=True)

    def turned(angle):
        x = planform.nodes.copy()
        x[planform.wall] = outline_at(slab(angle), planform.material)
        return x

    x = morph.follow(morph.relax(planform.nodes), turned, 0.0, 1.2)
    c, s = np.cos(1.2), np.sin(1.2)
    expected = (planform.nodes - [0, 0.15]) @ np.array([[c, s], [-s, c]]) + [0, 0.15]
    assert x == pytest.approx(expected, abs=1e-9)
    assert morph.energy(x) == pytest.approx(2 * len(morph.triangles), rel=1e-9)


def test_the_mesh_never_inverts_and_an_impossible_move_says_so(planform):
    morph = morph_of(planform)

    def moved(shift):
        x = planform.nodes.copy()
        x[planform.wall] = outline_at(slab(at=(shift, 0.15)), planform.material)
        return x

    far = morph.follow(morph.relax(planform.nodes), moved, 0.0, 0.05)
    assert morph.is_valid(far)
    with pytest.raises(MorphError):  # through the tank's wall
        morph.follow(far, moved, 0.05, 0.1)


def test_a_mesh_that_is_pursued_errs_to_second_order_in_the_move(planform):
    """One Newton step: half of the move leaves a quarter of the error."""
    morph = morph_of(planform)
    relaxed = morph.relax(planform.nodes)
    pursue, errors = morph.pursuit(relaxed), []
    for angle in (0.02, 0.01):
        target = relaxed.copy()
        target[planform.wall] = outline_at(slab(angle), planform.material)
        exact = morph.relax(morph.approach(relaxed, target))
        errors.append(np.abs(pursue(relaxed, target) - exact).max())
        slope = morph.derivatives(exact + 1e-5, exact=True)[0]
        assert morph._slope(exact + 1e-5) == pytest.approx(slope, abs=1e-9 * np.abs(slope).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[0] < 0.02 * 0.03 * 0.02  # of the move of the slab's end


@pytest.mark.parametrize("stretch", [1.0, 10.0])
def test_the_quality_of_a_square_beside_a_trapezium(stretch):
    """Centroids at (1, 1) and (28/9, 14/9): their line leaves the side's middle by 5/19."""
    place = [[0, 0], [2, 0], [2, 2], [0, 2], [4, 0], [4, 4]]
    nodes = np.array(place) * [stretch, 1.0]
    quads, triangles = np.array([[0, 1, 2, 3], [1, 4, 5, 2]]), np.zeros((0, 3), int)
    edges = planform_edges(triangles, quads)
    assert sorted(map(tuple, np.sort(edges.nodes, axis=1))) == [
        (0, 1), (0, 3), (1, 2), (1, 4), (2, 3), (2, 5), (4, 5)
    ]  # fmt: skip
    built = SimpleNamespace(triangles=triangles, quads=quads, nodes=nodes * [2.0, 1.0])
    angle, span = np.degrees(np.arctan(5 / 19 / stretch)), np.hypot(19 / 9 * stretch, 5 / 9)
    wanted = Quality(angle, angle, 5 / 19 / max(0.2 * span, 1.0), 0.5)
    assert vars(shape_quality(built, nodes)) == pytest.approx(vars(wanted))


def test_a_stroke_that_breaks_the_mesh_is_refused_with_the_bend_at_which_it_does(planform):
    outlines = np.array([slab(a) for a in np.linspace(0, 2.0, 9)])
    bends = np.linspace(0, 2, 9)
    tips = np.tile([0.0, 0.12], (9, 1))
    shapes = ShapeSequence(np.arange(9.0), outlines, tips, bends, tips[:, None])
    quality = [shape_quality(planform, nodes) for nodes in morph_shapes(planform, shapes, 0)]
    angles = [q.max_non_orthogonality_deg for q in quality]
    assert angles[-1] > angles[0] + 1
    loose = MESH.model_copy(update={"max_non_orthogonality_deg": max(angles) + 1})
    tight = MESH.model_copy(update={"max_non_orthogonality_deg": max(angles) - 0.5})
    for measured, bend in zip(quality, bends, strict=True):
        check_quality(measured, bend, loose)
    worst = int(np.argmax(angles))
    words = rf"reaches .*° at {np.degrees(bends[worst]):.1f}° of bend"
    with pytest.raises(MorphError, match=words):
        check_quality(quality[worst], bends[worst], tight)


@pytest.mark.parametrize("kind, count", [("2d", 2), ("half", 6), ("full", 11)])
def test_layers_fill_the_tank_and_split_at_the_fingers_side(tmp_path, kind, count):
    scene = write_scene(tmp_path / "s", kind)
    z = graded_layers(scene.model.kind, scene.finger.width, scene.tank.size[2], scene.mesh)
    assert len(z) == count
    assert (np.diff(z) > 0).all()
    if kind != "2d":
        assert z[0] == pytest.approx(-0.15)
        assert np.abs(np.abs(z) - 0.014).min() < 1e-12
        assert 0.0 in z
        assert z[-1] == pytest.approx(0.15 if kind == "full" else 0.0)


@pytest.mark.parametrize("limit, highest", [(70.0, 78.0), (85.0, 90.0)])
def test_a_mesh_that_follows_may_exceed_the_limit_but_no_right_angle(limit, highest):
    mesh = MESH.model_copy(update={"max_non_orthogonality_deg": limit})
    check_quality(Quality(highest, 20.0, 0.3, 0.5), 1.0, mesh, 8.0)
    with pytest.raises(MorphError, match=rf"_deg = {limit:g} \({highest:g}° in a coupled run\)"):
        check_quality(Quality(highest + 0.1, 20.0, 0.3, 0.5), 1.0, mesh, 8.0)
