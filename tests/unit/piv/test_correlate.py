"""What correlate_pair accepts, refuses, masks and flags."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fileio.formats.plane_series import check_plane
from piv.correlation.pair import correlate_pair
from piv.correlation.pair_images import flat_areas
from piv.validation.outliers import fill_absent, normalised_median
from tests.studies.piv.particles import render

SHAPE = (256, 320)


def flow(x, y):
    return 2.0 + 0 * x, 1.0 + 0 * x


@pytest.fixture(scope="module")
def pair():
    return render(flow, shape=SHAPE, seed=3, noise=0.02)


def one_sentence(error) -> bool:
    return 15 < len(str(error.value)) < 200 and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "a, b",
    [
        (np.zeros((64, 64)), np.zeros((64, 65))),
        (np.zeros((64, 64, 3)), np.zeros((64, 64, 3))),
        (np.zeros(64), np.zeros(64)),
        (np.zeros((16, 16)), np.zeros((16, 16))),
        (np.full((64, 64), 7), np.full((64, 64), 7)),
        (np.full((64, 64), np.nan), np.ones((64, 64))),
        (np.array([["a"] * 64] * 64), np.array([["a"] * 64] * 64)),
        (np.zeros((64, 64), complex), np.zeros((64, 64), complex)),
    ],
)
def test_bad_images_are_refused_in_one_sentence(a, b):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        correlate_pair(a, b)
    assert one_sentence(error)


@pytest.mark.parametrize(
    "options",
    [{"window": 4}, {"spacing": 0}, {"spacing": 2.5}, {"preset": "best"}, {"epsilon": 0}, {"max_masked": 1.5}, {"max_std": 0},
     {"method": "magic"}, {"mask": np.zeros((3, 3))}, {"mask": [None, None, None]}],
)  # fmt: skip
def test_bad_options_are_refused_in_one_sentence(pair, options):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        correlate_pair(*pair, **options)
    assert one_sentence(error)


@settings(max_examples=15, deadline=None)
@given(
    rows=st.integers(20, 130), columns=st.integers(20, 130), window=st.sampled_from([16, 32]), spacing=st.integers(3, 20),
    kind=st.sampled_from([np.uint8, np.uint16, np.float32]), dead=st.booleans(),
)  # fmt: skip
def test_any_size_gives_a_whole_plane_or_one_sentence(rows, columns, window, spacing, kind, dead):
    rng = np.random.default_rng(rows * 1000 + columns)
    a = (rng.random((rows, columns)) * 200).astype(kind)
    mask = rng.random((rows, columns)) < 0.3 if dead else None
    arguments = (a, np.roll(a, 1, axis=1))
    options = {"window": window, "spacing": spacing, "mask": mask}
    if min(rows, columns) < max(32, window):
        with pytest.raises(ValueError, match="too small"):
            correlate_pair(*arguments, **options)
        return
    ds = correlate_pair(*arguments, **options)
    check_plane(ds)
    absent = ds["valid"].values == 0
    assert np.isnan(ds["u"].values[absent]).all()
    assert np.isfinite(ds["u_std"].values[~absent]).all()
    assert (ds["flag"].values[absent] > 0).all()


def test_masked_pixels_take_no_part(pair):
    a, b = (i.copy() for i in pair)
    mask = np.zeros(SHAPE, bool)
    mask[80:180, 100:200] = True
    plain = correlate_pair(a, b, mask=mask)
    rng = np.random.default_rng(0)
    a[mask], b[mask] = rng.integers(0, 255, mask.sum()), rng.integers(0, 255, mask.sum())
    other = correlate_pair(a, b, mask=mask)
    for name in ("u", "v", "flag", "u_std"):
        np.testing.assert_array_equal(plain[name], other[name])


def test_vectors_inside_a_body_are_absent_and_flagged(pair):
    mask = np.zeros(SHAPE, bool)
    mask[:128, 160:] = True  # upper right: large y, large x
    ds = correlate_pair(*pair, mask=mask)
    body = ds.sel(x=slice(180, None), y=slice(150, None))
    assert (body["flag"] == 2).all()
    assert not body["valid"].any()
    assert np.isnan(body["u"]).all()
    water = ds.sel(x=slice(24, 130), y=slice(24, 230))
    assert water["valid"].all()
    assert np.allclose(water["u"], 2, atol=0.1)  # ten times the noise


def test_all_masked_is_all_absent(pair):
    ds = correlate_pair(*pair, mask=np.ones(SHAPE, bool))
    assert not ds["valid"].any()
    assert (ds["flag"] == 2).all()


def test_nan_under_a_mask_is_fine(pair):
    a = pair[0].astype(float)
    mask = np.zeros(SHAPE, bool)
    mask[:60] = True
    a[mask] = np.nan
    assert correlate_pair(a, pair[1], mask=mask)["valid"].any()


def test_unrelated_images_are_not_given_vectors():
    a, _ = render(flow, shape=SHAPE, seed=5, noise=0.02)
    b, _ = render(flow, shape=SHAPE, seed=6, noise=0.02)
    ds = correlate_pair(a, b)
    # chance resemblance of windows that hold 40 particles: a few per cent
    assert float(ds["valid"].mean()) < 0.1


def test_replacement_only_on_request_and_flagged(pair):
    a, b = (i.copy() for i in pair)
    rng = np.random.default_rng(0)
    b[100:150, 100:150] = rng.integers(0, 100, (50, 50))  # particles without partners
    plain = correlate_pair(a, b)
    lost = plain["flag"].values == 1
    assert lost.any()
    assert np.isnan(plain["u"].values[lost]).all()
    filled = correlate_pair(a, b, replace=True)
    assert (filled["flag"].values[lost] == 4).all()
    assert np.isfinite(filled["u"].values[lost]).all()
    assert np.isnan(filled["u_std"].values[lost]).all()


def test_grey_levels_and_offset_do_not_matter(pair):
    a, b = pair
    first = correlate_pair(a, b)
    second = correlate_pair(a.astype(np.float64) * 16 + 1000, b.astype(np.float64) * 16 + 1000)
    # float32 sums of shifted grey levels: 1e-3 px
    np.testing.assert_allclose(first["u"], second["u"], atol=2e-3)


def test_mirrored_images_give_mirrored_vectors(pair):
    a, b = pair
    ds = correlate_pair(a, b)
    mirrored = correlate_pair(a[:, ::-1], b[:, ::-1])
    # the FFT windows are not placed symmetrically; the refinement forgets them to 0.01 px
    inner = (slice(2, -2), slice(2, -2))
    np.testing.assert_allclose(
        -mirrored["u"].values[:, ::-1][inner], ds["u"].values[inner], atol=0.01
    )


def test_optical_flow_is_near(pair):
    ds = correlate_pair(*pair, method="optical_flow").sel(x=slice(24, 290), y=slice(24, 230))
    assert float(abs(ds["u"] - 2).median()) < 0.1  # optical flow at quarter-pixel grade
    assert float(abs(ds["v"] - 1).median()) < 0.1


def test_normalised_median_finds_the_one_that_is_off():
    y, x = np.mgrid[:12, :14]
    u, v = 0.3 * y, -0.2 * x
    u[5, 6] += 3
    usable = np.ones(u.shape, bool)
    residual, median_u, _ = normalised_median(u, v, usable, epsilon=0.2, radius=2)
    assert np.argwhere(residual > 3).tolist() == [[5, 6]]
    assert median_u[5, 6] == pytest.approx(1.5)  # the plane's own value there
    quick, _, _ = normalised_median(u, v, usable, epsilon=0.2, radius=2, threshold=3)
    assert ((quick > 3) == (residual > 3)).all()


@pytest.mark.parametrize("radius", [1, 2])
def test_normalised_median_against_sorting(radius):
    rng = np.random.default_rng(5)
    u, v = rng.normal(size=(2, 9, 300))  # longer than a block
    usable = rng.random(u.shape) > 0.3
    usable[:3, :4] = False
    residual, median_u, median_v = normalised_median(u, v, usable, epsilon=0.2, radius=radius)
    for j, i in np.ndindex(u.shape):
        part = tuple(slice(max(k - radius, 0), k + radius + 1) for k in (j, i))
        others = usable[part].copy()
        others[j - part[0].start, i - part[1].start] = False
        if others.sum() < 3:
            assert np.isnan([residual[j, i], median_u[j, i], median_v[j, i]]).all()
            continue
        near = [f[part][others] for f in (u, v)]
        medians = [np.median(n) for n in near]
        spreads = [np.median(abs(n - m)) for n, m in zip(near, medians, strict=True)]
        parts = [
            (f[j, i] - m) / (s + 0.2) for f, m, s in zip((u, v), medians, spreads, strict=True)
        ]
        # single precision
        assert [median_u[j, i], median_v[j, i]] == pytest.approx(medians, abs=1e-6)
        assert residual[j, i] == pytest.approx(np.hypot(*parts), rel=1e-5)


def test_fill_absent_fills_from_the_known():
    u = np.array([[1.0, np.nan, 3.0], [1.0, np.nan, 3.0]])
    filled, _ = fill_absent(u, u, np.isfinite(u))
    np.testing.assert_allclose(filled[:, 1], 2)


def test_flat_areas_are_those_painted_over():
    image = np.random.default_rng(3).integers(0, 255, (256, 320), np.uint8)
    assert flat_areas(image) is None
    painted = np.zeros(image.shape, bool)
    painted[100:170, 60:200] = True
    painted[:50, 250:] = True  # at the edge
    painted[200:230, :] = True  # a band that is narrower than a square
    assert (flat_areas(np.where(painted, 7, image)) == painted).all()
    small = image.copy()
    small[10:50, 10:50] = 7  # 40 px: may be water without particles
    assert flat_areas(small) is None
    assert flat_areas(np.full_like(image, 7)) is None  # told as an error instead
