"""Synthetic recordings: exact images, exact truth, unbiased seeding, reproducible."""

import dataclasses
import json

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy import integrate

from piv.formats.plane_series import make_plane, read_plane, write_plane
from piv.images.masks import inside_polygon
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.particle_images import Body, add_particles, expose
from piv.synthetic.particles import (
    MARGIN,
    Box,
    advance,
    arriving,
    exact_displacement,
    motion,
    seed_particles,
)
from piv.synthetic.plane_spline import PlaneField
from piv.synthetic.render_recording import render_recording
from piv.synthetic.virtual_camera import Recorder

SMALL = Camera(width_px=160, height_px=128, scale_mm_per_px=0.25)


def rotating(n_times: int = 7, body: bool = False, dwdz: float = 0.0) -> xr.Dataset:
    """Solid rotation of 25 rad/s about (20, 16) mm, 0.05 rad between frames at 500 Hz."""
    x, y = np.arange(0, 0.0401, 1e-3), np.arange(0, 0.0331, 1e-3)
    xx, yy = np.meshgrid(x, y)
    time = np.arange(n_times) / 500
    u, v = -25 * (yy - 0.016), 25 * (xx - 0.020)
    if body:
        u, v = (np.where((xx < 0.008) & (yy > 0.02), np.nan, f) for f in (u, v))
    more = {"dwdz": np.full((n_times, *xx.shape), dwdz)} if dwdz else {}
    if body:
        corners = np.array([[-0.01, 0.0195], [0.0085, 0.0195], [0.0085, 0.05], [-0.01, 0.05]])
        more["outline"] = np.tile(corners, (n_times, 1, 1, 1))
    u, v = (np.tile(f, (n_times, 1, 1)) for f in (u, v))
    return make_plane(x, y, u, v, time=time, **more)


def test_pixel_values_are_the_exact_integral_of_the_gaussian():
    image = np.zeros((12, 14))
    add_particles(image, np.array([6.3]), np.array([5.8]), np.array([200.0]), np.array([2.5]))
    for row, column in ((6, 6), (5, 7), (8, 4)):
        exact, _ = integrate.dblquad(
            lambda y, x: 200 * np.exp(-8 * ((x - 6.3) ** 2 + (y - 5.8) ** 2) / 2.5**2),
            column - 0.5, column + 0.5, row - 0.5, row + 0.5, epsabs=1e-10,
        )  # fmt: skip
        # within 1e-4 of a grey level
        assert image[row, column] == pytest.approx(exact, abs=1e-4)
    # cut off where it is below 1e-5
    assert image.sum() == pytest.approx(200 * np.pi * 2.5**2 / 8, abs=1e-3)


def test_noise_has_the_size_that_is_asked_for():
    light = np.full((400, 400), 100.0, np.float32)
    rng = np.random.default_rng(0)
    grey = expose(light, rng, bits=12, background=20, read_noise=3, electrons_per_level=10)
    # variance 3^2 + 120/10 + 1/12 of rounding; the variance of 160,000 draws scatters by 0.35 %,
    # three times that
    assert grey.var() == pytest.approx(9 + 12 + 1 / 12, rel=0.011)
    assert grey.mean() == pytest.approx(120, abs=0.04)
    assert grey.dtype == np.uint16
    assert expose(light * 10, rng, bits=8).max() == 255


def test_particles_follow_solid_rotation_to_a_thousandth_of_a_pixel():
    field = PlaneField(rotating())
    p = np.array([[0.025, 0.03, 0.012], [0.016, 0.02, 0.01], [0, 1e-4, -1e-4], [2.5, 2.5, 2.5]])
    end = advance(field, p, 0.0, 0.012)
    angle = 25 * 0.012
    x, y = p[0] - 0.020, p[1] - 0.016
    exact = np.array([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)])
    # RK4 of 0.15 rad per step: 0.15^5/120 of the radius = 6e-7 of 15 mm
    np.testing.assert_allclose(end[:2] - [[0.020], [0.016]], exact, atol=2e-8)


