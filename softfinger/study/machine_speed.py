"""CPU speed of this machine, by benchmarks of the solver's and of PIV's kind of work."""

import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse

_SIDE = 40  # cells along each edge of the solver benchmark's cube
_REPEATS = 3


def probe() -> dict[str, float]:
    """Least CPU seconds of three: `solver` (sparse products) and `images` (FFTs)."""
    return {"solver": _best(_solver_work()), "images": _best(_image_work())}


def _best(work: Callable[[], None]) -> float:
    times = []
    for _ in range(_REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return round(min(times), 4)


def _solver_work() -> Callable[[], None]:
    line = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(_SIDE, _SIDE))
    one = sparse.identity(_SIDE)
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
