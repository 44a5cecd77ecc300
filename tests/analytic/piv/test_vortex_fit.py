"""find_vortices on exact and noisy vortices."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.special import j1

from docs.evidence.piv.flows import TurbulentPlane
from docs.evidence.piv.pairs import render_pair
from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import make_plane
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import PEAK_RADIUS, PEAK_SWIRL, lamb_oseen
from piv.vortices.settings import VortexSettings
from piv.vortices.table import tabulate_vortices

STEP = 8.0
AXIS_X, AXIS_Y = np.arange(160) * STEP + 16, np.arange(125) * STEP + 16
X, Y = np.meshgrid(AXIS_X, AXIS_Y)
GAMMA = 6 * 2 * np.pi * 40 / PEAK_SWIRL  # peak swirl of 6 px at a core radius of 40 px


def scene(cx: float, cy: float) -> tuple[np.ndarray, np.ndarray]:
    """Vortex, weaker neighbour of the other sense, shear and drift."""
    u, v = lamb_oseen(X, Y, cx, cy, GAMMA, 40)
    du, dv = lamb_oseen(X, Y, cx + 150, cy + 40, -0.6 * GAMMA, 30)
    return u + du + 1.5 + 0.01 * (Y - cy), v + dv - 0.7


def correlated_noise(rng: np.random.Generator, size: float) -> np.ndarray:
    """Noise of standard deviation `size` as overlapping windows of 32 px give it."""
    e = ndimage.uniform_filter(rng.normal(size=X.shape), int(32 / STEP))
    return size * e / e.std()


def test_exact_field_gives_exact_parameters():
    vortices = find_vortices(
        make_plane(AXIS_X, AXIS_Y, *scene(500.3, 503.7)), rotation_prior=np.inf
    )
    assert len(vortices) == 2
    a, b = vortices
    # without noise only the sweeps' convergence remains
    assert (a.x_fit, a.y_fit) == pytest.approx((500.3, 503.7), abs=1e-3)
    assert a.circulation_fit == pytest.approx(GAMMA, rel=1e-4)
    assert a.core_radius == pytest.approx(40, rel=1e-4)
    assert b.circulation_fit == pytest.approx(-0.6 * GAMMA, rel=1e-3)
    assert b.core_radius == pytest.approx(30, rel=1e-3)


def test_accuracy_from_noisy_piv_with_neighbour_and_shear():
    rng = np.random.default_rng(20)
    errors, expected = [], []
    for _ in range(12):
        cx, cy = 500 + rng.uniform(-4, 4, 2)
        u, v = scene(cx, cy)
        plane = make_plane(
            AXIS_X, AXIS_Y, u + correlated_noise(rng, 0.03), v + correlated_noise(rng, 0.03)
        )
        a = find_vortices(plane)[0]
        errors.append(
            [a.x_fit - cx, a.y_fit - cy, a.circulation_fit / GAMMA - 1, a.core_radius / 40 - 1]
        )
        expected.append(
            [a.x_fit_std, a.y_fit_std, a.circulation_fit_std / GAMMA, a.core_radius_std / 40]
        )
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    # allowed: centre 0.1 px, circulation 1 %, core radius 2 %; times 1.3 for the scatter of an RMS
    # of 12 draws
    assert (rms < 1.3 * np.array([0.1, 0.1, 0.01, 0.02])).all(), rms
    ratio = rms / np.sqrt(np.mean(np.square(expected), axis=0))
    # the standard errors are meant to 50 %; an RMS of 12 has 20 % of its own
    assert ((ratio > 0.3) & (ratio < 1.7)).all(), ratio


def test_stated_uncertainty_of_a_circulation_holds_with_errors_that_neighbours_share():
    """Windows of 32 px every 8 px: 16 vectors share an error, so that the naive one is 4 times off.

    The RMS of 40 errors is known to 11 %; seeds 91 and 92 give 1.00 and 1.06.
    """
    rng, axis = np.random.default_rng(90), np.arange(48) * STEP
    exact = lamb_oseen(*np.meshgrid(axis, axis), 188, 190, GAMMA, 40)
    ratios = []
    for _ in range(40):
        noise = ndimage.uniform_filter(rng.normal(size=(2, 48, 48)), (1, 4, 4))
        u, v = (f + 0.1 * e / e.std() for f, e in zip(exact, noise, strict=True))
        found = find_vortices(make_plane(axis, axis, u, v))[0]
        ratios.append((found.circulation_fit - GAMMA) / found.circulation_fit_std)
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_stated_uncertainty_of_a_circulation_holds_where_piv_damps_the_vortex():
    """A core of two windows: all circulations are too large, which the residuals do not show.

    Their errors are 1.3 to 1.6 standard uncertainties; 4 without what errs alike all round.
    """
    ratios, vortex = [], (140.0, 130.0, 1500.0, 30.0)
    for seed in range(4):
        pair = render_pair(
            lambda x, y: lamb_oseen(x, y, *vortex), (260, 280), noise=0.01, seed=seed
        )
        found = find_vortices(correlate_pair(*pair, window=16, spacing=4))[0]
        assert found.circulation_fit == pytest.approx(1500, rel=0.015)
        ratios.append((found.circulation_fit - 1500) / found.circulation_fit_std)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 2


def test_given_uncertainties_weigh_the_vectors():
    rng = np.random.default_rng(5)
    u, v = scene(500, 500)
    bad = rng.random(X.shape) < 0.2
    noise = np.where(bad, 2.0, 0.01)
    plain = make_plane(
        AXIS_X, AXIS_Y, u + noise * rng.normal(size=X.shape), v + noise * rng.normal(size=X.shape)
    )
    known = plain.assign(u_std=(("y", "x"), noise), v_std=(("y", "x"), noise))
    # a fifth of wild vectors: known as such they hardly count
    told, blind = find_vortices(known)[0], find_vortices(plain)[0]
    assert abs(told.x_fit - 500) < 0.05
    assert told.circulation_fit_std < 0.3 * blind.circulation_fit_std


def test_a_known_uncertainty_widens_the_disc_as_far_as_the_model_holds():
    rng = np.random.default_rng(21)
    u, v = scene(500, 500)
    noise = correlated_noise(rng, 0.03), correlated_noise(rng, 0.03)
    std = {n: (("y", "x"), np.full(X.shape, 0.03)) for n in ("u_std", "v_std")}

    def fitted(u, v, weights="uncertainty", **more):
        plane = make_plane(AXIS_X, AXIS_Y, u + noise[0], v + noise[1]).assign(**more)
        return find_vortices(plane, weights=weights)[0]

    free, narrow = fitted(u, v, **std), fitted(u, v, weights="equal")
    # Cramér-Rao bound of this noise: 1.6 % in two core radii, 0.23 % in four
    assert abs(free.circulation_fit / GAMMA - 1) < 0.01
    assert free.circulation_fit_std < 0.5 * narrow.circulation_fit_std
    # a flow of another kind from three core radii on, ten times the noise strong
    other = 0.3 * np.clip(np.hypot(X - 500, Y - 500) / 40 - 2.5, 0, 1) * np.sin(X / 9)
    held = fitted(u + other, v, **std).circulation_fit_std
    assert held > 0.5 * narrow.circulation_fit_std
    # without the uncertainty the residuals of the smallest disc stand for it
    assert fitted(u, v).circulation_fit == pytest.approx(free.circulation_fit, rel=1e-3)
    # one component's alone cannot weigh both
    half = fitted(u, v, u_std=std["u_std"], v_std=(("y", "x"), np.zeros(X.shape)))
    assert half.circulation_fit == fitted(u, v).circulation_fit


@pytest.mark.parametrize("half_distance", [0.25, 0.4])
def test_cores_that_overlap_across_a_mirror_plane_are_two_vortices_of_equal_strength(half_distance):
    core, peak_noise = 8.0, 0.01
    axis = np.arange(-40.0, 41.0)
    x, y = np.meshgrid(axis, axis)
    sides = [lamb_oseen(x, y, s * half_distance * core, 0, s, core) for s in (-1, 1)]
    u, v = (a + b for a, b in zip(*sides, strict=True))
    exact = find_vortices(make_plane(axis, axis, u, v))
    for seed in range(2):
        rng = np.random.default_rng(seed)
        noise = [ndimage.uniform_filter(rng.normal(size=x.shape), 4) for _ in range(2)]
        noisy = (
            q + peak_noise * np.hypot(u, v).max() * e / e.std()
            for q, e in zip((u, v), noise, strict=True)
        )
        found = find_vortices(make_plane(axis, axis, *noisy))
        assert [np.sign(w.x * w.circulation_disc) for w in found] == [1, 1]
        strengths = [abs(w.circulation_disc) for w in found]
        # no noise: a few per cent of the region's edge
        assert strengths == pytest.approx([abs(exact[0].circulation_disc)] * 2, rel=0.1)
        assert found[0].x + found[1].x == pytest.approx(0, abs=0.1 * core)


def test_turbulence_is_full_of_vortices_whose_fits_differ_little():
    axis = np.arange(100) * 8.0
    x, y = np.meshgrid(axis, axis)
    u, v = TurbulentPlane(1.0, 63)(x, y)
    found = find_vortices(make_plane(axis, axis, u, v), min_part=0.05)
    assert len(found) > 30
    fitted = [w for w in found if np.isfinite(w.circulation_fit)]
    assert len(fitted) > 0.5 * len(found)
    # a disc that is widened too far swallows the eddies beside it: ten times the region's strength
    ratios = [w.circulation_fit / w.circulation_disc for w in fitted]
    assert np.mean([0.3 < r < 4 for r in ratios]) > 0.9


@pytest.mark.parametrize("scale", [1.0, 1.25e-4])
@pytest.mark.parametrize("sense", [1, -1])
def test_units_and_sense_only_scale_the_result(scale, sense):
    u, v = scene(500, 500)
    plane = make_plane(AXIS_X * scale, AXIS_Y * scale, u * scale * 500, sense * v * scale * 500)
    if sense < 0:  # mirror in y: circulation changes sign
        plane = make_plane(
            AXIS_X * scale, -AXIS_Y[::-1] * scale, u[::-1] * scale * 500, -v[::-1] * scale * 500
        )
    a = find_vortices(plane)[0]
    reference = find_vortices(make_plane(AXIS_X, AXIS_Y, u, v))[0]
    # same numbers up to rounding in the iterations
    assert a.x == pytest.approx(reference.x * scale, rel=1e-5)
    assert a.y == pytest.approx(sense * reference.y * scale, rel=1e-5)
    # a cell on the edge may change sides
    assert a.circulation_disc == pytest.approx(
        sense * reference.circulation_disc * scale**2 * 500, rel=1e-3
    )


@pytest.mark.parametrize("core", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("drift", [0.0, 3.0])
def test_the_circle_holds_a_known_part_of_a_lamb_oseen_vortex_at_any_scale(core, drift):
    u, v = lamb_oseen(X, Y, 603.0, 501.0, GAMMA, core)
    for scale in (8.0, 16.0, 24.0):
        found = find_vortices(make_plane(AXIS_X, AXIS_Y, u + drift, v - drift), scale=scale)
        a = found[0]
        # smoothed it stays a Lamb-Oseen vortex; Q > 0 ends where its swirl peaks;
        # cells of the edge: 0.5 %, of the radius 1 %; what the end of the weights makes is smaller
        wide = np.hypot(core, np.sqrt(2) * scale)
        assert a.circulation_disc == pytest.approx(
            -np.expm1(-((3 * scale / wide) ** 2)) * GAMMA, rel=0.006
        )
        assert a.radius == pytest.approx(PEAK_RADIUS * wide, rel=0.012)
        assert a.peak_vorticity == pytest.approx(GAMMA / (np.pi * wide**2), rel=0.005)
        assert (a.x, a.y) == pytest.approx((603.0, 501.0), abs=0.03 * STEP)


def test_rankine_and_taylor_green():
    r = np.hypot(X - 600, Y - 500)
    swirl = np.where(r < 60, r / 60**2, 1 / np.maximum(r, 1e-9)) * 300
    u, v = -swirl * (Y - 500) / np.maximum(r, 1e-9), swirl * (X - 600) / np.maximum(r, 1e-9)
    a = find_vortices(make_plane(AXIS_X, AXIS_Y, u, v))[0]
    assert (a.x, a.y) == pytest.approx((600, 500), abs=0.1)
    assert (a.x_fit, a.y_fit) == pytest.approx((600, 500), abs=0.1)
    # Taylor-Green: one vortex per half wave, alternating, centres on the lattice
    k, scale = np.pi / 320, 16.0
    u, v = 5 * np.sin(k * X) * np.cos(k * Y), -5 * np.cos(k * X) * np.sin(k * Y)
    vortices = find_vortices(make_plane(AXIS_X, AXIS_Y, u, v), scale=scale)
    inner = [w for w in vortices if 320 < w.x < 960 and 320 < w.y < 640]
    assert len(inner) == 2
    for w in inner:
        assert min(abs(w.x - 480), abs(w.x - 800)) < 0.5
        # a disc of 3 scales holds 2 J1(z)/z of it times the cell's largest vorticity, 10 k
        disc, z = 3 * scale, np.sqrt(2) * k * 3 * scale
        whole = 10 * k * np.pi * disc**2 * 2 * j1(z) / z
        sign = np.sign(np.sin(k * w.x) * np.sin(k * w.y))
        assert w.circulation_disc == pytest.approx(
            sign * whole * np.exp(-((k * scale) ** 2)), rel=0.01
        )


@pytest.mark.parametrize("apart, layer", [(120.0, 0.05), (160.0, 0.1)])
def test_two_vortices_that_a_layer_joins_are_two(apart, layer):
    """As the rolls at both corners of a finger's end, which its layer joins to one region."""
    blobs = [(600 + side * apart / 2, 500.0, GAMMA, 40.0) for side in (-1, 1)]
    blobs += [
        (600 + part * apart / 2, 440.0, layer * GAMMA, 25.0) for part in np.linspace(-1, 1, 9)
    ]
    u, v = (sum(f) for f in zip(*(lamb_oseen(X, Y, *blob) for blob in blobs), strict=True))
    found = find_vortices(make_plane(AXIS_X, AXIS_Y, u, v))
    # the layer pulls their centroids towards its middle by less than a core radius
    assert sorted(a.x for a in found) == pytest.approx([600 - apart / 2, 600 + apart / 2], abs=40)
    assert [a.y for a in found] == pytest.approx([500, 500], abs=40)


