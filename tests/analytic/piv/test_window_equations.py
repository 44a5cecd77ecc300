"""The equations of a window against closed forms: its step, its test, its variance."""

from types import SimpleNamespace

import numpy as np
import pytest

from piv.correlation import uncertainty
from piv.correlation.cell_moments import CELL
from piv.correlation.newton_step import NEAR, Displacements, deviates, newton_step
from piv.correlation.options import Options

SHAPE = (40, 50)
GRADIENT, CURVATURE = np.array([0.6, -0.4]), np.array([[2.0, 0.5], [0.5, 1.0]])
ENERGY = 4.0, 9.0  # of both images: curvature below 0.15, their mean's 0.025, is not trusted


def sums_of(gradient, curvature, energy=ENERGY, common=3.0):
    """Sums (9, 1, 1) of a window."""
    (xx, xy), (_, yy) = curvature
    return np.array([*gradient, xx, xy, yy, *energy, common, 1.0], np.float32)[:, None, None]


@pytest.mark.parametrize(
    "sums, step, correlation",
    [
        (sums_of(GRADIENT, CURVATURE), np.linalg.solve(CURVATURE, GRADIENT), 0.5),
        # as long as the limit, in its direction
        (sums_of([6.0, 8.0], 2 * np.eye(2)), [0.6, 0.8], 0.5),
        (sums_of([0.03, -0.06], 0.01 * np.eye(2)), [0.2, -0.4], 0.5),
        # products of at most 0.8 of what the squares allow
        (sums_of(0.1 * GRADIENT, [[1, 0.95], [0.95, 1]]), [0.092 / 0.36, -0.088 / 0.36], 0.5),
        (sums_of(0.1 * GRADIENT, [[1, -0.95], [-0.95, 1]]), [0.028 / 0.36, 0.008 / 0.36], 0.5),
        (sums_of([1.0, 1.0], np.eye(2), (0.0, 9.0)), [0, 0], 0),
    ],
)
def test_a_step_solves_the_windows_equations(sums, step, correlation):
    found = [part[0, 0] for part in newton_step(sums, 1.0)]
    assert found == pytest.approx([*step, correlation], abs=1e-5)


def test_vectors_of_small_windows_are_tested_against_the_nearest_alone():
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    dx, dy = (np.sin(a / 1.6) + rng.normal(0, 0.02, SHAPE) for a in (x, y))
    asked = np.ones(SHAPE, bool), 0.1, Options()
    every, nearest = (deviates(dx, dy, *asked, near) for near in (None, np.ones(SHAPE, bool)))
    near = x < 25
    assert (every != nearest)[near].any()
    assert (every != nearest)[~near].any()
    np.testing.assert_array_equal(deviates(dx, dy, *asked, near), np.where(near, nearest, every))
    none = np.zeros(SHAPE)
    vectors = Displacements(*[none] * 11, ratio=np.where(near, NEAR - 0.1, NEAR))
    np.testing.assert_array_equal(vectors.near, near)
    assert Displacements(*[none] * 11).near is None


@pytest.mark.parametrize("few, doubted", [(uncertainty.FEW, 2.0), (0.0, 1.0)])
def test_the_variance_of_a_vector_is_that_of_its_equations(few, doubted):
    """H⁻¹ S H⁻¹ of the spread S over the window's cells; as few cells as `few` double it."""
    spread = np.array([[2.0, 0.6], [0.6, 1.0]])
    h = 2 * CURVATURE
    count = h.trace() ** 2 / uncertainty.FEW
    parts = [spread[0, 0], spread[1, 1], spread[0, 1], 0.5, 0.5, count]
    full = np.array([[[p]] for p in parts], np.float32) * np.ones(SHAPE, np.float32)
    sums = np.array([0, 0, h[0, 0], h[0, 1], h[1, 1], 1, 1, 1, 1])[:, None, None] * np.ones(SHAPE)
    nodes = SimpleNamespace(
        x=np.arange(0.0, 400, 8), factor=2.0, at_cells=lambda step: step,
        window_sums=lambda *_: (full, None),
    )  # fmt: skip
    none = np.zeros(SHAPE, np.float32)
    v = SimpleNamespace(
        step_x=none, step_y=none, cells=np.zeros((5, *SHAPE), np.float32), sums=sums
    )
    found = uncertainty.correlation_statistics(nodes, v, 8.0, 0.5, few=few)
    exact = np.diag(np.linalg.inv(h) @ spread @ np.linalg.inv(h))
    wanted = uncertainty.CALIBRATION * 2.0**2 / 0.5 * doubted * exact
    assert [part[20, 25] for part in found] == pytest.approx(wanted, rel=1e-5)
    # of cells whose neighbours hold the same noise: their own spread
    found = uncertainty.correlation_statistics(nodes, v, 8.0, 0.5, alike=1.75, few=few)
    alone = np.linalg.inv(h) @ np.array([[1.75 * 0.5, 0.6], [0.6, 1.75 * 0.5]]) @ np.linalg.inv(h)
    wanted = uncertainty.CALIBRATION * 2.0**2 / 0.5 * doubted * np.diag(alone)
    assert [part[20, 25] for part in found] == pytest.approx(wanted, rel=1e-5)


