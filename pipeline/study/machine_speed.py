"""How fast this machine is now: seconds of CPU for two fixed pieces of work, one like the solver's, one like PIV's."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse

SIDE = 40  # cells along the edge of the cube of 64,000 that the solver's piece works on
REPEATS = 3


def probe() -> dict[str, float]:
    """CPU seconds of each piece, the best of three: `solver` (sparse products in main memory) and `images` (FFTs)."""
    return {"solver": _best(_solver_work()), "images": _best(_image_work())}


def _best(work: Callable[[], None]) -> float:
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return round(min(times), 4)


def _solver_work() -> Callable[[], None]:
    line = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(SIDE, SIDE))
    one = sparse.identity(SIDE)
    laplacian = sum(
        sparse.kron(sparse.kron(a, b), c)
        for a, b, c in ((line, one, one), (one, line, one), (one, one, line))
    ).tocsr()

    def work() -> None:
        x = np.linspace(0, 1, laplacian.shape[0])
        for _ in range(300):
            x = x - 0.1 * (laplacian @ x)

    return work


def _image_work() -> Callable[[], None]:
    windows = np.random.default_rng(1).random((512, 64, 64), np.float32)

    def work() -> None:
        spectrum = np.fft.rfft2(windows)
        np.fft.irfft2(spectrum * spectrum.conj())

    return work