def test_a_strained_vortex_is_a_vortex():
    u, v = lamb_oseen(X, Y, 600.0, 500.0, GAMMA, 40.0)
    strain = 0.3 * GAMMA / (np.pi * 40**2)  # of the peak vorticity before smoothing
    found = find_vortices(
        make_plane(AXIS_X, AXIS_Y, u + strain * (X - 600), v - strain * (Y - 500))
    )
    assert len(found) == 1
    assert (found[0].x, found[0].y) == pytest.approx((600, 500), abs=1)


def test_noise_and_uniform_flow_hold_no_vortex_worth_the_name():
    rng = np.random.default_rng(1)
    assert find_vortices(make_plane(AXIS_X, AXIS_Y, np.ones(X.shape), np.ones(X.shape))) == []
    noisy = make_plane(
        AXIS_X, AXIS_Y, 3 + 0.03 * rng.normal(size=X.shape), 0.03 * rng.normal(size=X.shape)
    )
    limit = 0.02 * GAMMA  # noise of 0.03 px makes eddies of a few cells and tenths of a px
    assert find_vortices(noisy, min_circulation=limit) == []


def test_what_is_not_a_plane_is_refused():
    u = np.zeros((2, 10, 10))
    series = make_plane(np.arange(10), np.arange(10), u, u, time=np.arange(2.0))
    with pytest.raises(ValueError, match="over \\(y, x\\)"):
        find_vortices(series)
    with pytest.raises(ValueError, match="unknown vortex option"):
        find_vortices(series.isel(time=0), treshold=1)
    with pytest.raises(ValueError, match=r"scale = 0\.4 is less than half a grid step of 1"):
        find_vortices(series.isel(time=0), scale=0.4)
    for name in ("scale", "correlation_length"):
        with pytest.raises(ValueError, match=f"{name} = 10 exceeds the plane, which is 9 wide"):
            find_vortices(series.isel(time=0), **{name: 10.0})


