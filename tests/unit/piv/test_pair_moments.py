"""The products of a pair made row by row are those of whole warped images."""

import cv2
import numpy as np
import pytest

from piv.correlation import prefilter
from piv.correlation.deform import Image, Nodes, cut, with_border
from piv.correlation.newton_step import CELL, MOMENTS, cell_moments
from piv.correlation.options import grid


def by_whole_images(nodes, a, b, dx, dy):
    """Both images warped one after the other, each with its own sampling weights, and then multiplied."""
    field, weight = np.empty((2, *nodes.shape), np.float32), np.empty(nodes.shape, np.float32)
    nodes.dense(dx, field[0])
    nodes.dense(dy, field[1])
    a.warp(field[0], field[1], -0.5, weight, False)
    b.warp(field[0], field[1], 0.5, weight, True)
    cells = np.empty((MOMENTS, *nodes.cell_shape), np.float32)
    cell_moments(a.warped, b.warped, weight, cells)
    return cells


@pytest.mark.parametrize("shape", [(96, 128), (61, 83), (40, 1090)])
@pytest.mark.parametrize("masked", [False, True])
def test_row_by_row_as_whole_images(shape, masked):
    """Sizes that cells and runs do not divide, more columns than a block, and windows that leave the image."""
    rng, around = np.random.default_rng(5), np.ones((3, 3), np.uint8)
    kernel = prefilter.kernel(prefilter.default_response())
    images = []
    for _ in range(2):
        seen = None
        if masked:
            seen = np.ones(shape, bool)
            seen[20:30, 30:50] = False
        images.append(Image(rng.standard_normal(shape).astype(np.float32), seen))
        images[-1].filter(kernel)
    x, y = grid(shape[1], 8), grid(shape[0], 8)
    nodes = Nodes(x, y, shape, 1)
    dx = (7.3 + 3 * np.sin(y[:, None] / 20) + 0 * x).astype(np.float32)
    dy = (-2.6 + 2 * np.cos(x / 15) + 0 * y[:, None]).astype(np.float32)
    want, got = by_whole_images(nodes, *images, dx, dy), nodes.moments(*images, dx, dy)
    # of a sample between two pixels the second image asks the other one whether it may be used: a pixel's difference at edges
    whole = cv2.erode(want[8], around) == CELL**2
    assert 0.1 < whole.mean() < 1
    assert (got[8][whole] == CELL**2).all()
    assert (got[8][cv2.dilate(want[8], around) == 0] == 0).all()
    got, want = got[:, whole], want[:, whole]
    for m in range(MOMENTS):
        # positions are sums with the pixel's number in one and not in the other: 1e-4 px at the thousandth column
        assert np.abs(got[m] - want[m]).max() < 2e-3 * np.abs(want[m]).max()


@pytest.mark.parametrize("shape", [(61, 83), (40, 1090)])
def test_of_some_cells_as_of_all(shape):
    """What is measured of some cells only is what it is among all; the others are zero."""
    rng = np.random.default_rng(9)
    images = [Image(rng.standard_normal(shape).astype(np.float32), None) for _ in "ab"]
    for image in images:
        image.filter(prefilter.kernel(prefilter.default_response()))
    nodes = Nodes(grid(shape[1], 8), grid(shape[0], 8), shape, 1)
    dx = rng.normal(0, 3, (nodes.y.size, nodes.x.size)).astype(np.float32)
    wanted = (rng.uniform(size=nodes.cell_shape) < 0.3).astype(np.uint8)
    wanted[:, -1] = 1
    every, some = nodes.moments(*images, dx, dx), nodes.moments(*images, dx, dx, wanted)
    # sums of 512 columns from another start round otherwise
    assert some == pytest.approx(np.where(wanted, every, 0), abs=float(1e-4 * np.abs(every).max()))
    where = np.zeros(dx.shape, bool)
    where[3, 4] = True
    near = nodes.window_sums(nodes.moments(*images, dx, dx, nodes.cells_around(where, 2.0)), 2.0)[0]
    # beyond the cells around it a window has 1e-3 of its weight
    assert near[:, 3, 4] == pytest.approx(
        nodes.window_sums(every, 2.0)[0][:, 3, 4], abs=float(2e-3 * near.max())
    )


