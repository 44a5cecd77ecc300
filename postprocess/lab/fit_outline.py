"""Fitting the finger's outline to many frames at once: one pose for all, one bend for each, with their uncertainty.

The likelihood of `silhouette` is sampled (adaptive Metropolis for the pose, one Metropolis step per frame for its bend). The mean
of the samples is the estimate: an edge lies, on average, not at the first particle that it meets but half-way to where it
could be; and their scatter is the uncertainty.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numba
import numpy as np

from postprocess.lab.family import Family
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import Evidence, running_sums

TABLE = 241  # shapes in the table that outlines are interpolated from
REACH = 0.15  # of the family's range: how far a recording may bend beyond the simulation
POSE = ("at_x_px", "at_y_px", "angle", "log_scale", "edge_px")


@dataclass(frozen=True)
class Frames:
    """Pictures ready to be fitted: running sums of their evidence (frame, row with y up, column) and their times (s)."""

    sums: np.ndarray
    times: np.ndarray
    independent: float  # share of the frames that bring news: particles at rest stay where they are


@dataclass(frozen=True)
class OutlineFit:
    """Samples of the pose (sample, 5 of `POSE`) and of each frame's parameter (sample, frame), and the pose they belong to."""

    first: Pose
    pose: np.ndarray
    parameter: np.ndarray
    times: np.ndarray
    accepted: float

    def mean_pose(self) -> Pose:
        """The pose in the middle of the samples."""
        return moved(self.first, self.pose.mean(axis=0))


def moved(pose: Pose, change: np.ndarray) -> Pose:
    """A pose changed by (px, px, rad, ln of px_per_m, …)."""
    at = (pose.at_px[0] + float(change[0]), pose.at_px[1] + float(change[1]))
    return Pose(pose.px_per_m * float(np.exp(change[3])), pose.angle + float(change[2]), pose.anchor, at)


def prepare(images: list[np.ndarray], times: np.ndarray, evidence: Evidence) -> Frames:
    """Running sums of frames (row 0 at the top) taken at `times` (s)."""
    found = [evidence.image(image) for image in images]
    near = [np.corrcoef(a.ravel()[::3], b.ravel()[::3])[0, 1] for a, b in itertools.pairwise(found)]
    common = float(np.clip(np.mean(near), 0, 0.99)) if near else 0.0
    sums = np.stack([running_sums(f).astype(np.float32) for f in found])
    return Frames(sums, np.asarray(times, float), (1 - common) / (1 + common))