def test_a_layer_on_a_wall_is_no_vortex():
    """Shear of one sense along a straight wall and round its end."""
    x = np.linspace(-20.0, 20.0, 161)
    xx, yy = np.meshgrid(x, x)
    body = (np.abs(xx) < 4) & (yy > 0)
    along = np.exp(-np.hypot(np.maximum(np.abs(xx) - 4, 0), np.maximum(-yy, 0)) / 1.5)
    u, v = np.where(yy < 0, along, 0.0), np.where(yy < 0, 0.0, np.sign(xx) * along)
    assert find_vortices(make_plane(x, x, u, v, valid=~body), scale=1.0, min_circulation=1.0) == []


def test_a_hole_in_the_vectors_of_a_core_is_no_missing_vortex():
    """Rejected vectors (flag 1) lie in the water: their neighbours tell the flow between them."""
    u, v = lamb_oseen(X, Y, 600.0, 500.0, GAMMA, 60.0)
    whole = find_vortices(make_plane(AXIS_X, AXIS_Y, u, v))[0]
    hole = np.hypot(X - 600, Y - 500) < 20
    plane = make_plane(AXIS_X, AXIS_Y, u, v, valid=~hole, flag=hole.astype(np.uint8))
    found = find_vortices(plane)[0]
    # a linear fit over two steps of smoothing misses some of the curvature: 4 %
    assert found.circulation_disc == pytest.approx(whole.circulation_disc, rel=0.06)
    assert (found.x, found.y) == pytest.approx((600, 500), abs=1.0)


