"""The correlation's first passes, its second search, and the spectra of strips."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from piv.correlation import prefilter
from piv.correlation.fft_pass import window_maps
from piv.correlation.newton_step import Displacements
from piv.correlation.nodes import Nodes
from piv.correlation.options import Options
from piv.correlation.pair import Pair
from piv.correlation.passes import first_passes, reseed


def rolled(shape, shift):
    """A picture of dots and the same one moved by (x, y) px."""
    seeds = np.random.default_rng(1).random(shape) < 0.03
    a = ndimage.gaussian_filter(seeds.astype(np.float32), 1.0, mode="wrap")
    return a, np.roll(a, shift[::-1], (0, 1))


class Halves:
    """Two pictures at half resolution; which windows were asked for."""

    def __init__(self, shape, shift):
        self.pictures, self.asked = rolled(shape, shift), []

    def common(self, factor):
        return None

    def maps(self, columns, rows, shift_x, shift_y, size):
        self.asked.append((size, columns.size))
        return window_maps(*self.pictures, columns, rows, shift_x, shift_y, size)


@pytest.mark.parametrize(
    "shape, shift, search, windows",
    [
        # 3/4 of their size apart, and two along each side of a picture that is smaller
        ((70, 80), (9, -5), 128, [(64, 4), (32, 6)]),
        ((200, 220), (40, -6), 256, [(128, 4), (64, 16), (32, 72)]),
    ],
)
def test_the_first_windows_are_as_large_as_the_search_and_find_the_motion(
    shape, shift, search, windows
):
    images = Halves(shape, shift)
    rows, columns = shape
    half = Nodes(*(np.linspace(0.9, 1.1, 5) * n for n in (columns, rows)), shape, 2)
    dx, dy = first_passes(images, half, search)
    assert images.asked == windows
    np.testing.assert_allclose(dx, 2 * shift[0], atol=0.3)
    np.testing.assert_allclose(dy, 2 * shift[1], atol=0.3)


@pytest.mark.parametrize("slope, taken", [(0, 3.5), (2, 6)])
def test_of_two_peaks_the_one_that_the_neighbours_show_is_taken(slope, taken):
    """Of a window whose first peak is off by 4 px; but not where the neighbours scatter as much."""
    side = np.arange(32) - 32 * (np.arange(32) > 16)
    images = SimpleNamespace(common=lambda factor: None)

    def maps(columns, rows, shift_x, shift_y, size):
        def peaks(x, y):
            x, y = (np.reshape(q, (-1, 1, 1)) for q in (x, y))
            return np.exp(-((side - x) ** 2 + (side[:, None] - y) ** 2) / 2)

        row, column = np.divmod(np.arange(64), 8)
        each = peaks(3 + slope * (column - 3), -2 + slope * (row - 3))
        each[27] = peaks(3 + 1.5 * slope, 2) + 0.8 * peaks(3.5, -2)
        images.at = 2 * columns[27] + 0.5, 2 * rows[27] + 0.5
        return each.astype(np.float32)

    images.maps = maps
    nodes = Nodes(np.arange(400) + 0.5, np.arange(400) + 0.5, (200, 200), 2)
    dx, dy = first_passes(images, nodes, 64)
    row, column = np.searchsorted(nodes.y, images.at[1]), np.searchsorted(nodes.x, images.at[0])
    assert dx[row, column] == pytest.approx(2 * taken, abs=0.1)
    assert dy[row, column] == pytest.approx(4 if slope else -4, abs=0.1)


@pytest.mark.parametrize("near, second", [((7.4, -5.3), False), ((2.4, -0.7), True)])
def test_an_outlier_is_searched_again_round_its_neighbours_motion(near, second):
    """Of two motions at once; the weaker one gives the second peak."""
    shape = (160, 180)
    nodes = Nodes(np.arange(40.0, 140, 16), np.arange(40.0, 120, 16), shape, 1)
    known = np.ones((nodes.y.size, nodes.x.size), bool)
    known[2, 3] = False
    lost = [np.where(known, d, np.nan) for d in near]
    nothing = np.zeros(known.shape)
    vectors = Displacements(*lost, known, np.zeros_like(known), *[nothing] * 7)
    a, b = rolled(shape, (7, -5))
    pictures = [a, b + 0.7 * np.roll(a, (-1, 2), (0, 1))]
    found = reseed(nodes, pictures, vectors, Options())
    expected = (2, -1) if second else (7, -5)
    assert (found.dx[2, 3], found.dy[2, 3]) == pytest.approx(expected, abs=0.3)
    np.testing.assert_array_equal(found.second, ~known & second)


def test_the_spectra_are_of_pictures_that_lie_on_each_other():
    shape, shift = (256, 256), (7, -60)
    nodes = Nodes(np.arange(8.0, 256, 16), np.arange(8.0, 256, 16), shape, 1)
    images = Pair(list(rolled(shape, shift)), None, Options())
    dx, dy = (np.full((16, 16), d, np.float32) for d in shift)
    powers = images.powers(nodes, prefilter.default_filter().kernel, dx, dy)
    assert powers
    for cross, difference, _ in powers:
        assert difference.sum() < 1e-4 * cross.sum()
