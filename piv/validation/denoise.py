"""Adaptive smoothing of a vector field where nothing but noise is seen."""

from functools import lru_cache

import cv2
import numpy as np
import scipy.fft
from numpy import float32, ndarray

# The low-pass is 1 - Π(1 - aL) of a Gaussian L: flat up to its cut-off like a high-order kernel,
# and steep beyond it.
STEPS = (1.0, 1.0, 1 / 0.82, 1 / 0.58, 1 / 0.38, 1 / 0.25, 1 / 0.16)
# of L in σ of the correlation window: half is left of waves of 1.5, 2.6 and 4.4 windows
SCALES = (2.4, 4.2, 7.0)
NODES = 1.9  # of L in vectors, at least: coarser scales are worked out on fewer vectors
AROUND = 1.0  # of L: where mean squares are taken
LARGEST = 25.0  # variance counted as noise, in medians of the field
NOISE_ONLY, SIGNAL = 1.7, 8.0  # mean square over that of noise: damped wholly below, kept above
REGION = 6.0  # of L: where mean squares tell whether the flow fills the band
CALM, FILLED = 1.4, 2.2  # their geometric mean over noise: dead band as above, no dead band
# typical ratios of the divergence-free and of the curl-free part: between the middle two the finest
# band is taken for turbulence whose divergence is as weak as noise, beyond the outer two it is not;
# the filter of least error takes off most of it, so this share is kept
TURBULENT, LEAST = ((2.2, 3.2, 5.5, 7.0), (1.3, 1.5, 2.5, 3.5)), 0.8
LEVEL = 2.5  # vectors: where variances of small windows are averaged
_SHARED = 0.5  # how far the noise of a part that is damped is taken to stay in the one that is kept