def test_products_are_those_of_their_definition():
    """One cell against sums written out in double precision."""
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((2, 20, 24)).astype(np.float32)
    weight = rng.uniform(0, 1, a.shape).astype(np.float32)
    cells = np.empty((MOMENTS, 5, 6), np.float32)
    cell_moments(a, b, weight, cells)

    def slope(i, axis):
        near, far = (np.roll(i, -k, axis) - np.roll(i, k, axis) for k in (1, 2))
        return (8 * near - far) / 12

    a, b, w = a.astype(float), b.astype(float), weight.astype(float)
    ax, ay, bx, by = slope(a, 1), slope(a, 0), slope(b, 1), slope(b, 0)
    products = [(a * bx - b * ax) / 2, (a * by - b * ay) / 2, ax * bx, (ax * by + ay * bx) / 2, ay * by, a * a, b * b, a * b, 1]  # fmt: skip
    inner = np.zeros(a.shape)
    inner[2:-2, 2:-2] = w[2:-2, 2:-2]
    for m, product in enumerate(products):
        want = (inner * product).reshape(5, 4, 6, 4).sum((1, 3))
        assert cells[m] == pytest.approx(want, abs=1e-5)


@pytest.mark.parametrize("shift", [0, 4])
def test_whole_pixels_are_taken_as_they_are(shift):
    """Two views of one image, moved by whole pixels, correlate wholly and ask for no step."""
    image = np.random.default_rng(7).standard_normal((64, 80)).astype(np.float32)
    kernel = prefilter.kernel(prefilter.default_response())
    a, b = (Image(i, None) for i in (image[:, shift:], image[:, : image.shape[1] - shift]))
    a.filter(kernel)
    b.filter(kernel)
    shape = a.pixels.shape
    x, y = grid(shape[1], 8), grid(shape[0], 8)
    dx = np.full((y.size, x.size), shift + 1e-6, np.float32)
    inner = Nodes(x, y, shape, 1).moments(a, b, dx, 0 * dx)[:, 5:-5, 5:-5]
    assert np.abs(inner[0]).max() < 1e-4 * inner[5].max()
    assert inner[7] == pytest.approx(inner[5], rel=1e-4)


@pytest.mark.parametrize("window, spacing", [(32, 8), (32, 2), (128, 8), (64, 2)])
def test_windows_in_a_part_are_those_in_the_whole_images(window, spacing):
    """Where windows shrink and where gradients are steep only a part is measured: its windows are whole and warped alike."""
    shape, sigma, rng = (480, 560), window / 4, np.random.default_rng(5)
    kernel = prefilter.kernel(prefilter.default_response())
    images = [Image(rng.standard_normal(shape).astype(np.float32), None) for _ in "ab"]
    for image in images:
        image.filter(kernel)
    nodes = Nodes(grid(shape[1], spacing), grid(shape[0], spacing), shape, 1)
    dx = (3 * np.sin(nodes.y[:, None] / 20) + 2 * np.cos(nodes.x / 15)).astype(np.float32)
    rows, columns = (slice(n // 2, n // 2 + 3) for n in dx.shape)
    part = with_border((rows, columns), nodes, sigma)
    local, crops = cut(nodes, images, part, 1, sigma)
    assert local.shape != shape
    whole, full = nodes.window_sums(nodes.moments(*images, dx, dx), sigma)
    found, _ = local.window_sums(local.moments(*crops, dx[part], dx[part]), sigma)
    inner = tuple(
        slice(b.start - p.start, b.stop - p.start)
        for b, p in zip((rows, columns), part, strict=True)
    )
    want, got = whole[:, rows, columns], found[(slice(None), *inner)]
    scale = np.sqrt(want[5] * want[6])  # the images' energy
    for m in range(MOMENTS):
        assert (
            np.abs(got[m] - want[m]) < 2e-3 * (full[rows, columns] if m == MOMENTS - 1 else scale)
        ).all()


def test_windows_at_the_border_of_a_part_are_whole():
    nodes = Nodes(grid(560, 8), grid(480, 8), (480, 560), 1)
    pixels = np.ones((480, 560), np.float32)
    for window in (32, 128, 160):
        part = slice(28, 31), slice(33, 36)
        local, crops = cut(nodes, [Image(pixels, None)], part, 1, window / 4)
        weight = local.window_sums(np.ones((1, *local.cell_shape), np.float32), window / 4)
        np.testing.assert_allclose(CELL**2 * weight[0][0], weight[1].max(), rtol=2e-3)
        assert crops[0].pixels.shape == local.shape