def test_out_of_plane_motion_grows_with_distance_from_the_sheet():
    field = PlaneField(rotating(dwdz=30.0))
    p = np.array([[0.02, 0.02], [0.016, 0.016], [1e-3, -5e-4], [2.5, 2.5]])
    end = advance(field, p, 0.0, 0.01)
    np.testing.assert_allclose(end[2], p[2] * np.exp(0.3), rtol=2e-6)  # RK4: 2 steps of 0.15^5/120


@pytest.mark.parametrize("given", [True, False])
def test_a_core_that_spreads_by_interpolation_keeps_its_particles_where_nothing_crosses_the_sheet(
    given,
):
    """Rotation with a spurious outflow of 10/s, which would leave e^-2.4 of the particles."""
    series = rotating(n_times=61)
    xx, yy = np.meshgrid(series["x"].values - 0.020, series["y"].values - 0.016)
    series = series.assign(u=series["u"] + 10 * xx, v=series["v"] + 10 * yy)
    if given:
        zero = xr.zeros_like(series["u"])
        series = series.assign(w=zero, dwdz=zero)
    recorder = Recorder(series, SMALL, Seeding(density_ppp=0.3), seed=2)
    for frame in recorder.frames():
        p = frame.particles
    core = np.hypot(p[0] - 0.020, p[1] - 0.016) < 8e-3
    expected = 0.3 / (SMALL.pixel**2 * 1.5e-3) * np.pi * 8e-3**2 * 2 * recorder.box.half_width
    if given:
        assert abs(core.sum() - expected) < 4 * np.sqrt(expected)  # Poisson
    else:
        assert core.sum() < 0.2 * expected


def test_truth_is_the_chord_of_the_path_at_its_middle():
    field = PlaneField(rotating())
    x, y = np.array([0.026]), np.array([0.016])
    dx, dy = exact_displacement(field, x, y, 0.0, 0.002)
    # on a circle: middle of the chord at radius r cos(a/2), chord 2 r sin(a/2) at right angles to
    # it
    assert dx[0] == pytest.approx(0, abs=1e-9)
    assert dy[0] == pytest.approx(2 * 0.006 * np.tan(0.025), rel=1e-4)  # the iteration's own limit


@pytest.mark.parametrize("core, drift", [(20e-3, 0.0), (5e-3, 0.0), (5e-3, 2.0)])
def test_particles_take_as_many_steps_as_their_paths_need(core, drift):
    """A vortex of 1 m/s, carried along: within the precision of forty steps, in few."""
    x = np.arange(0, 0.0801, 0.5e-3)
    rx, ry = np.meshgrid(x - 0.04, x - 0.04)
    r2 = rx**2 + ry**2 + 1e-12
    swirl = core / 0.638 / r2 * -np.expm1(-r2 / core**2)
    u, v = (np.tile(f, (3, 1, 1)) for f in (drift - swirl * ry, swirl * rx))
    field = PlaneField(make_plane(x, x, u, v, time=np.arange(3) / 500))
    most = motion(field, 0.0, 0.002, 1e-3)
    start = np.vstack([np.random.default_rng(0).uniform(0.02, 0.06, (2, 500)), np.zeros((2, 500))])
    error = advance(field, start, 0.0, 0.002, most.substeps) - advance(field, start, 0.0, 0.002, 40)
    # two sources of error of that precision each, and the bound of the displacement, which is not
    # far above it
    assert np.abs(error[:2]).max() < 2e-4 * most.along
    assert most.substeps <= 3  # a step a cell would be six to fourteen


def test_density_stays_uniform_while_particles_enter_and_leave():
    recorder = Recorder(rotating(n_times=61), SMALL, Seeding(density_ppp=0.3), seed=2)
    for frame in recorder.frames():
        last = frame.particles
    n = last.shape[1]
    box = recorder.box
    expected = 0.3 / (SMALL.pixel**2 * 1.5e-3) * box.volume()
    assert abs(n - expected) < 4 * np.sqrt(expected)  # Poisson: four standard deviations
    extent = [[box.x0, box.x1], [box.y0, box.y1]]
    counts, _, _ = np.histogram2d(last[0], last[1], bins=4, range=extent)
    # corners, which fresh particles feed, and middle
    assert (np.abs(counts - n / 16) < 4.5 * np.sqrt(n / 16)).all()
    assert abs(np.mean(last[2])) < 4 * box.half_width / np.sqrt(3 * n)


