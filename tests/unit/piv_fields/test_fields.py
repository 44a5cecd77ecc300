"""Statistics, derived fields, lines and spectra against exact fields and known statistics."""

import tracemalloc

import numpy as np
import pytest

from piv.fields import blocks as blocks_module
from piv.fields.derived import derived, derived_blocks
from piv.fields.groups import at_instants, bins, phases
from piv.fields.lines import along_line
from piv.fields.spectra import density, frequencies_of, space_spectrum, time_spectrum
from piv.fields.statistics import statistics
from piv.formats.plane_series import make_plane, read_plane, write_plane
from piv.formats.plane_writer import write_blocks

X, Y = 0.001 * np.arange(24), 0.001 * np.arange(18)
XX, YY = np.meshgrid(X, Y)


def series(u, v, times=None, valid=None, **more):
    times = np.arange(len(u)) * 0.01 if times is None else times
    return make_plane(X, Y, u, v, time=times, valid=valid, **more)


def ar1(rng, count, phi, shape=XX.shape):
    """Samples of unit variance whose correlation after k steps is phi^k."""
    out = np.empty((count, *shape))
    out[0] = rng.normal(size=shape)
    for k in range(1, count):
        out[k] = phi * out[k - 1] + np.sqrt(1 - phi**2) * rng.normal(size=shape)
    return out


def test_moments_are_those_of_numpy_where_vectors_are_valid():
    rng = np.random.default_rng(1)
    u, v = rng.normal(1, 2, (40, *XX.shape)), rng.normal(-1, 1, (40, *XX.shape))
    valid = rng.random(u.shape) > 0.3
    valid[:, 0, 0] = False
    u, v = (np.where(valid, f, np.nan) for f in (u, v))
    moments = statistics(series(u, v, valid=valid))
    u, v = u[:, 1:], v[:, 1:]
    rest = moments.isel(y=slice(1, None))
    np.testing.assert_allclose(rest["u"], np.nanmean(u, axis=0))
    np.testing.assert_allclose(rest["uu"], np.nanvar(u, axis=0, ddof=1))
    np.testing.assert_allclose(rest["v_rms"], np.nanstd(v, axis=0, ddof=1))
    product = np.nanmean((u - np.nanmean(u, axis=0)) * (v - np.nanmean(v, axis=0)), axis=0)
    n = valid[:, 1:].sum(axis=0)
    np.testing.assert_allclose(rest["uv"], product * n / (n - 1), atol=1e-12)
    np.testing.assert_array_equal(rest["n"], n)
    assert moments["valid"].values[0, 0] == 0
    assert np.isnan(moments["u"].values[0, 0])
    assert moments["uu"].attrs["units"] == "m²/s²"


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_standard_error_with_correlated_samples(phi):
    """Of AR(1) the variance of the mean is (1 + phi)/(1 - phi)/n; 432 means show it to 5 %."""
    count = 1024
    u = ar1(np.random.default_rng(2), count, phi)
    moments = statistics(series(u, u[::-1]))
    exact = np.sqrt((1 + phi) / (1 - phi) / count)
    # 16 to 31 batches at 432 independent points: 1 %; batches of 64 instants are 7 correlation
    # times: 7 % too small
    assert np.sqrt(np.mean(moments["u_std"].values ** 2)) == pytest.approx(exact, rel=0.1)
    assert moments["u"].values.std() == pytest.approx(exact, rel=0.1)
    assert float(moments["convergence_u"][-1]) == pytest.approx(0, abs=1e-7)
    # after a tenth of the instants the mean is off by what 9/10 of independent rest leave
    assert float(moments["convergence_u"][0]) == pytest.approx(1, rel=0.2)


def test_phase_average_of_a_sine_under_noise():
    times = np.arange(400) * 0.01
    wave = np.sin(2 * np.pi * times / 0.2)
    noise = np.random.default_rng(3).normal(0, 0.1, (400, *XX.shape))
    number, centres = bins(phases(times, 0.2), np.arange(21) / 20)
    average = statistics(series(wave[:, None, None] + noise, noise, times), number, centres)
    assert average.sizes["time"] == 20
    assert (average["n"].values == 20).all()
    mean = average["u"].mean(("y", "x")).values
    # 0.1/sqrt(20 * 432): ten times the standard error
    np.testing.assert_allclose(mean, wave[:20], atol=0.01)
    np.testing.assert_allclose(average["uu"].mean(), 0.01, rtol=0.05)