def damp_noise(
    dx, dy, var_x, var_y, known, *, sigma: float, spacing: float, passes: int, ratio=None
):
    """Displacements and variances with the fine part damped where it is no stronger than noise.

    For each of SCALES the field is split into a smooth part and the rest, and the rest into its
    divergence-free and its curl-free part, of which measurement noise fills both alike and a flow
    in the plane of the sheet the first only. Where the mean square of a part around a vector is q
    times what noise leaves there, its share (1 - NOISE_ONLY/q) is kept, scaled to reach one at q =
    SIGNAL: a Wiener filter with known noise (Lee 1980; for PIV Wieneke 2017), with dead bands that
    take uniform flow for uniform and spare steep vortex cores any damping. Where the whole region
    has more than noise in this band, as in turbulence, there is no lower dead band: (1 - 1/q), the
    filter of least error. var_x, var_y: variance of the iterated measurement (px²); known: bool;
    sigma, spacing (px), passes: as measured; ratio: side of each vector's window over the largest
    (None: all one).
    """
    weight = known.astype(float32)
    fields = [np.where(known, d, 0).astype(float32) for d in (dx, dy)]
    variance = np.where(known, var_x + var_y, 0).astype(float32)
    if known.any():  # a few vectors that know nothing must not let all around them pass for noise
        some = variance[known][:: max(known.sum() // 2000, 1)]  # enough for a median
        variance = np.minimum(variance, LARGEST * np.median(some))
    # in small windows a few cells determine each variance: their geometric mean
    if ratio is not None:
        level = _gauss(np.log(np.maximum(variance, 1e-12)) * weight, LEVEL)
        level /= np.maximum(_gauss(weight, LEVEL), 1e-6)
        variance = np.where(ratio < 1, np.exp(level) * weight, variance)
    # what has no fine part needs no neighbours beyond an edge
    trends = [_quadratic(f, weight) for f in fields]
    fields = [f - trend for f, trend in zip(fields, trends, strict=True)]
    size = weight.shape[::-1]
    low = fields  # less what finer bands have damped
    remains = np.ones_like(weight)  # share of the noise in it
    gain, lost = np.zeros_like(weight), np.zeros_like(weight)
    shares_of = _local_shares(sigma, spacing, passes, ratio)
    for band, ((width, coarser), (fine, left)) in enumerate(
        zip(scales(sigma, spacing), shares_of, strict=True)
    ):
        noise = variance * remains * weight * (fine / 2)
        parts, share = [f * weight for f in low], weight
        if coarser > 1:
            few = tuple(-(-n // coarser) for n in size)
            known_fields = (share, noise, *parts)
            share, noise, *parts = (
                cv2.resize(a, few, interpolation=cv2.INTER_AREA) for a in known_fields
            )
            parts = [p / np.maximum(share, 1e-6) for p in parts]
        cut, finished, shares = _damped(parts, share, noise, width / coarser, band == 0)
        if coarser > 1:
            cut, finished = (
                [cv2.resize(c, size, interpolation=cv2.INTER_CUBIC) for c in p]
                for p in (cut, finished)
            )
            shares = [cv2.resize(a, size, interpolation=cv2.INTER_LINEAR) for a in shares]
        kept, passed, more, there = shares
        fields = [f - c for f, c in zip(fields, cut, strict=True)]
        low = [f - c for f, c in zip(low, finished, strict=True)]
        smooth = np.minimum(left / there, 1)  # at an edge fewer vectors share the noise
        gain = gain + remains * (1 - smooth) * (kept - passed)
        remains = remains * (smooth + (1 - smooth) * passed)
        lost = lost + more
    gain = gain + remains
    dx, dy = (f + trend for f, trend in zip(fields, trends, strict=True))
    return dx, dy, var_x * gain + lost, var_y * gain + lost


@lru_cache(8)
def _powers(shape: tuple[int, int]) -> ndarray:
    """1, x, y, x², xy, y² over the field, x and y within -1 … 1: (6, nodes)."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y]).reshape(6, -1).astype(float32)


def _quadratic(field: ndarray, weight: ndarray) -> ndarray:
    """The quadratic that fits the whole field best."""
    powers = _powers(field.shape)
    weighted = powers * weight.ravel()
    factors = np.linalg.lstsq(weighted @ powers.T, weighted @ field.ravel(), rcond=1e-5)[0]
    return (factors @ powers).reshape(field.shape)


def _damped(
    fields: list[ndarray], weight: ndarray, noise: ndarray, width: float, finest: bool
) -> tuple:
    """Parts to take off both fields, the finished part, and shares of noise and signal.

    Shares: fine noise that stays, and that is passed to the coarser bands; lost signal (px²);
    known weight of the low-pass.

    Where the flow fills the band it is damped whole: each band is damped once. Elsewhere what is
    kept may be chance, and the coarser bands, which know the noise better, judge it again. noise:
    weighted variance expected in each part of the fine field.
    """
    there = np.maximum(_gauss(weight, width), 1e-6)
    ex, ey = (_fine(f, weight, there, width) for f in fields)
    tx, ty = mirrored(ex, ey)
    inner = ex * ex + ey * ey + tx * tx + ty * ty
    cross = 2 * (ex * tx + ey * ty)
    inner, cross, noise, total = (_gauss(a, AROUND * width) for a in (inner, cross, noise, weight))
    total = np.maximum(total, 1e-6)
    noise = np.maximum(noise / total, 1e-12)
    region = np.maximum(_gauss(weight, REGION * width), 1e-6)
    ratios = [np.maximum((inner + sign * cross) / (4 * total) / noise, 1e-6) for sign in (-1, 1)]
    # the typical ratio: a strong vortex in calm water does not fill the region
    typical = [np.exp(_gauss(np.log(r) * weight, REGION * width) / region) for r in ratios]
    filled = [np.clip((t - CALM) / (FILLED - CALM), 0, 1) for t in typical]
    spared = float32(0)
    if finest:
        certain = [
            np.interp(t, limits, (0, 1, 1, 0)) for t, limits in zip(typical, TURBULENT, strict=True)
        ]
        spared = float32(LEAST) * np.prod(certain, axis=0, dtype=float32)
    keep, again, lost = [], [], 0
    for ratio, fills in zip(ratios, filled, strict=True):
        only = NOISE_ONLY - (NOISE_ONLY - 1) * fills
        share = np.clip((1 - only / ratio) / (1 - only / SIGNAL), 0, 1)
        keep.append(np.maximum(share, spared))
        again.append(keep[-1] * (1 - fills))
        lost = lost + (1 - keep[-1]) ** 2 * noise * np.maximum(ratio - only, 0) / 2
    cuts, shares = [], []
    for free, curl in (keep, again):  # shares of the divergence-free and the curl-free part
        mean, half = (free + curl) / 2, (curl - free) / 2
        cuts.append((ex - mean * ex - half * tx, ey - mean * ey - half * ty))
        shares.append(_SHARED * np.maximum(free, curl) + (1 - _SHARED) * mean)
    return *cuts, (*shares, lost, np.minimum(there, 1))


def _fine(field: ndarray, weight: ndarray, there: ndarray, width: float) -> ndarray:
    """The field less its low-pass, zero where it is not known; each step is a mean over what is."""
    rest, share = field * weight, weight / there
    for step in STEPS:  # the rest less a mean of it over what is known
        mean = _gauss(rest, width)
        mean *= share
        mean *= float32(step)
        rest -= mean
    return rest


def _gauss(field: ndarray, sigma: float) -> ndarray:
    across = 2 * int(np.ceil(3 * sigma)) + 1
    return cv2.GaussianBlur(field, (across, across), sigma, borderType=cv2.BORDER_CONSTANT)


@lru_cache
def scales(sigma: float, spacing: float) -> tuple[tuple[float, int], ...]:
    """(width of the low-pass in vectors, its coarsening in vectors) for each of SCALES."""
    widths = [scale * sigma / spacing for scale in SCALES]
    return tuple((w, max(int(w / NODES), 1)) for w in widths)


# sides of smaller windows over the largest, between which shares are interpolated
_RATIOS = (0.375, 0.5, 0.75, 0.99)
MORE = 3  # steps in the smaller windows beyond those of the largest


def _local_shares(sigma: float, spacing: float, passes: int, ratio: ndarray | None) -> list[tuple]:
    """`_noise_shares` of each vector, measured in a window of `ratio`."""
    whole = _noise_shares(sigma, sigma, spacing, passes, 1)
    if ratio is None:
        return list(whole)
    smaller = [_noise_shares(r * sigma, sigma, spacing, passes + MORE, 2) for r in _RATIOS]
    tables = np.array([*smaller, whole])  # window, scale, share
    return [
        tuple(np.interp(ratio, (*_RATIOS, 1.0), tables[:, k, m]).astype(float32) for m in (0, 1))
        for k in range(len(whole))
    ]


@lru_cache
def _noise_shares(sigma: float, largest: float, spacing: float, passes: int, density: int):
    """For each scale of the `largest` window: noise shares of the fine part, and left without it.

    sigma: of the window (px); density: nodes per vector that images are deformed by.
    """
    k = np.fft.fftfreq(density * 64)  # per node
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = (2 + np.cos(2 * np.pi * k)) / 3
    spline = spline[:, None] * spline[None, :]
    window = np.exp(-2 * np.pi**2 * (sigma * density / spacing) ** 2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        total = spline * total + window * (1 - spline * total)
    # of one vector per `density` nodes
    power = (total**2).reshape(density, 64, density, 64).sum(axis=(0, 2))
    k = np.fft.fftfreq(64)
    square = k[:, None] ** 2 + k[None, :] ** 2
    out = []
    for width, coarser in scales(largest, spacing):
        low = np.exp(-2 * np.pi**2 * width**2 * square)
        mean = np.sinc(k * coarser) / np.sinc(
            k
        )  # of neighbours, where fewer vectors stand for them
        fine = mean[:, None] * mean[None, :] * np.prod([1 - step * low for step in STEPS], axis=0)
        after = power * (1 - fine) ** 2
        out.append((float(np.sum(power * fine**2) / power.sum()), float(after.sum() / power.sum())))
        power = after
    return tuple(out)


BEYOND = 12  # nodes of zeros beyond the field: opposite sides then know little of each other


@lru_cache(16)
def _turn(shape: tuple[int, int]) -> ndarray:
    """(kx + i ky)²/k² on the FFT frequencies of `shape`: 0 where there is no direction."""
    k = np.fft.fftfreq(shape[1])[None, :] + 1j * np.fft.fftfreq(shape[0])[:, None]
    square = np.abs(k) ** 2
    square[0, 0] = 1
    return (k**2 / square).astype(np.complex64)


def mirrored(ex: ndarray, ey: ndarray) -> tuple[ndarray, ndarray]:
    """The curl-free minus the divergence-free part of a field (ny, nx, float32).

    So (e + mirrored)/2 is curl-free and (e - mirrored)/2 divergence-free. Nodes are equally spaced;
    absent ones are zero. With z = ex + i ey it is the Beurling transform of the conjugate of z.
    """
    shape = tuple(scipy.fft.next_fast_len(n + BEYOND) for n in ex.shape)
    conjugate = np.empty(ex.shape, np.complex64)
    conjugate.real, conjugate.imag = ex, -ey
    spectrum = scipy.fft.fft2(conjugate, s=shape, overwrite_x=True)
    spectrum *= _turn(shape)
    turned = scipy.fft.ifft2(spectrum, overwrite_x=True)[: ex.shape[0], : ex.shape[1]]
    return np.ascontiguousarray(turned.real), np.ascontiguousarray(turned.imag)
