"""One pose and one law of motion fitted to the finger's outline in many frames at once.

The likelihood of `silhouette` has a bump per particle and long narrow ridges. A population of
chains (`outline_sampler`) begins far apart and is cooled into it; chains that fare worse are
replaced by copies of better ones (population annealing, Hukushima and Iba 2003). The mean of the
samples is the estimate: an edge lies half-way between the particles that bound it. Fitting the
law to all silhouettes, not to one bend per frame, uses every particle near an edge.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from fileio.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.outline_sampler import ADAPT, all_scores, frame_score, walk
from postprocess.lab.registration.silhouette import (
    FINE_PX,
    WaterLikelihood,
    integral_image,
)

TABLE = 241  # shapes in the table that outlines are interpolated from
REACH = 0.15  # of the simulation's range: how far a recording may bend beyond the simulation
LAW_POINTS = 2001  # of the law's own table
COLD = 2e-3  # share of the evidence at the beginning
CHAINS, EFFECTIVE = 12, 0.5  # and the share of them that a step of the heat leaves
STEP = 0.6  # first size of a joint step
ALIKE = 0.4  # variance between the chains over that within, where they have converged
# spread of the chains at the start, of `files.Nuisance` and of factor, delay (s), stretch
NUISANCE_ABOUT = np.array([0.5, 0.2])
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])
# range of a single frame's bend, in standard deviations, and its step, in the table's
FAR_OFF, FINE_STEP = 4.0, 0.1
# priors of `files.Nuisance` about 0: blur and the mould's tolerance (px), light on one side (px)
NUISANCE_STD = np.array([1.5, 0.5])
# while frames are loosely bound to the law, the second would take up the motion
ROUGH_NUISANCE_STD = np.array([1.5, 0.05])
LAW_STD = 0.3  # weak prior of factor and stretch about 1, for parts of the motion


@dataclass(frozen=True)
class Frames:
    """`integral_image` of the frames' evidence (frame, …) less its `mean`, and times (s)."""

    integrals: np.ndarray
    mean: float
    times: np.ndarray
    independent: float  # share of independent frames: particles at rest stay where they are


@dataclass(frozen=True)
class OutlineFit:
    """Samples of the change of the pose `first`, of nuisance, law and each frame's pressure.

    `pose` (sample, 4: x px, y px, angle, ln magnification), `nuisance` (sample, 2), `law`
    (sample, 3: factor, delay s, stretch), `parameter` (sample, frame; Pa).
    """

    first: Pose
    pose: np.ndarray
    nuisance: np.ndarray
    law: np.ndarray
    parameter: np.ndarray
    times: np.ndarray

    def mean_pose(self) -> Pose:
        """The pose in the middle of the samples."""
        return moved(self.first, self.pose.mean(axis=0))

    def evidence(self, frames: Frames, kinematics: Kinematics, grown_px: float) -> float:
        """Evidence in the middle of the samples, of an outline grown by `grown_px`."""
        table, outlines, normals = outline_table(kinematics)
        pose, pressures, _ = self.means()
        seat = (*pose.at_px, pose.angle, pose.pixel, grown_px, 0.0)
        places = (pressures - table[0]) / (table[1] - table[0])
        at = np.asarray(pose.anchor), seat, places
        return float(all_scores(frames.integrals, frames.mean, outlines, normals, *at).sum())

    def means(self) -> tuple[Pose, np.ndarray, np.ndarray]:
        """Pose, pressures (frame,) Pa and nuisance (2,) in the middle of the samples."""
        return self.mean_pose(), self.parameter.mean(axis=0), self.nuisance.mean(axis=0)


def moved(pose: Pose, change: np.ndarray) -> Pose:
    """A pose changed by (px, px, rad, ln of the magnification, …)."""
    at = (pose.at_px[0] + float(change[0]), pose.at_px[1] + float(change[1]))
    pose = pose.scaled(float(np.exp(-change[3])))
    return replace(pose, angle=pose.angle + float(change[2]), at_px=at)