def test_no_particle_is_inside_the_body_and_its_mask_is_right():
    recorder = Recorder(rotating(body=True), SMALL, Seeding(density_ppp=0.1), seed=1)
    for frame in recorder.frames():
        inside = (frame.particles[0] < 0.0083) & (frame.particles[1] > 0.0197)
        assert not inside.any()
    x, y = np.meshgrid(np.arange(160) * 2.5e-4, np.arange(127, -1, -1) * 2.5e-4)
    x, y = x - recorder.origin_px[0] * 2.5e-4, y - recorder.origin_px[1] * 2.5e-4
    np.testing.assert_array_equal(frame.mask != 0, (x <= 0.0085) & (y >= 0.0195))


def test_a_particle_is_hidden_by_the_outline_and_not_by_its_pixels():
    """An edge a third of a pixel further hides a third more of the pixel's particles."""
    row = np.full(3000, 4.2)
    column = np.random.default_rng(1).uniform(3.5, 8.5, 3000)
    for edge in (6.0, 6.3, 6.6):
        polygon = np.array([[0.4, 0.5], [edge, 0.5], [edge, 8.0], [0.4, 8.0]])
        mask = inside_polygon(polygon, np.arange(12), np.arange(10)).astype(np.uint8)
        np.testing.assert_array_equal(Body(mask, (polygon,)).holds(column, row), column < edge)


@pytest.fixture
def sheet(tmp_path):
    series = rotating(body=True)
    write_plane(series, tmp_path / "sheet.h5", source="cfd", tip_width=0.01)
    return tmp_path / "sheet.h5"


def test_recording_holds_frames_mask_and_truth(sheet, tmp_path):
    with read_plane(sheet) as series:
        path = render_recording(series, tmp_path / "images.h5", SMALL, Seeding(), seed=7)
    with h5py.File(path) as file:
        assert file.attrs["format"] == "recording"
        assert file["frames"].shape == (7, 128, 160)
        assert file["frames"].dtype == np.uint8
        assert file.attrs["tip_width"] == 0.01
        assert json.loads(file.attrs["camera"])["scale_mm_per_px"] == 0.25
        assert "outline" in file
    with read_plane(tmp_path / "images_truth.h5") as truth:
        np.testing.assert_allclose(truth["time"], np.arange(6) / 500 + 0.001)
        assert int(truth["valid"].isel(time=0).sum()) < truth["valid"].isel(time=0).size
        # chord truth of solid rotation: tan(a/2)/(a/2) times the velocity
        ratio = np.tan(0.025) / 0.025
        v = truth["v"].isel(time=2).sel(x=0.026, y=0.016, method="nearest")
        assert float(v) == pytest.approx(25 * 0.006 * ratio, rel=1e-4)


def test_same_seed_same_pictures_and_an_interrupted_rendering_resumes_to_them(
    sheet, tmp_path, monkeypatch
):
    from piv.synthetic import render_recording as synthetic

    monkeypatch.setattr(synthetic, "CHECKPOINT_FRAMES", 2)
    with read_plane(sheet) as series:
        whole = render_recording(series, tmp_path / "whole.h5", SMALL, seed=7, truth=False)
        written = synthetic.RecordingWriter.write

        def failing(self, i, *rest):
            if i == 4:
                raise KeyboardInterrupt
            written(self, i, *rest)

        monkeypatch.setattr(synthetic.RecordingWriter, "write", failing)
        with pytest.raises(KeyboardInterrupt):
            render_recording(series, tmp_path / "cut.h5", SMALL, seed=7, truth=False)
        assert not (tmp_path / "cut.h5").exists()
        monkeypatch.setattr(synthetic.RecordingWriter, "write", written)
        resumed = render_recording(series, tmp_path / "cut.h5", SMALL, seed=7, truth=False)
        other = render_recording(series, tmp_path / "other.h5", SMALL, seed=8, truth=False)
    frames = []
    for path in (whole, resumed, other):
        with h5py.File(path) as file:
            frames.append(file["frames"][...])
    np.testing.assert_array_equal(frames[0], frames[1])
    assert (frames[0] != frames[2]).mean() > 0.1


