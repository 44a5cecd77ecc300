"""The compiled sampler of `fit_outline`: Metropolis steps of pose, law and bends."""

from __future__ import annotations

import numba
import numpy as np

from postprocess.lab.registration.silhouette import left_of

TAKEN, TAKEN_ALONE = 0.25, 0.4  # shares of steps taken that are aimed at
ADAPT = 0.02  # of a step's size, by each step
LAW_STEPS = 4  # of the law alone, in each sweep


@numba.njit(cache=True)
def frame_score(integral, mean, outlines, normals, anchor, seat, place):
    """Evidence inside the outline at `place` (index into the table, fractional) in one frame.

    `integral` and `mean` as of `silhouette.integral_image`; `seat`: x and y (px) of `anchor` (m),
    angle (rad), size of a pixel (m), and the two of `files.Nuisance`; `normals` as of
    `outline_table`.
    """
    x0, y0, angle, pixel, edge, lateral = seat
    c, s = np.cos(angle), np.sin(angle)
    magnification = 1 / pixel
    t = min(max(int(place), 0), outlines.shape[0] - 2)
    w = place - t
    n = outlines.shape[1]
    total = 0.0
    px = py = 0.0
    for k in range(n + 1):
        m = k if k < n else 0
        x = (1 - w) * outlines[t, m, 0] + w * outlines[t + 1, m, 0] - anchor[0]
        y = (1 - w) * outlines[t, m, 1] + w * outlines[t + 1, m, 1] - anchor[1]
        nx, ny = normals[t, m, 0], normals[t, m, 1]
        out = edge + lateral * normals[t, m, 2]
        qx = x0 + magnification * (c * x - s * y) + out * (c * nx - s * ny)
        qy = y0 + magnification * (s * x + c * y) + out * (s * nx + c * ny)
        if k > 0:
            total += left_of(integral, mean, px, py, qx, qy)
        px, py = qx, qy
    return total


@numba.njit(cache=True)
def all_scores(integrals, mean, outlines, normals, anchor, seat, places):
    """`frame_score` of every frame, (frame,)."""
    out = np.empty(places.size)
    for f in range(places.size):
        out[f] = frame_score(integrals[f], mean, outlines, normals, anchor, seat, places[f])
    return out


@numba.njit(cache=True)
def _seat_of(first, change):
    """The `seat` of `frame_score` that `first` (9,) becomes by a change (9,) of the chain."""
    to = first + change
    return to[0], to[1], to[2], first[3] * np.exp(-change[3]), to[4], to[5]


@numba.njit(cache=True)
def _law_places(times, values, law, begin, step):
    """Places at `times` (s) by start + factor (law((t - delay)/stretch) - start).

    `law` is tabulated at `begin` + k `step` (s).
    """
    out = np.empty(times.size)
    for f in range(times.size):
        at = ((times[f] - values[1]) / values[2] - begin) / step
        at = min(max(at, 0.0), law.size - 1.0)
        k = min(int(at), law.size - 2)
        out[f] = law[0] + values[0] * ((1 - at + k) * law[k] + (at - k) * law[k + 1] - law[0])
    return out


@numba.njit(cache=True)
def walk(
    integrals,
    mean_evidence,
    outlines,
    normals,
    anchor,
    first,
    changes,
    offs,
    times,
    law,
    begin,
    step,
    factor,
    sizes,
    alone,
    adapt,
    mean_prior,
    weight_prior,
    apart,
    heat,
    out,
    out_places,
    rng,
):
    """Sweeps of several chains through pose, nuisance, law and the frames' places.

    A chain is at a change (9,) of `first` (x, y, angle, scale or ln magnification, 2 of
    `files.Nuisance`, factor, delay, stretch), `changes` (chain, 9), and at deviations `offs`
    (chain, frame) of the places from the law's, of standard size `apart` (frame,); both are moved
    on. Besides joint steps the law takes steps under places that stay, which only the deviations
    follow (interweaving, Yu and Meng 2011): it would else hardly move where these are large.
    `factor` (9, 9): Cholesky factor of the steps' covariance; `sizes` (2,), `alone` (frame,):
    sizes of joint steps, of the law's and of each frame's, adapted by `adapt`. `mean_prior`,
    `weight_prior`: of the changes' priors. `heat`: share of the evidence that counts. States go to
    `out` (chain, sweep, 9) and `out_places` (chain, sweep, frame). Returns the evidence (chain,).
    """
    chains, sweeps, size = out.shape
    frames = times.size
    largest = outlines.shape[0] - 1.0
    evidence = np.empty(chains)
    for c in range(chains):
        change, off = changes[c].copy(), offs[c].copy()
        places = _law_places(times, first[6:] + change[6:], law, begin, step) + off
        scores = all_scores(
            integrals, mean_evidence, outlines, normals, anchor, _seat_of(first, change), places
        )
        for sweep in range(sweeps):
            new = change + sizes[0] * factor @ rng.standard_normal(size)
            new_law = first[6:] + new[6:]
            accept = new_law[0] > 0.05 and new_law[2] > 0.05
            if accept:
                new_places = _law_places(times, new_law, law, begin, step) + off
                accept = new_places.min() >= 0 and new_places.max() <= largest
            if accept:
                seat = _seat_of(first, new)
                tried = all_scores(
                    integrals, mean_evidence, outlines, normals, anchor, seat, new_places
                )
                gain = heat * (tried.sum() - scores.sum())
                gain -= 0.5 * np.sum(
                    weight_prior * ((new - mean_prior) ** 2 - (change - mean_prior) ** 2)
                )
                accept = np.log(rng.random()) < gain
                if accept:
                    change, scores, places = new, tried, new_places
            sizes[0] *= np.exp(adapt * ((1.0 if accept else 0.0) - TAKEN))
            for _ in range(LAW_STEPS):
                new_law = change[6:] + sizes[1] * factor[6:] @ rng.standard_normal(size)
                values = first[6:] + new_law
                if values[0] <= 0.05 or values[2] <= 0.05:
                    continue
                new_off = places - _law_places(times, values, law, begin, step)
                gain = -0.5 * np.sum((new_off**2 - off**2) / apart**2)
                gain -= 0.5 * np.sum(
                    weight_prior[6:]
                    * ((new_law - mean_prior[6:]) ** 2 - (change[6:] - mean_prior[6:]) ** 2)
                )
                better = np.log(rng.random()) < gain
                if better:
                    change[6:], off = new_law, new_off
                sizes[1] *= np.exp(adapt * ((1.0 if better else 0.0) - TAKEN))
            seat = _seat_of(first, change)
            for f in range(frames):
                move = alone[f] * rng.standard_normal()
                if places[f] + move < 0 or places[f] + move > largest:
                    continue
                s = frame_score(
                    integrals[f], mean_evidence, outlines, normals, anchor, seat, places[f] + move
                )
                gain = (
                    heat * (s - scores[f])
                    - 0.5 * ((off[f] + move) ** 2 - off[f] ** 2) / apart[f] ** 2
                )
                better = np.log(rng.random()) < gain
                if better:
                    places[f], off[f], scores[f] = places[f] + move, off[f] + move, s
                alone[f] *= np.exp(adapt * ((1.0 if better else 0.0) - TAKEN_ALONE))
            out[c, sweep], out_places[c, sweep] = change, places
        changes[c], offs[c], evidence[c] = change, off, scores.sum()
    return evidence
