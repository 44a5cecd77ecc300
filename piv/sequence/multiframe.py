"""Time-resolved sets of three, five or more frames: one field from all pairs of the set."""

from dataclasses import replace
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy import float32, ndarray

from piv.correlation.cell_moments import MOMENTS, cell_moments
from piv.correlation.fft_pass import window_maps
from piv.correlation.newton_step import Displacements
from piv.correlation.nodes import Nodes, nodes_of
from piv.correlation.options import Options, OptionWords, with_options
from piv.correlation.pair import to_dataset
from piv.correlation.pair_images import Prepared, check_images, check_masks
from piv.correlation.passes import reseed, run_passes, strip_spectra
from piv.correlation.prefilter import Kernel, Powers
from piv.correlation.uncertainty import errors_of
from piv.sequence.camera_shake import frame_shifts, shifted


@with_options
def correlate_frames(
    frames: list[Any], *, mask: Any = None, shake: bool = True, **options: Unpack[OptionWords]
) -> xr.Dataset:
    """Measure the displacement per frame interval at the middle of an odd number of frames.

    The correlations of all pairs of frames, warped to the middle instant, are added with the
    weights of a straight-line fit, after pyramid correlation (Sciacchitano et al. 2012) and fluid
    trajectory correlation (Lynch & Scarano 2013). Method: docs/piv_theory.md.

    Parameters
    ----------
    frames
        Equally spaced images, as of `correlate_pair`.
    mask
        One for all frames, or one per frame.
    shake
        Whether the camera's shake is measured and taken out, so that only its mean motion over the
        set stays in the vectors.
    options
        Fields of `Options`.

    Returns
    -------
    xarray.Dataset
        As of `correlate_pair`; attribute `shake_unknown`: 1 where the shake could not be measured
        and the frames are used as recorded.

    Raises
    ------
    ValueError
        Where the number of frames is even or below three.
    TypeError
        For an unknown option, with the nearest spelling.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     field = piv.correlate_frames(list(film)[:5], window=24, spacing=12)
    >>> field.attrs["shake_unknown"] in (0, 1)
    True
    """
    if len(frames) < 3 or len(frames) % 2 == 0:
        raise ValueError(
            f"a multi-frame set needs an odd number of frames, at least 3, got {len(frames)}"
        )
    settings = Options(**options)
    settings = replace(settings, passes=max(settings.full_steps, len(frames) // 2 + 2))
    shake_unknown = False
    if shake:
        frames = check_images(frames, settings.window)
        masks = check_masks(mask, len(frames), frames[0].shape)
        shifts = frame_shifts(frames, masks)
        shake_unknown = shifts is None
        if shifts is not None and shifts.any():
            frames, mask = shifted(frames, masks, shifts)
    images = _FrameSet(list(frames), mask, settings)
    half, nodes, keep = nodes_of(images.shape, settings)
    vectors = run_passes(images, half, nodes, settings)
    field = to_dataset(vectors, errors_of(nodes, vectors, settings), nodes, keep, settings)
    return field.assign_attrs(shake_unknown=int(shake_unknown))


class _FrameSet(Prepared):
    """Frames about the middle one (piv.correlation.passes.Images), and their acceleration."""

    def __init__(self, frames: list[Any], mask: Any, options: Options):
        super().__init__(frames, mask, options)
        self.reach = len(frames) // 2
        self.instants = np.arange(-self.reach, self.reach + 1)
        rows, columns = self.shape
        self.work = {f: np.empty((2, rows // f, columns // f), float32) for f in (1, 2)}
        self.steps = 0  # at full resolution
        self.acceleration: ndarray | float = 0.0  # (2, ny, nx), of the nodes

    def maps(self, columns, rows, shift_x, shift_y, size: int) -> ndarray:
        before, middle, after = self.half[self.reach - 1 : self.reach + 2]
        first = window_maps(before, middle, columns, rows, shift_x, shift_y, size)
        return first + window_maps(middle, after, columns, rows, shift_x, shift_y, size)

    def cells(self, nodes: Nodes, kernel: Kernel, dx, dy) -> ndarray:
        level, instants = self.images(nodes.factor), self.instants
        for image in level:
            image.filter(kernel)
        # a wider set multiplies the error of the vectors it starts from: widen it as they improve
        near = 1 if nodes.factor == 2 else min(1 + self.steps, self.reach)
        used = [k for k, t in enumerate(instants) if abs(t) <= near]
        weight = self._warp(nodes, dx, dy, used)
        total = np.zeros((MOMENTS, *nodes.cell_shape), float32)
        bent = np.zeros((5, *nodes.cell_shape), float32)
        cells = np.empty_like(total)
        for i in used:
            for j in range(i + 1, used[-1] + 1):
                n = float(instants[j] - instants[i])
                cell_moments(level[i].warped, level[j].warped, weight[i] * weight[j], cells)
                # the pair sees n d + m a; the straight-line fit weighs its gradient with n,
                # coherence its noise
                trust = float32(_coherence_weight(cells))
                cells[:8] *= trust
                m = 0.5 * float(instants[j] ** 2 - instants[i] ** 2)
                total[:2] += float32(n) * cells[:2]
                total[2:5] += float32(n * n) * cells[2:5]
                total[5:] += cells[5:]
                if m:
                    bent[:2] += float32(m) * cells[:2]
                    bent[2:] += float32(m * m) * cells[2:5]
        if nodes.factor == 1:
            self.steps += 1
            self._step_acceleration(nodes, bent)
        return total

    def _warp(self, nodes: Nodes, dx, dy, used: list[int]) -> ndarray:
        """Warp the frames `used` to the middle instant; return their weights."""
        level, work = self.images(nodes.factor), self.work[nodes.factor]
        weight = np.empty((len(level), *work.shape[1:]), float32)
        for k in used:
            for axis, moved in enumerate(self._paths(nodes, dx, dy, float(self.instants[k]))):
                nodes.dense(moved, work[axis])
            level[k].warp(work[0], work[1], 1.0, weight[k], False)
        return weight

    def _paths(self, nodes: Nodes, dx, dy, t: float) -> tuple[ndarray, ndarray]:
        return paths(dx, dy, nodes.x, nodes.y, self.acceleration, t)

    def _step_acceleration(self, nodes: Nodes, bent: ndarray) -> None:
        """Take one Newton step for the acceleration from the sums of pairs not symmetric in time.

        Accelerations vary as slowly as the displacement they come from: twice the window keeps
        their noise down.
        """
        padded = np.concatenate([bent, np.ones((MOMENTS - 5, *bent.shape[1:]), float32)])
        sums, _ = nodes.window_sums(padded, 1.5 * self.options.sigma)
        det = sums[2] * sums[4] - sums[3] ** 2
        ok = det > 1e-3 * np.median(det)
        steps = [
            (sums[p] * sums[q] - sums[3] * sums[r]) / np.where(ok, det, 1)
            for p, q, r in ((4, 0, 1), (2, 1, 0))
        ]
        self.acceleration = self.acceleration + np.where(ok, np.clip(steps, -0.25, 0.25), 0)

    def powers(self, nodes: Nodes, kernel: Kernel, dx, dy) -> list[Powers]:
        pair = self.images(1)[self.reach - 1 : self.reach + 2 : 2]
        moves = [(*self._paths(nodes, dx, dy, t), 1.0) for t in (-1.0, 1.0)]
        return strip_spectra(nodes, pair, moves, self.common(1), kernel)

    def search_again(self, nodes: Nodes, vectors: Displacements) -> Displacements:
        return reseed(nodes, self.pixels[self.reach : self.reach + 2], vectors, self.options)


def paths(dx, dy, x, y, unsteady: ndarray | float, t: float) -> tuple[ndarray, ndarray]:
    """Displacement of particles that are at the nodes now, `t` frame intervals later (or earlier).

    Taylor series of the path in a field that is frozen but for the acceleration `unsteady` (2, ny,
    nx): D = t u + t²/2 (L u + unsteady) + t³/6 L² u + t⁴/24 L³ u with L = u·∇.
    """
    u = np.stack([dx, dy]).astype(float32)
    total = t * u + 0.5 * t * t * unsteady
    term, factor = u, t
    for order in (2, 3, 4):
        term = np.stack(
            [u[0] * np.gradient(c, x, axis=1) + u[1] * np.gradient(c, y, axis=0) for c in term]
        )
        factor *= t / order
        total = total + factor * term.astype(float32)
    return total[0], total[1]


def _coherence_weight(cells: ndarray) -> float:
    """Maximum-likelihood weight ρ/(1 - ρ²) of a pair of frames of correlation ρ."""
    own = float(np.sqrt(cells[5].sum(dtype=float) * cells[6].sum(dtype=float)))
    rho = float(cells[7].sum(dtype=float)) / own if own > 0 else 0.0
    rho = min(max(rho, 0.01), 0.99)
    return rho / (1 - rho**2)
