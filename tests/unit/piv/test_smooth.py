"""Adaptive smoothing of vectors and the splitting of a field into its divergence-free and curl-free parts."""

from __future__ import annotations

import numpy as np
import pytest

from piv.validation.denoise import damp_noise, mirrored

SIGMA, SPACING, PASSES = 8.0, 8.0, 3  # px: a window of 32 px, balanced
SHAPE = (64, 80)
Y, X = np.meshgrid(*(SPACING * (np.arange(n) - n / 2) for n in SHAPE), indexing="ij")


def measurement_noise(seed: int, rms: float) -> np.ndarray:
    """Both components' noise (2, ny, nx) as iterated windows leave it."""
    k = [np.fft.fftfreq(n, SPACING) for n in SHAPE]
    window = np.exp(-2 * np.pi**2 * SIGMA**2 * (k[0][:, None] ** 2 + k[1][None, :] ** 2))
    response = 1 - (1 - window) ** PASSES
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(2, *SHAPE)))
    noise = np.fft.ifft2(white * response).real
    return rms * noise / np.sqrt(np.mean(noise**2))


def vortex(core: float, peak: float) -> np.ndarray:
    """Lamb-Oseen vortex in the middle, (2, ny, nx) px."""
    r2 = X**2 + Y**2 + 1e-9
    swirl = peak * core / 0.638173 / r2 * (1 - np.exp(-r2 / core**2))
    return np.stack([-swirl * Y, swirl * X])


def source(core: float, peak: float) -> np.ndarray:
    """The same turned by a right angle everywhere: without curl, not without divergence."""
    u, v = vortex(core, peak)
    return np.stack([v, -u])


def smoothed(flow: np.ndarray, rms: float, seed: int = 1, known: np.ndarray | None = None):
    """Error and standard uncertainty (2, ny, nx) after smoothing vectors of this noise."""
    known = np.ones(SHAPE, bool) if known is None else known
    measured = flow + measurement_noise(seed, rms)
    variance = np.full(SHAPE, rms**2)
    out = damp_noise(
        *measured, variance, variance, known, sigma=SIGMA, spacing=SPACING, passes=PASSES
    )
    return np.stack(out[:2]) - flow, np.sqrt(np.stack(out[2:]))


def rms(e: np.ndarray) -> float:
    return float(np.sqrt(np.mean(e**2)))


@pytest.mark.parametrize("flow, sign", [(vortex, -1), (source, 1)])
def test_parts_of_a_field(flow, sign):
    # a swirl or a source that ends within the field: zero beyond it is then true
    field = (flow(40, 1.0) * np.exp(-(X**2 + Y**2) / 80**2)).astype(np.float32)
    turned = np.stack(mirrored(field[0], field[1]))
    assert rms(turned - sign * field) < 0.01 * rms(field)  # rest: the periodic images of the field


def test_uniform_flow_loses_most_of_its_noise():
    e, std = smoothed(np.ones((2, *SHAPE)), 0.04)
    # a fifteenth of the noise's power lies in waves longer than 4.4 windows; with the edges 0.27 of 0.04 px are left
    assert rms(e) < 0.33 * 0.04
    assert 0.6 < np.mean(np.abs(e) < std) < 0.8


def test_what_a_fine_band_keeps_by_chance_is_judged_again():
    # a variance that is 20 % too small lets many fine bands pass for flow
    true, variance, known = (
        np.ones((2, *SHAPE)),
        np.full(SHAPE, 0.8 * 0.04**2),
        np.ones(SHAPE, bool),
    )
    e = []
    for seed in range(4):
        measured = true + measurement_noise(seed, 0.04)
        out = damp_noise(
            *measured, variance, variance, known, sigma=SIGMA, spacing=SPACING, passes=PASSES
        )
        e.append(np.stack(out[:2]) - true)
    # 0.29 of 0.04 px; 0.35 where each band is judged once
    assert rms(np.stack(e)) < 0.32 * 0.04


@pytest.mark.parametrize("flow", [vortex, source])
def test_steep_structures_stay(flow):
    # clean: the core of a vortex or source must not be taken for noise of a hundredth of a pixel
    field = flow(40, 6.0)
    core = np.hypot(X, Y) < 80
    e, _ = smoothed(field, 0.01)
    assert rms(e[:, core]) < 0.012


def test_a_noisy_core_gains_from_what_has_no_divergence():
    core = np.hypot(X, Y) < 80
    e = [smoothed(vortex(40, 6.0), 0.04, seed)[0][:, core] for seed in range(4)]
    # 0.49 of 0.04 px; 0.62 where the parts are not judged apart
    assert rms(np.stack(e)) < 0.55 * 0.04


def test_a_quadratic_flow_is_exact_up_to_the_edges():
    field = np.stack([1e-5 * X**2 + 0.01 * Y, 2e-5 * X * Y - 0.02 * X])
    e, _ = smoothed(field, 1e-4)
    assert np.abs(e).max() < 2.5e-4  # 1.5e-4; 3.8e-4 where edges are left to the low-pass


def test_absent_vectors_take_no_part():
    known = np.hypot(X - 100, Y) > 60
    flow = np.where(known, np.ones((2, *SHAPE)), 1e3)
    e, _ = smoothed(flow, 0.04, known=known)
    assert rms(e[:, known]) < 0.45 * 0.04
    nothing = np.zeros(SHAPE, bool)
    e, std = smoothed(flow, 0.04, known=nothing)
    assert np.isfinite(std).all()