def test_one_pass_leaves_the_noise_but_what_its_window_averages():
    """A Gaussian of σ cells takes 3 / 4πσ² of white noise, of sums over 3 x 3 cells 9 as much."""
    taken = 3 / (4 * np.pi * 4**2)
    for neighbours, times in ((False, 1), (True, 9)):
        gain, kept = uncertainty.noise_budget(4.0 * CELL, 8.0, 1, neighbours)
        assert gain == pytest.approx(1.0)
        assert 1 - kept == pytest.approx(times * taken, rel=0.1)  # the sums are no points


def test_displacement_below_windows_is_what_differences_of_turbulence_leave():
    """Of white noise second differences do not grow with distance: 5/4 of its variance."""
    rng = np.random.default_rng(5)
    x = np.arange(SHAPE[1]) + np.zeros(SHAPE)
    # of a parabola: half of the square of the distance
    assert uncertainty._second_differences(x**2, 3)[10:-10, 10:-10] == pytest.approx(81 / 4)
    dx, dy = rng.normal(0, 0.2, (2, *SHAPE))
    vectors = {"dx": dx, "dy": dy, "known": np.ones(SHAPE, bool), "steep": None}
    v = SimpleNamespace(**vectors, ratio=np.full(SHAPE, 0.5))
    noise, nodes = np.full((2, *SHAPE), 0.01), SimpleNamespace(x=np.arange(0.0, 400, 8))
    found = uncertainty.unseen(nodes, v, noise, Options(window=32.0, spacing=8))
    wanted = uncertainty.UNSEEN_ADAPTED * (1.25 * 0.04 - 0.01)
    assert found.mean() == pytest.approx(wanted, rel=0.1)  # of 4,000 vectors
    # a wave of 63 vectors is resolved; one of 6 has no larger differences over 4 than over 2
    for length, left in ((20 * np.pi, 0.0), (6, 100 / 2 * (1.5 / 2) ** 2)):
        wave = {"dx": 10 * np.sin(2 * np.pi * x / length), "dy": 0 * x}
        seen = SimpleNamespace(**vectors | wave, ratio=v.ratio)
        found = uncertainty.unseen(nodes, seen, 0 * noise, Options(window=32.0, spacing=8))
        wanted = uncertainty.UNSEEN_ADAPTED * left
        assert np.median(found[0]) == pytest.approx(wanted, rel=0.02, abs=1e-7)


def test_residuals_of_cells_that_share_no_particle_are_flow():
    """Waves of 16 cells both ways: of cells two apart the products are cos 45° of the squares."""
    cells = np.zeros((5, 160, 200), np.float32)
    wave = np.sin(np.arange(200) * np.pi / 8)
    cells[0], cells[2], cells[4] = 0.6 * wave[:160, None] * wave, 1.0, 1.0
    cells[1] = np.random.default_rng(1).normal(0, 0.3, cells[1].shape)
    nodes = SimpleNamespace(factor=1, at_cells=lambda step: step, from_cells=lambda field: field)
    still = np.zeros(cells.shape[1:], np.float32)
    v = SimpleNamespace(cells=cells, step_x=still, step_y=still)
    flow, noise = uncertainty.unresolved(nodes, v, 8.0)
    assert np.median(flow) == pytest.approx(0.3**2 * np.cos(np.pi / 4), rel=0.02)
    assert np.mean(noise > 0) < 0.01