def test_bins_and_instants():
    number, centres = bins(np.array([-1, 0, 0.9, 1, 2, 3, np.nan]), np.array([0, 1, 2]))
    assert number.tolist() == [-1, 0, 0, 1, 1, -1, -1]
    assert centres.tolist() == [0.5, 1.5]
    bend = at_instants(np.array([0.5, 2.0]), np.array([0.0, 1]), np.array([0.0, 10]))
    np.testing.assert_allclose(bend, [5, np.nan])
    with pytest.raises(ValueError, match="ascending edges"):
        bins(np.arange(3.0), np.array([1, 0]))


def test_derived_fields_of_a_linear_flow_are_exact():
    a, b, c, d = 3.0, -2.0, 5.0, -1.0
    plane = make_plane(X, Y, a * XX + b * YY, c * XX + d * YY)
    derivatives = derived(plane)
    exact = {"vorticity": c - b, "divergence": a + d, "strain": np.hypot((a - d) / 2, (b + c) / 2)}
    exact |= {"swirling_strength": np.sqrt(10 - 4.0), "q": -(a * a + d * d) / 2 - b * c}
    for name, value in exact.items():
        np.testing.assert_allclose(derivatives[name], value, rtol=1e-5)
    assert derivatives["vorticity"].attrs["units"] == "1/s"
    assert derivatives["q"].attrs["units"] == "1/s²"
    assert "vorticity_std" not in derivatives


def test_what_is_derived_again_is_new():
    plane = make_plane(X, Y, np.sin(400 * YY), np.sin(400 * XX))
    first = derived(plane)
    again = derived(first.assign({n: 2 * first[n] for n in "uv"}), ("vorticity",))
    np.testing.assert_array_equal(again["vorticity"], 2 * first["vorticity"])
    np.testing.assert_array_equal(again["q"], first["q"])  # was not asked for


@pytest.mark.parametrize("correlated", [False, True])
def test_propagated_uncertainty_is_the_scatter_of_many_noisy_fields(correlated):
    """Errors of known strength and correlation; 600 fields give the scatter to 3 %."""
    from scipy.ndimage import gaussian_filter

    rng, length, strength, count = np.random.default_rng(5), 0.004, 0.01, 600
    radius2 = (XX - 0.012) ** 2 + (YY - 0.009) ** 2
    swirl = 30 * np.exp(-radius2 / 0.006**2)
    u, v = -swirl * (YY - 0.009), swirl * (XX - 0.012)
    noise = rng.normal(0, 1, (2, count, *XX.shape))
    # white noise through a Gaussian of s: correlation exp(-d²/(4 s²)) = exp(-2 (d/length)²)
    if correlated:
        s = length / 0.001 / np.sqrt(8)
        noise = gaussian_filter(noise, (0, 0, s, s), mode="wrap")
        noise /= noise.std()
    noise *= strength
    std = np.full((count, *XX.shape), strength)
    fields = series(u + noise[0], v + noise[1], u_std=std, v_std=std)
    derivatives = derived(fields, correlation_length=length if correlated else 0.0)
    inner = {"x": slice(2, -2), "y": slice(2, -2)}
    for name in ("vorticity", "divergence"):
        scatter = derivatives[name].isel(inner).std("time", ddof=1).values
        said = derivatives[f"{name}_std"].isel(inner).values.mean(axis=0)
        assert np.sqrt(np.mean(scatter**2)) == pytest.approx(np.sqrt(np.mean(said**2)), rel=0.03)
    # quantities that are not linear, where they are well above their uncertainty: in the core
    core = (radius2 < 0.003**2)[2:-2, 2:-2]
    for name in ("swirling_strength", "q"):
        scatter = derivatives[name].isel(inner).std("time", ddof=1).values[core]
        said = derivatives[f"{name}_std"].isel(inner).median("time").values[core]
        assert np.mean(scatter) == pytest.approx(np.mean(said), rel=0.1)


def test_along_a_line():
    plane = make_plane(X, Y, 2 * XX + YY, XX * 0 + 1.0)
    rows = along_line(plane, (0.002, 0.001), (0.008, 0.009), 5)
    np.testing.assert_allclose(rows["s"], np.linspace(0, 0.01, 5))
    np.testing.assert_allclose(rows["u"], 2 * rows["x"] + rows["y"], atol=1e-12)
    np.testing.assert_allclose(rows["along"], 0.6 * rows["u"] + 0.8 * rows["v"])
    np.testing.assert_allclose(rows["across"], 0.6 * rows["v"] - 0.8 * rows["u"])
    three = series(np.ones((3, *XX.shape)), np.ones((3, *XX.shape)))
    assert along_line(three, (0, 0), (0.01, 0)).sizes["time"] == 3
    for end in ((0.002, 0.001), (1.0, 0.0)):
        with pytest.raises(ValueError, match="line"):
            along_line(plane, (0.002, 0.001), end)