def prepare(
    images: list[np.ndarray],
    times: np.ndarray,
    evidence: WaterLikelihood,
    blind: np.ndarray | None = None,
    blur_px: float = FINE_PX,
) -> Frames:
    """Evidence of frames taken at `times` (s); `blind` (frame, rows, columns): pixels left out."""
    seen = [evidence.image(image, blur_px) for image in images]
    if blind is not None:
        seen = [np.where(b, np.float32(0), f) for b, f in zip(blind, seen, strict=True)]
    few = [f.ravel()[::3] for f in seen]
    near = [np.corrcoef(a, b)[0, 1] for a, b in itertools.pairwise(few)]
    common = float(np.clip(np.mean(near), 0, 0.99)) if near else 0.0
    mean = float(np.mean([f.mean() for f in seen]))
    integrals = np.stack([integral_image(f, mean).astype(np.float32) for f in seen])
    return Frames(integrals, mean, np.asarray(times, float), (1 - common) / (1 + common))


def outline_table(kinematics: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pressures (n,), outlines (n, point, 2) m, and outward unit normals and sides (n, point, 3).

    The side is 1 on the dorsal, -1 on the ventral side, 0 at root and tip.
    """
    reach = REACH * (kinematics.high - kinematics.low)
    pressures = np.linspace(kinematics.low - reach, kinematics.high + reach, TABLE)
    outlines = np.array([counter_clockwise(o) for o in kinematics.shape("outline", pressures)])
    along = np.roll(outlines, -1, axis=-2) - np.roll(outlines, 1, axis=-2)
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    normals /= np.maximum(np.hypot(normals[..., 0], normals[..., 1]), 1e-12)[..., None]
    rest = np.argmin(np.abs(pressures - kinematics.law(kinematics.time[0])))
    up = normals[rest] @ kinematics.shape("dorsal_direction", pressures[rest])
    side = np.where(np.abs(up) > 0.5, np.sign(up), 0.0)
    return pressures, outlines, np.dstack([normals, np.broadcast_to(side, normals.shape[:2])])


def _converged(states: np.ndarray) -> bool:
    """Whether the means of chains (chain, sample, parameter) differ by less than their scatter."""
    between, within = states.mean(axis=1).var(axis=0, ddof=1), states.var(axis=1).mean(axis=0)
    return bool(np.all(between <= ALIKE * within))


def _next_heat(evidence: np.ndarray, heat: float) -> tuple[float, np.ndarray]:
    """The next share of the evidence (chain,) to count, at most 1, and the chains' weights.

    The weights keep at least `EFFECTIVE` of the chains.
    """
    for share in np.geomspace(2.0, 1.02, 20):
        new = min(heat * share, 1.0)
        weight = np.exp((new - heat) * (evidence - evidence.max()))
        weight /= weight.sum()
        if 1 / np.sum(weight**2) >= EFFECTIVE * evidence.size:
            break
    return new, weight


def fit_outline(
    frames: Frames,
    kinematics: Kinematics,
    first: Pose,
    law: np.ndarray,
    *,
    deviation: np.ndarray,
    about: np.ndarray,
    scale: tuple[float, float] | None,
    stated_delay: tuple[float, float] | None = None,
    nuisance: np.ndarray | None = None,
    nuisance_std: np.ndarray = NUISANCE_STD,
    seed: int = 1,
    sweeps: tuple[int, ...],
    rounds: int = 1,
    every: int = 1,
) -> OutlineFit:
    """Fit pose, law and pressures from a first guess of pose and law (factor, delay s, stretch).

    `deviation` (frame,) Pa: of a frame from the law. `about` (4,): uncertainty of the first pose
    (px, px, rad, ln magnification). `scale` (m per px, relative standard uncertainty) and
    `stated_delay` (s, s): priors, or None. `nuisance` (2,): first guess; `nuisance_std`: of its
    prior about 0. `sweeps`: of each chain, at each heat and in each of at most `rounds`, of which
    the second half is kept. `every`: of so many points of the outline one is used. ValueError
    where the recording's finger bends further than the simulation's shapes reach.
    """
    table, outlines, normals = outline_table(kinematics)
    outlines, normals = (np.ascontiguousarray(a[:, ::every]) for a in (outlines, normals))
    step = table[1] - table[0]
    clock = np.linspace(*kinematics.time, LAW_POINTS)
    history = (kinematics.law(clock) - table[0]) / step
    nuisance = np.zeros(2) if nuisance is None else nuisance
    mean, weight = np.zeros(9), np.zeros(9)
    mean[4:6], weight[4:6] = -nuisance, nuisance_std**-2.0
    mean[[6, 8]], weight[[6, 8]] = 1.0 - law[[0, 2]], LAW_STD**-2
    if scale is not None:
        mean[3], weight[3] = np.log(first.pixel / scale[0]), scale[1] ** -2
    if stated_delay is not None:
        mean[7], weight[7] = stated_delay[0] - law[1], max(stated_delay[1], 1e-5) ** -2
    start = np.array([*first.at_px, first.angle, first.pixel, *nuisance, *law])
    apart = np.asarray(deviation, float) / step
    rng = np.random.default_rng(seed)
    wide = np.concatenate([about, np.minimum(nuisance_std, NUISANCE_ABOUT), LAW_ABOUT])
    changes, offs = wide * rng.standard_normal((CHAINS, wide.size)), np.zeros((CHAINS, apart.size))
    changes[0] = 0.0
    least, sizes, alone = 0.01 * wide, np.full(2, STEP), np.minimum(apart, 0.3)

    def walked(heat: float, count: int, adapt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        states, places = np.empty((CHAINS, count, wide.size)), np.empty((CHAINS, count, apart.size))
        evidence = walk(
            frames.integrals,
            frames.mean,
            outlines,
            normals,
            np.asarray(first.anchor),
            start,
            changes,
            offs,
            frames.times,
            history,
            clock[0],
            clock[1] - clock[0],
            factor,
            sizes,
            alone,
            adapt,
            mean,
            weight,
            apart,
            heat * frames.independent,
            states,
            places,
            rng,
        )
        return states, places, frames.independent * evidence

    factor, heat = np.diag(wide), COLD
    while heat < 1:
        states, _, evidence = walked(heat, sweeps[0], ADAPT)
        factor = _steps_like(states[:, sweeps[0] // 2 :], least)
        heat, shares = _next_heat(evidence, heat)
        at = (rng.random() + np.arange(CHAINS)) / CHAINS * shares.sum()
        left = np.searchsorted(np.cumsum(shares), at)
        changes, offs = changes[left], offs[left]
    walked(heat, sweeps[0], ADAPT)
    done: list[tuple[np.ndarray, np.ndarray]] = []
    while len(done) < rounds:
        done.append(walked(heat, sweeps[1], 0.0)[:2])
        factor = _steps_like(done[-1][0], least)
        kept = zip(*done[len(done) // 2 :], strict=True)
        states, places = (np.concatenate(parts, axis=1) for parts in kept)
        if _converged(states):
            break
    states, places = states.reshape(-1, wide.size), places.reshape(-1, apart.size)
    middle = places.mean(axis=0)
    if middle.min() < 1 or middle.max() > TABLE - 2:
        raise ValueError(
            f"the recording's finger bends further than the simulation's by more than {REACH:.0%};"
            " give the simulation the recording's pressure (motion.strokes in scene.toml)"
        )
    pressures, moved_law = table[0] + step * places, states[:, 6:] + law
    change = states[:, :4], states[:, 4:6] + nuisance
    return OutlineFit(first, *change, moved_law, pressures, frames.times)


def _steps_like(states: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Cholesky factor of the chains' covariance plus `least` squared."""
    return np.linalg.cholesky(np.cov(states.reshape(-1, least.size).T) + np.diag(least**2))


def single_pressures(
    frames: Frames, kinematics: Kinematics, fit: OutlineFit, law: np.ndarray, deviation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure of each frame (frame,) by itself at the pose of a fit, and its standard deviation.

    By integration over a prior about `law` (frame,) of size `deviation`; all in Pa.
    """
    table, outlines, normals = outline_table(kinematics)
    pose, _, nuisance = fit.means()
    seat = (*pose.at_px, pose.angle, pose.pixel, *nuisance)
    off = np.arange(-FAR_OFF, FAR_OFF, FINE_STEP / deviation * (table[1] - table[0]))
    mean, std = np.empty(law.size), np.empty(law.size)
    for f, expected in enumerate(law):
        tried = np.clip(expected + off * deviation, table[0], table[-1])
        places = (tried - table[0]) / (table[1] - table[0])
        at = frames.integrals[f], frames.mean, outlines, normals, np.asarray(pose.anchor), seat
        score = np.array([frame_score(*at, place) for place in places])
        weight = frames.independent * score - 0.5 * off**2
        weight = np.exp(weight - weight.max())
        weight /= weight.sum()
        mean[f] = weight @ tried
        std[f] = np.sqrt(weight @ (tried - mean[f]) ** 2)
    return mean, std
