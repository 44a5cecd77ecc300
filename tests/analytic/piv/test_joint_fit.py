"""Which vortices a disc's fit takes along, which fits stand, and how many vectors tell them."""

from types import SimpleNamespace

import numpy as np
import pytest

from piv.formats.plane_series import make_plane
from piv.vortices.find import plane_of
from piv.vortices.joint_fit import (
    _correlated_points,
    _correlation_factor,
    _distinct,
    _fit_disc,
    _plausible,
    _seen_share,
)
from piv.vortices.lamb_oseen_fit import velocities
from piv.vortices.settings import VortexSettings

AXIS = np.arange(-20.0, 20.1)
X, Y = np.meshgrid(AXIS, AXIS)
PAIR = np.array([[0, 8, 50, 3], [0, 14, -30, 3], [0.0, -18, 40, 3]])  # and one beyond the disc


def fitted(vortices, wrong=0.0):
    """The fit of the first vortex over three core radii; `wrong`: of the vector on that circle."""
    settings = VortexSettings()
    u, v = (q.reshape(X.shape) for q in velocities(X.ravel(), Y.ravel(), vortices))
    u[28, 11] += wrong
    plane = plane_of(make_plane(AXIS, AXIS, u, v), settings)
    start = np.hstack([vortices, vortices])
    return _fit_disc(plane, vortices, start, np.ones(4), settings, 3.0, 0).fit.vortices


def test_neighbours_within_the_disc_are_fitted_unless_they_are_weak():
    np.testing.assert_allclose(fitted(PAIR), PAIR[:2], rtol=1e-4, atol=1e-4)
    assert len(fitted(np.vstack([PAIR, [-5, 8, 5, 3]]))) == 2


def test_a_vector_on_the_disc_s_edge_has_no_weight():
    np.testing.assert_array_equal(fitted(PAIR, wrong=50.0), fitted(PAIR))


@pytest.mark.parametrize(
    "found, stands",
    [
        ((20, 5, 1, 4), True),
        ((20, 5, 1, 6), False),  # a core of over half of the plane's height
        ((20, 5, -1, 4), False),
        ((9, 5, 1, 4), False),
        ((20, 11, 1, 4), False),
    ],
)
def test_a_fit_stands_where_it_is_the_region_s_vortex(found, stands):
    plane = SimpleNamespace(x=np.arange(41.0), y=np.arange(11.0))
    fit = SimpleNamespace(vortices=np.array([found], float), covariance=np.eye(4))
    assert _plausible(plane, fit, np.array([20, 5, 1, 4.0])) == stands


def test_of_two_fits_on_top_of_each_other_the_better_one_stays():
    def kept(*others):
        """Of a vortex of core radius 4 and `others`, from best to worst."""
        each = [(0, 7, 1, 4), *others]
        return _distinct(
            [SimpleNamespace(vortices=np.array([p]), explained=1 / (1 + k))
             for k, p in enumerate(each)]
        )  # fmt: skip

    # half of the larger core, or all of it where they turn against each other
    assert kept((0, 8.9, 1, 2), (0, 9.1, 1, 2)) == [0, 2]
    assert kept((3.9, 7, -1, 2), (4.1, 7, -1, 2)) == [0, 2]


def test_residuals_that_are_alike_are_fewer_independent_ones():
    rng = np.random.default_rng(2)
    u, v = (np.cumsum(rng.normal(size=(12, 5)), axis=0) for _ in "uv")
    u, v = u - u.mean(), v - v.mean()
    use = rng.random(u.shape) < 0.9
    total = 1.0
    for lag in range(1, 6):
        both = use[lag:] & use[:-lag]
        pairs = [(q[lag:][both], q[:-lag][both]) for q in (u, v)]
        alike = 2 * sum(a @ b for a, b in pairs) / sum(a @ a + b @ b for a, b in pairs)
        if alike < 0.05:
            break
        total += 2 * alike
    assert total > 2
    assert _correlated_points(u, v, use) == pytest.approx(total)
    # of a known length: the vectors within it, none of which is less than one
    assert [_correlation_factor([2.0, 1.0], None, use, length) for length in (1.5, 4.0)] == [1.5, 8]


def test_of_a_disc_at_the_plane_s_corner_only_the_plane_s_part_can_be_seen():
    seen = np.ones(X.shape, bool)
    seen[:, :2] = False
    # the quarter disc of 3 steps: 4 + 3 + 3 + 1 points by column, of which two columns are not seen
    for axis in (AXIS, AXIS + 50):
        assert _seen_share(axis, axis, seen, axis[0], axis[0], 3.0) == pytest.approx(4 / 11)
        assert _seen_share(axis, axis, seen, axis[-1], axis[-1], 3.0) == 1
