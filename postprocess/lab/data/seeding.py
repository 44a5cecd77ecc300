"""Camera and seeding measured from pictures, for a virtual recording that looks alike.

Particle images of a Poisson process have the mean n·A·2πσ²·⟨light⟩ and, between pixels, the
covariance n·A²·πσ²·⟨light²⟩·exp(−r²/4σ²) (Campbell's theorem); the light is averaged across a
Gaussian sheet. Fitted at distances of one to four pixels, where the sensor's noise is absent.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fileio.errors import StageError
from piv.synthetic.camera import Seeding

# ∫exp(−8z²/t²)dz/t and ∫exp(−16z²/t²)dz/t
MEAN_LIGHT, MEAN_LIGHT2 = np.sqrt(np.pi / 8), np.sqrt(np.pi / 16)
LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 1), (1, 2), (2, 2), (0, 3), (3, 0))
# of the diameters, assumed here and in the virtual recording; light goes with d²
SPREAD = 0.1
MOMENT4, MOMENT6, MOMENT8 = 1 + 6 * SPREAD**2, 1 + 15 * SPREAD**2, 1 + 28 * SPREAD**2
CLEAR_PX = 20  # away from the body
TILE_PX = 64  # moments are taken in tiles, since illumination varies; the median tile counts


@dataclass(frozen=True)
class Appearance:
    """Particles per px, image diameter at 1/e² (px), and the sensor's grey levels.

    Shot noise is not measured: the particles hide it.
    """

    density_ppp: float
    diameter_px: float
    peak: float
    background: float
    read_noise: float


def measure_appearance(
    frames: list[np.ndarray], masks: list[np.ndarray], body_level: float, body_std: float
) -> Appearance:
    """Appearance of frames (row 0 at the top) with the body at `masks`, as dark as the background.

    ValueError where the water is no brighter than the body.
    """
    fits = []
    for frame, mask in zip(frames, masks, strict=True):
        fits += _tiles(frame.astype(np.float64), mask, body_level)
    if not fits:
        raise StageError(
            f"no part of {TILE_PX}x{TILE_PX} px is free of the body; the seeding cannot be measured"
        )
    mean, *cov = np.median(np.array(fits), axis=0)
    if mean <= 0.5 or cov[0] <= 0:
        raise StageError(
            f"the water is {mean:.2g} grey levels brighter than the body; no particles are seen"
        )
    sigma2, variance = _gaussian(np.array(cov))
    # a pixel's own width is no part of the particle's image
    spread = max((sigma2 - 1 / 12) * MOMENT6 / MOMENT8, 0.05)
    area = 2 * np.pi * spread * MEAN_LIGHT
    area2 = np.pi * spread**2 / (spread + 1 / 12) * MEAN_LIGHT2
    amplitude = (variance / (area2 * MOMENT6)) / (mean / (area * MOMENT4))
    density = mean / (amplitude * area * MOMENT4)
    diameter = float(4 * np.sqrt(spread))
    return Appearance(float(density), diameter, float(amplitude), body_level, body_std)


def _tiles(frame: np.ndarray, mask: np.ndarray, background: float) -> list[list[float]]:
    clear = cv2.erode((~mask).astype(np.uint8), np.ones((2 * CLEAR_PX + 1,) * 2, np.uint8))
    out = []
    for j in range(0, frame.shape[0] - TILE_PX + 1, TILE_PX):
        for i in range(0, frame.shape[1] - TILE_PX + 1, TILE_PX):
            at = slice(j, j + TILE_PX), slice(i, i + TILE_PX)
            if clear[at].all():
                tile = frame[at]
                out.append([tile.mean() - background, *(_covariance(tile, lag) for lag in LAGS)])
    return out


def _covariance(tile: np.ndarray, lag: tuple[int, int]) -> float:
    dj, di = lag
    a = tile[: tile.shape[0] - dj, max(0, -di) : tile.shape[1] - max(0, di)]
    b = tile[dj:, max(0, di) : tile.shape[1] + min(0, di)]
    return float(np.mean((a - a.mean()) * (b - b.mean())))


def _gaussian(covariance: np.ndarray) -> tuple[float, float]:
    """σ² and variance of the Gaussian through covariances at `LAGS`, weighted by their size."""
    r2 = np.array([a * a + b * b for a, b in LAGS], float)
    good = covariance > 0.02 * covariance[0]
    slope, top = np.polyfit(r2[good], np.log(covariance[good]), 1, w=covariance[good])
    return float(-1 / (4 * slope)), float(np.exp(top))


def seeding_like(appearance: Appearance, bits: int, sheet_thickness: float) -> Seeding:
    """Seeding for `piv render` with this appearance; `sheet_thickness` in m."""
    return Seeding(
        density_ppp=appearance.density_ppp,
        diameter_px=appearance.diameter_px,
        diameter_std_px=SPREAD * appearance.diameter_px,
        sheet_thickness=sheet_thickness,
        peak=min(appearance.peak / (2**bits - 1), 4.0),
    )
