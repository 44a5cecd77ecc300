"""Time-resolved sets of three, five or more frames: one field from all pairs of the set."""

from dataclasses import replace
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy import float32, ndarray

from piv.correlation import passes, prefilter
from piv.correlation.deform import Nodes
from piv.correlation.fft_pass import window_maps
from piv.correlation.newton_step import MOMENTS, cell_moments
from piv.correlation.options import Options, OptionWords, with_options
from piv.correlation.pair import both_seen, nodes_of, run_passes, to_dataset
from piv.correlation.pair_images import Prepared, check_images, check_masks
from piv.correlation.uncertainty import errors_of
from piv.sequence.camera_shake import frame_shifts, shifted


@with_options
def correlate_frames(
    frames: list[Any], *, mask: Any = None, shake: bool = True, **options: Unpack[OptionWords]
) -> xr.Dataset:
    """Displacement per frame interval at the middle of an odd number of equally spaced frames.

    Arguments and result as of `correlate_pair`; mask: one for all frames or one per frame; shake:
    whether the camera's is measured and taken out, so that only its mean motion over the set stays
    in the vectors (attribute `shake_unknown`: 1 where it could not be measured and the frames are
    used as recorded). Every frame is warped to the middle instant along the paths of the field
    found so far; the correlations of all pairs of frames are added up with the weight of a
    straight-line fit (a pair n frames apart counts n times) and one Newton step is taken for d and,
    from the pairs that are not symmetric in time, for the unsteady acceleration. Random errors fall
    with the lever arm of the set: the idea of pyramid correlation (Sciacchitano et al. 2012) and of
    fluid trajectory correlation (Lynch & Scarano 2013), on warped images. ValueError where the
    number of frames is even or below three.
    """
    if len(frames) < 3 or len(frames) % 2 == 0:
        raise ValueError(
            f"a multi-frame set needs an odd number of frames, at least 3, got {len(frames)}"
        )
    settings = Options(**options)
    if settings.method != "correlation":
        raise ValueError("the multi-frame mode correlates; method must be 'correlation'")
    settings = replace(settings, passes=max(settings.full_steps, len(frames) // 2 + 2))
    shake_unknown = False
    if shake:
        frames = check_images(frames, settings.window)
        masks = check_masks(mask, len(frames), frames[0].shape)
        shifts = frame_shifts(frames, masks)
        shake_unknown = shifts is None
        if shifts is not None and shifts.any():
            frames, mask = shifted(frames, masks, shifts)
    images = Prepared(list(frames), mask, settings.window)
    both = both_seen(images.seen)
    reach = len(frames) // 2
    instants = np.arange(-reach, reach + 1)
    half, nodes, keep = nodes_of(images.shape, settings)
    x, y = nodes.x, nodes.y
    acceleration = np.zeros((2, y.size, x.size), float32)
    work = {f: np.empty((2, images.shape[0] // f, images.shape[1] // f), float32) for f in (1, 2)}
    calls = {1: 0, 2: 0}

    def maps_of(columns, rows, shift_x, shift_y, size):
        half, _ = images.half
        pairs = ((half[k], half[k + 1]) for k in (reach - 1, reach))
        return sum(window_maps(a, b, columns, rows, shift_x, shift_y, size) for a, b in pairs)

    def cells_of(nodes: Nodes, kernel: prefilter.Kernel, dx, dy) -> ndarray:
        f = nodes.factor
        level = images.images(f)
        for image in level:
            image.filter(kernel)
        # a wider set multiplies the error of the vectors it starts from: widen it as they improve
        near = 1 if f == 2 else min(1 + calls[1], reach)
        calls[f] += 1
        used = [k for k, t in enumerate(instants) if abs(t) <= near]
        shape = (len(instants), *work[f].shape[1:])
        weight = np.empty(shape, float32)
        for k in used:
            t = instants[k]
            for axis, moved in enumerate(paths(dx, dy, x, y, acceleration, float(t))):
                nodes.dense(moved, work[f][axis])
            level[k].warp(work[f][0], work[f][1], 1.0, weight[k], False)
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
        if f == 1:
            step_acceleration(nodes, bent)
        return total

    def step_acceleration(nodes: Nodes, bent: ndarray) -> None:
        # accelerations vary as slowly as the displacement they come from: twice the window keeps
        # their noise down
        padded = np.concatenate([bent, np.ones((MOMENTS - 5, *bent.shape[1:]), float32)])
        sums, _ = nodes.window_sums(padded, 1.5 * settings.sigma)
        det = sums[2] * sums[4] - sums[3] ** 2
        ok = det > 1e-3 * np.median(det)
        for axis, (p, q) in enumerate(((4, (0, 1)), (2, (1, 0)))):
            step = (sums[p] * sums[q[0]] - sums[3] * sums[q[1]]) / np.where(ok, det, 1)
            acceleration[axis] += np.where(ok, np.clip(step, -0.25, 0.25), 0)

    def spectra_of(nodes: Nodes, kernel: prefilter.Kernel, dx, dy) -> tuple | None:
        pair = images.images(1)[reach - 1 : reach + 2 : 2]
        moves = [(*paths(dx, dy, x, y, acceleration, t), 1.0) for t in (-1.0, 1.0)]
        return prefilter.radial_spectra(passes.strip_spectra(nodes, pair, moves, both, kernel))

    def reseed(nodes: Nodes, vectors: passes.Displacements) -> passes.Displacements:
        pair = [images.pixels[reach], images.pixels[reach + 1]]
        return passes.reseed(nodes, pair, vectors, settings)

    seen = both_seen(images.half[1])
    vectors = run_passes(half, nodes, seen, settings, maps_of, cells_of, spectra_of, reseed)
    field = to_dataset(vectors, errors_of(nodes, vectors, settings), nodes, keep, settings)
    return field.assign_attrs(shake_unknown=int(shake_unknown))


def paths(dx, dy, x, y, unsteady: ndarray, t: float) -> tuple[ndarray, ndarray]:
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