def test_a_vortex_whose_disc_meets_the_edge_is_flagged_and_told_by_its_fit():
    """Of the disc three smoothing lengths (6 mm) wide a part lies beyond the plane."""
    x, y = np.arange(0, 0.06, 5e-4), np.arange(0, 0.05, 5e-4)
    gx, gy = np.meshgrid(x, y)
    for distance, at_edge in ((0.003, True), (0.0055, True), (0.02, False)):
        u, v = lamb_oseen(gx, gy, x[-1] - distance, 0.02, 0.01, 3e-3)
        plane = make_plane(x, y, u, v)
        (seen,) = find_vortices(plane, scale=2e-3, min_part=0.5)
        assert seen.at_edge is at_edge
        assert np.isnan(seen.circulation_disc) == np.isnan(seen.circulation_disc_std) == at_edge
        if distance == 0.003:
            assert np.isnan([seen.circulation, seen.circulation_fit]).all()
        else:
            assert seen.circulation == seen.circulation_fit == pytest.approx(0.01, rel=1e-3)
            assert seen.circulation_std == seen.circulation_fit_std < 1e-4
        assert seen.peak_vorticity > 0
        row = tabulate_vortices(plane, VortexSettings(scale=2e-3, min_part=0.5)).iloc[0]
        assert bool(row["at_edge"]) is at_edge