@pytest.mark.parametrize("every, frames", [(1, 7), (2, 6), (3, 4), (4, 4), (5, 4), (7, 2)])
def test_pairs_are_the_same_pictures_as_of_the_whole_recording(tmp_path, every, frames):
    series = rotating(7)
    whole = render_recording(series, tmp_path / "whole.h5", SMALL, seed=4)
    camera = dataclasses.replace(SMALL, pairs_every=every)
    paired = render_recording(series, tmp_path / "pairs.h5", camera, seed=4)
    kept = [i for i in range(7) if i % every < 2 and (every == 1 or i - i % every + 1 < 7)]
    assert len(kept) == frames
    with h5py.File(whole) as all_, h5py.File(paired) as some:
        np.testing.assert_array_equal(some["frames"][:], all_["frames"][kept])
        np.testing.assert_allclose(some["time"][:], all_["time"][kept])
    truths = (tmp_path / f"{name}_truth.h5" for name in ("whole", "pairs"))
    with read_plane(next(truths)) as all_, read_plane(next(truths)) as some:
        first = kept[::2] if every > 1 else range(6)
        np.testing.assert_array_equal(some["u"], all_["u"].isel(time=list(first)))
        assert some["time"].values == pytest.approx([(i + 0.5) / 500 for i in first])


def test_particles_are_drawn_anew_between_pairs_that_are_far_apart(monkeypatch):
    """Of 960 frames 192 were taken, and carrying particles took most of the time."""
    steps = []
    moved = Recorder.step
    monkeypatch.setattr(
        Recorder, "step", lambda self, p, i, *more: steps.append(i) or moved(self, p, i, *more)
    )
    camera = dataclasses.replace(SMALL, pairs_every=8)
    seen = list(Recorder(rotating(19), camera, Seeding(), 3).frames())
    assert [frame.number for frame in seen] == [0, 1, 8, 9, 16, 17]
    assert steps == [0, 8, 16]
    for first, second in zip(seen[::2], seen[1::2], strict=True):
        turned = (first.particles[0] - 0.02) + 1j * (first.particles[1] - 0.016)
        turned *= np.exp(0.05j)  # solid rotation
        there = (second.particles[0] - 0.02) + 1j * (second.particles[1] - 0.016)
        inside = np.abs(turned) < 0.012
        away = np.abs(turned[inside][:, None] - there).min(axis=1)
        assert np.quantile(away, 0.99) < 1e-6  # 0.004 px
    # as many, and other ones
    assert seen[2].image.mean() == pytest.approx(seen[0].image.mean(), rel=0.05)
    assert (seen[2].image != seen[0].image).mean() > 0.1


def test_camera_that_looks_past_the_plane_is_refused(sheet, tmp_path):
    with read_plane(sheet) as series, pytest.raises(ValueError, match="the camera sees x from"):
        render_recording(series, tmp_path / "images.h5", Camera(width_px=4000))


def test_particles_not_carried_would_not_have_come_into_the_picture():
    """A jet of 1 m/s that spreads out of the sheet on 4 mm alone: most others stay out."""
    plane = rotating()
    xx = plane["x"].values + 0 * plane["y"].values[:, None]
    jet = np.exp(-(((xx - 0.02) / 0.004) ** 2))
    own = {"u": 0.0, "v": -1.0, "w": 0.05, "dwdz": -100.0}
    own = {name: np.tile(factor * jet, (7, 1, 1)) for name, factor in own.items()}
    series = make_plane(plane["x"].values, plane["y"].values, time=plane["time"].values, **own)
    field, box = PlaneField(series), Box(0.005, 0.035, 0.008, 0.025, 1e-3)
    start, end = series["time"].values[2:4]
    most = motion(field, start, end, box.half_width)
    rng = np.random.default_rng(4)
    p = seed_particles(box, 1e11, 2.5, 0, rng, MARGIN * most.along, box.half_width)
    kept = arriving(field, p, box, start, end, most.along, 0.0)
    outside, comes = ~box.holds(p), box.holds(advance(field, p, start, end, most.substeps))
    assert (comes & outside).sum() > 1000  # there is something to lose
    assert kept[comes | ~outside].all()
    assert kept[outside].mean() < 0.5
