"""A plane vector field's divergence-free and curl-free parts (Helmholtz), by Fourier transform."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.fft

BEYOND = 12  # nodes of zeros beyond the field: opposite sides then know little of each other


@lru_cache(16)
def _turn(shape: tuple[int, int]) -> np.ndarray:
    """(kx + i ky)²/k² on the FFT frequencies of `shape`: 0 where there is no direction."""
    k = np.fft.fftfreq(shape[1])[None, :] + 1j * np.fft.fftfreq(shape[0])[:, None]
    square = np.abs(k) ** 2
    square[0, 0] = 1
    return (k**2 / square).astype(np.complex64)


def mirrored(ex: np.ndarray, ey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The field (ny, nx, float32) with its divergence-free part reversed: curl-free minus divergence-free part.

    So (e + mirrored)/2 is curl-free and (e - mirrored)/2 divergence-free. Nodes are equally spaced; absent ones are
    zero. With z = ex + i ey it is the Beurling transform of the conjugate of z.
    """
    shape = tuple(scipy.fft.next_fast_len(n + BEYOND) for n in ex.shape)
    conjugate = np.empty(ex.shape, np.complex64)
    conjugate.real, conjugate.imag = ex, -ey
    spectrum = scipy.fft.fft2(conjugate, s=shape, overwrite_x=True)
    spectrum *= _turn(shape)
    turned = scipy.fft.ifft2(spectrum, overwrite_x=True)[: ex.shape[0], : ex.shape[1]]
    return np.ascontiguousarray(turned.real), np.ascontiguousarray(turned.imag)