def outline_table(family: Family) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pressures (n,), outlines (n, point, 2) in m and outward unit normals of their points."""
    reach = REACH * (family.high - family.low)
    pressures = np.linspace(family.low - reach, family.high + reach, TABLE)
    outlines = np.array([family.shape("outline", p) for p in pressures])
    along = np.roll(outlines, -1, axis=1) - np.roll(outlines, 1, axis=1)
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    return pressures, outlines, normals / np.hypot(normals[..., 0], normals[..., 1])[..., None]


@numba.njit(cache=True)
def frame_score(sums, outlines, normals, at, angle, px_per_m, anchor, edge, place):
    """Evidence inside the outline at `place` (index into the table, fractional) in one frame; `edge` (px) grows it."""
    rows, columns = sums.shape
    c, s = np.cos(angle), np.sin(angle)
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
        qx = at[0] + px_per_m * (c * x - s * y) + edge * (c * nx - s * ny)
        qy = at[1] + px_per_m * (s * x + c * y) + edge * (s * nx + c * ny)
        if k > 0:
            mx = min(max(0.5 * (qx + px) - 0.5, 0.0), columns - 1.0)
            my = min(max(0.5 * (qy + py), 0.0), rows - 1.0)
            i, j = min(int(mx), columns - 2), min(int(my), rows - 2)
            a, b = mx - i, my - j
            low = (1 - a) * sums[j, i] + a * sums[j, i + 1]
            high = (1 - a) * sums[j + 1, i] + a * sums[j + 1, i + 1]
            total += ((1 - b) * low + b * high) * (qy - py)
        px, py = qx, qy
    return total


@numba.njit(cache=True)
def _all(sums, outlines, normals, at, angle, px_per_m, anchor, edge, places):
    return np.array(
        [
            frame_score(sums[f], outlines, normals, at, angle, px_per_m, anchor, edge, places[f])
            for f in range(places.size)
        ]
    )


@numba.njit(cache=True)
def _sample(
    sums,
    outlines,
    normals,
    first,
    anchor,
    places,
    spread,
    place_step,
    prior,
    law,
    law_std,
    temper,
    burn,
    keep,
    rng,
):
    """Samples of the pose's change and of the places; `first` at_x, at_y, angle, px_per_m."""
    frames, size = places.size, spread.size
    rise = (places - places.min()) / max(places.max() - places.min(), 1.0)
    change = np.zeros(size)
    at = np.array([first[0], first[1]])
    scores = _all(sums, outlines, normals, at, first[2], first[3], anchor, 0.0, places)
    out, out_places = np.empty((keep, size)), np.empty((keep, frames))
    mean, second = np.zeros(size), np.diag(spread**2)
    factor = np.linalg.cholesky(second)
    steps = np.full(frames, place_step)
    size_of_step, taken = 0.6, 0
    for sweep in range(burn + keep):
        new = change + size_of_step * factor @ rng.standard_normal(size)
        heat = temper * min(
            1.0, 0.05 + 0.95 * sweep / (0.5 * burn)
        )  # annealed: the landscape has a bump per particle
        new_places = places + (new[5] - change[5]) + (new[6] - change[6]) * rise
        if new_places.min() < 0 or new_places.max() > outlines.shape[0] - 1:
            new_places = places.copy()
            new[5:] = change[5:]
        at = np.array([first[0] + new[0], first[1] + new[1]])
        tried = _all(
            sums,
            outlines,
            normals,
            at,
            first[2] + new[2],
            first[3] * np.exp(new[3]),
            anchor,
            new[4],
            new_places,
        )
        gain = heat * (tried.sum() - scores.sum()) - 0.5 * np.sum(prior * (new**2 - change**2))
        gain -= 0.5 * np.sum(((new_places - law) ** 2 - (places - law) ** 2) / law_std**2)
        accept = np.log(rng.random()) < gain
        if accept:
            change, scores, places = new, tried, new_places
        at = np.array([first[0] + change[0], first[1] + change[1]])
        scale = first[3] * np.exp(change[3])
        for f in range(frames):
            place = places[f] + steps[f] * rng.standard_normal()
            if place < 0 or place > outlines.shape[0] - 1:
                continue
            s = frame_score(
                sums[f], outlines, normals, at, first[2] + change[2], scale, anchor, change[4], place
            )
            gain = (
                heat * (s - scores[f])
                - 0.5 * ((place - law[f]) ** 2 - (places[f] - law[f]) ** 2) / law_std[f] ** 2
            )
            better = np.log(rng.random()) < gain
            if better:
                places[f], scores[f] = place, s
            if sweep < burn:
                steps[f] *= np.exp(0.05 * ((1.0 if better else 0.0) - 0.4))
        if sweep < burn:
            size_of_step *= np.exp(0.02 * ((1.0 if accept else 0.0) - 0.25))
            share = max(1.0 / (sweep + 20), 0.004)
            off = change - mean
            mean += share * off
            second = (1 - share) * second + share * np.outer(off, off)
            if sweep % 100 == 99:
                factor[:] = np.linalg.cholesky(second + np.diag((0.02 * spread) ** 2))
        else:
            taken += accept
            out[sweep - burn], out_places[sweep - burn] = change, places
    return out, out_places, taken / keep


def fit_outline(
    frames: Frames,
    family: Family,
    first: Pose,
    pressures: np.ndarray,
    *,
    scale_std: float | None,
    law_std: np.ndarray | None = None,
    seed: int = 1,
    burn: int,
    keep: int,
) -> OutlineFit:
    """Fit pose and pressure (Pa, one per frame) from a first guess of both.

    `scale_std`: relative standard uncertainty of the first pose's scale, a prior; None where nothing is known of it.
    `law_std` (frame,) Pa: that of `pressures`, finite where the finger is known to be at rest; else the pictures tell.
    """
    table, outlines, normals = outline_table(family)
    step = table[1] - table[0]
    places = np.clip((pressures - table[0]) / step, 0, table.size - 1.0)
    length_px = family.length * first.px_per_m
    # steps and priors: half a pixel along the finger; a pixel for the edge, which takes in blur and the mould's tolerance
    # and moves of all frames' bends at once, by a shift and by a factor, along which pose and bend would else be stuck
    spread = np.array([0.5, 0.5, 0.5 / length_px, 0.5 / length_px, 0.3, 0.3, 0.3])
    prior = np.array([0.0, 0.0, 0.0, 0.0 if scale_std is None else scale_std**-2, 1.0 / 1.5**2, 0.0, 0.0])
    known = np.full(places.size, 1e12) if law_std is None else np.minimum(law_std, 1e12)
    start = np.array([*first.at_px, first.angle, first.px_per_m])
    poses, found, accepted = _sample(
        frames.sums, outlines, normals, start, np.asarray(first.anchor), places.copy(), spread, 0.3, prior,
        places, known / step, frames.independent, burn, keep, np.random.default_rng(seed),
    )  # fmt: skip
    return OutlineFit(first, poses, table[0] + step * found, frames.times, float(accepted))