@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_spectrum_of_a_sine_and_of_noise(gaps):
    rng = np.random.default_rng(7)
    n, step = 512, 0.01
    t = np.arange(n) * step
    f = frequencies_of(n, step)
    wave = 2.0 * np.sin(2 * np.pi * f[39] * t + 0.3)
    wave[rng.random(n) < gaps] = np.nan
    psd = density(t, wave, f, step)
    assert np.argmax(psd) == 39
    # the peak's integral is the variance, amplitude²/2, of as many samples as there are
    assert psd[39] / (n * step) == pytest.approx(2.0 * np.isfinite(wave).mean(), rel=0.05)
    noise = rng.normal(0, 1, (200, n))
    noise[rng.random(noise.shape) < gaps] = np.nan
    mean = np.mean([density(t, row, f, step) for row in noise], axis=0)
    # white noise of variance 1 has the density 2 step at every frequency: 200 records of 255
    # frequencies, 0.5 %
    assert mean.mean() == pytest.approx(2 * step, rel=0.03)


def test_spectra_of_a_series_in_time_and_space():
    t = np.arange(64) * 0.01
    wave = np.cos(2 * np.pi * 12.5 * t)[:, None, None] + 0 * XX
    ripple = np.cos(2 * np.pi * XX / 0.008) + 0 * wave
    data = series(wave, ripple, t)
    data["valid"][:, 3, 4] = 0
    table = time_spectrum(data, [(0.002, 0.001), (0.01, 0.01)], segments=2)
    assert table["frequency"][table["psd_u"].idxmax()] == pytest.approx(12.5)
    assert set(table["averaged"]) == {4}
    table = space_spectrum(data, "x")
    assert table["frequency"][table["psd_v"].idxmax()] == pytest.approx(125.0)
    with pytest.raises(ValueError, match="not within the plane"):
        time_spectrum(data, [(1.0, 0.0)])


@pytest.fixture
def long_file(tmp_path, monkeypatch):
    """A function that writes n instants; blocks are of 8 instants."""
    monkeypatch.setattr(blocks_module, "BLOCK", 8 * XX.size)

    def write(n):
        std = np.full((n, *XX.shape), 0.1)
        u, v = np.random.default_rng(0).normal(size=(2, *std.shape))
        write_plane(series(u, v, u_std=std, v_std=std), tmp_path / f"{n}.h5")
        return tmp_path / f"{n}.h5"

    return write


def test_memory_does_not_grow_with_the_recording(long_file, tmp_path):
    """Peak of the Python heap for 50 and 150 instants: the same but for the time axis."""

    def peak(path, work):
        with read_plane(path) as plane:
            work(plane.isel(time=slice(0, 9)))  # once, for what is kept from then on
            tracemalloc.start()
            work(plane)
            peak_bytes = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        return peak_bytes

    short, long = long_file(50), long_file(150)
    size = 150 * XX.size * 8  # of one variable of the longer file
    for work in (
        statistics,
        lambda p: write_blocks(derived_blocks(p), tmp_path / "d.h5", p),
        lambda p: along_line(p, (0.0, 0.0), (0.02, 0.01)),
        lambda p: space_spectrum(p, "x"),
    ):
        # one variable of the added 100 instants would take 0.67; statistics add a level of batch
        # means with each doubling of the time
        assert peak(long, work) - peak(short, work) < 0.5 * size


def test_without_uncertainty_of_the_vectors_that_of_an_earlier_derivation_is_dropped(tmp_path):
    std = np.full((2, *XX.shape), 0.1)
    earlier = derived(series(0 * std, 0 * std, u_std=std, v_std=std))
    plane = earlier.drop_vars(["u_std", "v_std"])
    assert "vorticity_std" not in derived(plane)
    assert "vorticity_std" in derived(plane, ("divergence",))
    write_blocks(derived_blocks(plane), tmp_path / "d.h5", plane)
    with read_plane(tmp_path / "d.h5") as again:
        assert "vorticity_std" not in again
