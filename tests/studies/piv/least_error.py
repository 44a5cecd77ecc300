"""Least error in planes of turbulence that knows the exact spectra: python -m tests.studies.piv.least_error [--seed N] [--case C].

What stands in the way of less error than the table of turbulence shows. The products of both images, warped along our own vectors,
and the spectra that the planes were made of give the posterior mean of the displacement, a Gaussian random field. If the noise is
what the images' spectra say, no estimate linear in these products errs less; and no real picture tells the exact spectra of its flow.
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np
import scipy.fft
from scipy.sparse.linalg import LinearOperator, cg

from piv.correlation import pair, prefilter
from piv.correlation.deform import Nodes, spline_value
from piv.correlation.newton_step import CELL
from piv.correlation.pair_images import Prepared
from piv.validation.outliers import fill_absent
from tests.studies.piv.flows import SHAPE
from tests.studies.piv.particles import render
from tests.studies.piv.turbulence import CASES, derivatives
from tests.studies.piv.turbulence_field import DOMAIN, LONGEST, TurbulentPlane, plane_spectra

NEAR = 0.8  # cells: blur of the products, so that curvatures are positive
EDGE = 6  # cells
LEAST = 1e-7  # px²: spectral density where the planes have none


def densities(wavenumber: np.ndarray, rms: float) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the curl-free and the solenoidal part in each mode of a grid of cells, px²."""
    ky, kx = (2 * np.pi * np.fft.fftfreq(n) for n in DOMAIN)
    whole = [p.mean() for p in plane_spectra(np.hypot(kx[None, :], ky[:, None]))]
    scale = 3 * rms**2 / sum(whole) / CELL**2
    solenoidal, free, _ = (scale * p for p in plane_spectra(wavenumber))
    long = wavenumber < 2 * np.pi / LONGEST  # a picture does not tell these from the mean
    return tuple(np.maximum(np.where(long, p.max(), p), LEAST) for p in (free, solenoidal))  # type: ignore[return-value]


def noise_density(spectra: tuple, response: np.ndarray) -> tuple[float, float]:
    """Variance of the displacement of one px² (Knapp & Carter 1976), px⁴, and the response of the step to a displacement."""
    frequency, signal, noise = spectra
    share = np.maximum(signal, 0) ** 2 / (2 * np.maximum(signal, 0) * noise + noise**2)
    information = np.sum(share * (2 * np.pi * frequency) ** 3) / 2 * frequency[1]
    f = prefilter.radial_frequency()
    power = np.interp(f, frequency, signal) * response**2
    along = 2 * np.pi * np.fft.rfftfreq(prefilter.TILE)[None, :]
    seen = (8 * np.sin(along) - np.sin(2 * along)) / 6
    return 1 / information, float(np.sum(power * seen * along) / np.sum(power * seen**2))


def posterior(
    a: np.ndarray, b: np.ndarray, rms: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns and rows (px) of the cells, and the displacement there (2, ny, nx; image axes)."""
    ds = pair.correlate_pair(a, b, smoothing=False)
    images = Prepared([a, b], None, 32.0)
    nodes = Nodes(ds["x"].values, SHAPE[0] - 1 - ds["y"].values[::-1], images.shape, 1)
    u, v = ds["u"].values[::-1], -ds["v"].values[::-1]
    vectors = fill_absent(u, v, np.isfinite(u))
    moves = list(vectors)
    for _ in range(4):  # coefficients of the B-spline through the vectors
        moves = [m + d - spline_value(m) for m, d in zip(moves, vectors, strict=True)]
    first = prefilter.default_response()
    powers = pair.pair_powers(images, nodes, prefilter.kernel(first), *moves)
    spectra = prefilter.undo(first, prefilter.radial_spectra(powers))
    response = prefilter.optimal_response(*spectra)
    density, gain = noise_density(spectra, response)
    cells = pair.pair_cells(images, nodes, prefilter.kernel(response), *moves)
    gx, gy, hxx, hxy, hyy = (cv2.GaussianBlur(c, (0, 0), NEAR).astype(float) for c in cells[:5])
    hxx, hyy = np.maximum(hxx, 0), np.maximum(hyy, 0)
    hxy = np.clip(hxy, -0.8 * np.sqrt(hxx * hyy), 0.8 * np.sqrt(hxx * hyy))
    per_cell = CELL**2 / density / ((hxx + hyy).mean() / 2)
    now = np.stack([nodes.at_cells(spline_value(m)) for m in moves])

    ky, kx = (2 * np.pi * np.fft.fftfreq(n, CELL) for n in hxx.shape)
    wavenumber = np.hypot(kx[None, :], ky[:, None])
    direction = (kx[None, :] + 1j * ky[:, None]) / np.where(wavenumber > 0, wavenumber, 1)
    cos, sin = direction.real, direction.imag
    inverse = [1 / p for p in densities(wavenumber, rms)]

    def spectral(d, factors):
        fx, fy = scipy.fft.fft2(d)
        free, solenoidal = factors[0] * (cos * fx + sin * fy), factors[1] * (cos * fy - sin * fx)
        return scipy.fft.ifft2(
            np.stack([cos * free - sin * solenoidal, sin * free + cos * solenoidal])
        ).real

    def information(d):
        return per_cell * np.stack([hxx * d[0] + hxy * d[1], hxy * d[0] + hyy * d[1]])

    right = per_cell * np.stack([gx, gy]) / gain + information(now)
    size = (right.size, right.size)
    matrix = LinearOperator(
        size,
        lambda d: (
            information(d.reshape(now.shape)) + spectral(d.reshape(now.shape), inverse)
        ).ravel(),
    )
    uniform = [1 / (CELL**2 / density + p) for p in inverse]
    nearly = LinearOperator(size, lambda d: spectral(d.reshape(now.shape), uniform).ravel())
    out, _ = cg(matrix, right.ravel(), x0=now.ravel(), M=nearly, rtol=1e-4, maxiter=12)
    columns, rows = (CELL * np.arange(n) + (CELL - 1) / 2 for n in hxx.shape[::-1])
    return columns, rows, out.reshape(now.shape)


def line(case: str, seed: int) -> str:
    """One case as a row of a table."""
    rms, noise = CASES[case]
    plane = TurbulentPlane(1.0, seed)
    a, b = render(
        lambda x, y: tuple(rms * d for d in plane(x, y, 3)), shape=SHAPE, seed=seed, noise=noise
    )
    columns, rows, d = posterior(a, b, rms)
    u, v = (rms * f for f in plane(*np.meshgrid(columns, SHAPE[0] - 1 - rows)))
    inner = np.s_[:, EDGE:-EDGE, EDGE:-EDGE]
    error = np.sqrt(np.mean((d - np.stack([u, -v]))[inner] ** 2))
    every = np.s_[EDGE:-EDGE:2, EDGE:-EDGE:2]  # 8 px apart, as our vectors are
    found, exact = (
        derivatives(f[every][::-1], g[every][::-1], 2 * CELL) for f, g in ((d[0], -d[1]), (u, v))
    )
    slopes = [np.sum(p * q) / np.sum(q**2) for p, q in zip(found, exact, strict=True)]
    return f"| {case} | {error:.4f} px | {slopes[0]:.2f}, {slopes[1]:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--case", default=next(iter(CASES)), choices=CASES)
    args = parser.parse_args()
    print("| u', noise | least error | gain of divergence, vorticity |\n|---|---|---|")
    print(line(args.case, args.seed))


if __name__ == "__main__":
    main()
