"""Fitting the finger's outline to many frames at once: one pose, one law of motion, and how far each frame is off that law.

The likelihood of `silhouette` is sampled by a population of chains (`outline_sampler`: Metropolis steps for pose and law together, one
per frame for its deviation). It has a bump per particle and long narrow ridges, on which a single chain stays where it came down: the
chains begin far apart and are cooled into it, those that fare worse on the way are given up for copies of better ones (population
annealing, Hukushima and Iba 2003), and what they still differ by in the end is part of the uncertainty. The mean of the samples is the
estimate: an edge lies, on average, not at the first particle that it meets but half-way to where it could be. Pose, clock and bend are not told apart by one frame but by
all: fitting the law to the frames' silhouettes themselves uses every particle near an edge, where a law fitted afterwards to
one bend per frame uses a mean over each frame's.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from fileio.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.outline_sampler import ADAPT, all_scores, frame_scores, walk
from postprocess.lab.registration.silhouette import (
    FINE_PX,
    WaterLikelihood,
    integral_image,
    outward,
    sides,
)

TABLE = 241  # shapes in the table that outlines are interpolated from
REACH = 0.15  # of the simulation's range: how far a recording may bend beyond the simulation
LAW_POINTS = 2001  # of the law's own table
COLD = 2e-3  # share of the evidence at the beginning
CHAINS, EFFECTIVE = 12, 0.5  # and the share of them that a step of the heat leaves
STEP = 0.6  # first size of a joint step
ALIKE = 0.4  # variance between the chains over that within, where they need not go on
NUISANCE_ABOUT = np.array(
    [0.5, 0.2, 0.03, 0.03]
)  # how far apart the chains begin, (px, px, 1/m, 1/m)
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])  # likewise: factor, delay (s), stretch
# of a single frame: how far it is looked for, in standard deviations, and in what steps, of the table's
FAR_OFF, FINE_STEP = 4.0, 0.1
# priors of `files.NUISANCE` about 0: edge takes in blur and the mould's tolerance (px), lateral what light does to
# one side (px), perspective a camera that looks at the sheet with 5° at half a metre (1/m)
NUISANCE_STD = np.array([1.5, 0.5, 0.2, 0.2])
# while frames are loosely bound to the law, the last three would take up the motion
ROUGH_NUISANCE_STD = np.array([1.5, 0.05, 0.01, 0.01])
LAW_STD = 0.3  # prior of factor and stretch about 1: weak, for recordings that show only a part of the motion


@dataclass(frozen=True)
class Frames:
    """Pictures ready to be fitted: `integral_image` of their evidence (frame, row, column), less its `mean`, and their times (s)."""

    integrals: np.ndarray
    mean: float
    times: np.ndarray
    independent: float  # share of the frames that bring news: particles at rest stay where they are


@dataclass(frozen=True)
class OutlineFit:
    """Samples of the pose's change (sample, 4: x px, y px, angle, ln magnification), of `files.NUISANCE` (sample, 4), of the law
    (sample, 3: factor, delay s, stretch) and of each frame's pressure (sample, frame; Pa), and the pose that is changed."""

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
        """Evidence in the middle of the samples, of an outline that has grown by so much (px)."""
        table, outlines, normals = outline_table(kinematics)
        pose, pressures, _ = self.means()
        seat = (*pose.at_px, pose.angle, pose.scale_m_per_px, grown_px, 0.0, 0.0, 0.0)
        places = (pressures - table[0]) / (table[1] - table[0])
        at = frames.integrals, frames.mean, outlines, normals, np.asarray(pose.anchor), seat, places
        return float(all_scores(*at).sum())

    def means(self) -> tuple[Pose, np.ndarray, np.ndarray]:
        """Pose, pressures (frame,) Pa and nuisance (4,) in the middle of the samples."""
        return self.mean_pose(), self.parameter.mean(axis=0), self.nuisance.mean(axis=0)


def moved(pose: Pose, change: np.ndarray) -> Pose:
    """A pose changed by (px, px, rad, ln of the magnification, …): a picture twice as large has half the scale."""
    at = (pose.at_px[0] + float(change[0]), pose.at_px[1] + float(change[1]))
    scale = pose.scale_m_per_px * float(np.exp(-change[3]))
    return Pose(scale, pose.angle + float(change[2]), pose.anchor, at)


def prepare(
    images: list[np.ndarray],
    times: np.ndarray,
    evidence: WaterLikelihood,
    blind: np.ndarray | None = None,
    blur_px: float = FINE_PX,
) -> Frames:
    """Evidence of frames (row 0 at the top) taken at `times` (s); `blind` (frame, rows, columns): pixels that tell nothing."""
    evidence_images = [evidence.image(image, blur_px) for image in images]
    if blind is not None:
        evidence_images = [
            np.where(b, np.float32(0), f) for b, f in zip(blind, evidence_images, strict=True)
        ]
    near = [
        np.corrcoef(a.ravel()[::3], b.ravel()[::3])[0, 1]
        for a, b in itertools.pairwise(evidence_images)
    ]
    common = float(np.clip(np.mean(near), 0, 0.99)) if near else 0.0
    mean = float(np.mean([f.mean() for f in evidence_images]))
    integrals = np.stack([integral_image(f, mean).astype(np.float32) for f in evidence_images])
    return Frames(integrals, mean, np.asarray(times, float), (1 - common) / (1 + common))


def outline_table(kinematics: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pressures (n,), outlines (n, point, 2) in m and of their points (n, point, 3) the outward unit normal and the side: 1 on
    the dorsal, -1 on the ventral one, 0 at root and tip, where the normal is along the finger."""
    reach = REACH * (kinematics.high - kinematics.low)
    pressures = np.linspace(kinematics.low - reach, kinematics.high + reach, TABLE)
    outlines = np.array(
        [counter_clockwise(outline) for outline in kinematics.shape("outline", pressures)]
    )
    normals = outward(outlines)
    rest = np.argmin(np.abs(pressures - kinematics.law(kinematics.time[0])))
    side = sides(normals[rest], kinematics.shape("dorsal_direction", pressures[rest]))
    return pressures, outlines, np.dstack([normals, np.broadcast_to(side, normals.shape[:2])])


def settled(states: np.ndarray) -> bool:
    """Whether chains (chain, sample, parameter) tell the same: their means lie closer together than each chain's own scatter."""
    between, within = states.mean(axis=1).var(axis=0, ddof=1), states.var(axis=1).mean(axis=0)
    return bool(np.all(between <= ALIKE * within))


def next_heat(evidence: np.ndarray, heat: float) -> tuple[float, np.ndarray]:
    """A larger share of the evidence (chain,) to count, and the chains' weights at it: at most 1, and no less than `EFFECTIVE` of the
    chains are left by the weights."""
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

    `deviation` (frame,) Pa: standard size of what a frame may be off the law. `about` (4,): how far off the first pose may be, (px, px,
    rad, ln magnification). `scale`: stated, m per px, and its relative standard uncertainty, a prior; None where nothing is known of it.
    `stated_delay`: value and standard uncertainty (s), likewise. `nuisance` (4,): first guess, `nuisance_std`: of its prior about 0.
    `sweeps`: of each chain, at each heat and in each of at most so many `rounds`, of which the second half is kept.
    `every`: of how many points of the outline one is used.
    ValueError where the recording's finger bends further than the simulation's shapes reach.
    """
    table, outlines, normals = outline_table(kinematics)
    outlines, normals = (
        np.ascontiguousarray(outlines[:, ::every]),
        np.ascontiguousarray(normals[:, ::every]),
    )
    step = table[1] - table[0]
    clock = np.linspace(*kinematics.time, LAW_POINTS)
    history = (kinematics.law(clock) - table[0]) / step
    nuisance = np.zeros(4) if nuisance is None else nuisance
    mean, weight = np.zeros(11), np.zeros(11)
    mean[4:8], weight[4:8] = -nuisance, nuisance_std**-2.0
    mean[[8, 10]], weight[[8, 10]] = 1.0 - law[[0, 2]], LAW_STD**-2
    if scale is not None:
        mean[3], weight[3] = np.log(first.scale_m_per_px / scale[0]), scale[1] ** -2
    if stated_delay is not None:
        mean[9], weight[9] = stated_delay[0] - law[1], max(stated_delay[1], 1e-5) ** -2
    start = np.array([*first.at_px, first.angle, first.scale_m_per_px, *nuisance, *law])
    apart = np.asarray(deviation, float) / step
    rng = np.random.default_rng(seed)
    wide = np.concatenate([about, np.minimum(nuisance_std, NUISANCE_ABOUT), LAW_ABOUT])
    changes, offs = wide * rng.standard_normal((CHAINS, wide.size)), np.zeros((CHAINS, apart.size))
    changes[0] = 0.0
    least, sizes, alone = 0.01 * wide, np.full(2, STEP), np.minimum(apart, 0.3)

    def walked(heat: float, count: int, adapt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        states, places = np.empty((CHAINS, count, wide.size)), np.empty((CHAINS, count, apart.size))
        evidence = walk(
            frames.integrals, frames.mean, outlines, normals, np.asarray(first.anchor), start, changes, offs, frames.times,
            history, clock[0], clock[1] - clock[0], factor, sizes, alone, adapt, mean, weight, apart, heat * frames.independent,
            states, places, rng,
        )  # fmt: skip
        return states, places, frames.independent * evidence

    factor, heat = np.diag(wide), COLD
    while heat < 1:
        states, _, evidence = walked(heat, sweeps[0], ADAPT)
        factor = steps_like(states[:, sweeps[0] // 2 :], least)
        heat, shares = next_heat(evidence, heat)
        left = np.searchsorted(
            np.cumsum(shares), (rng.random() + np.arange(CHAINS)) / CHAINS * shares.sum()
        )
        changes, offs = changes[left], offs[left]
    walked(heat, sweeps[0], ADAPT)
    done: list[tuple[np.ndarray, np.ndarray]] = []
    while len(done) < rounds:
        done.append(walked(heat, sweeps[1], 0.0)[:2])
        factor = steps_like(done[-1][0], least)
        states, places = (
            np.concatenate(parts, axis=1) for parts in zip(*done[len(done) // 2 :], strict=True)
        )
        if settled(states):
            break
    states, places = states.reshape(-1, wide.size), places.reshape(-1, apart.size)
    middle = places.mean(axis=0)
    if middle.min() < 1 or middle.max() > TABLE - 2:
        raise ValueError(
            f"the recording's finger bends further than the simulation's by more than {REACH:.0%}; give the simulation the"
            " recording's pressure (motion.strokes in scene.toml)"
        )
    return OutlineFit(
        first,
        states[:, :4],
        states[:, 4:8] + nuisance,
        states[:, 8:] + law,
        table[0] + step * places,
        frames.times,
    )


def steps_like(states: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Cholesky factor of the covariance of chains' states (chain, sample, parameter), none smaller than `least` squared."""
    return np.linalg.cholesky(np.cov(states.reshape(-1, least.size).T) + np.diag(least**2))


def single_pressures(
    frames: Frames, kinematics: Kinematics, fit: OutlineFit, law: np.ndarray, deviation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure of each frame (frame,) by itself at the pose of a fit, and its standard deviation (Pa), by integration.

    `law` (frame,) Pa: what a frame is off by a standard size of `deviation` (Pa).
    """
    table, outlines, normals = outline_table(kinematics)
    pose, _, nuisance = fit.means()
    seat = (*pose.at_px, pose.angle, pose.scale_m_per_px, *nuisance)
    off = np.arange(-FAR_OFF, FAR_OFF, FINE_STEP / deviation * (table[1] - table[0]))
    mean, std = np.empty(law.size), np.empty(law.size)
    for f, expected in enumerate(law):
        tried = np.clip(expected + off * deviation, table[0], table[-1])
        places = (tried - table[0]) / (table[1] - table[0])
        score = frame_scores(
            frames.integrals[f],
            frames.mean,
            outlines,
            normals,
            np.asarray(pose.anchor),
            seat,
            places,
        )
        weight = frames.independent * score - 0.5 * off**2
        weight = np.exp(weight - weight.max())
        weight /= weight.sum()
        mean[f] = weight @ tried
        std[f] = np.sqrt(weight @ (tried - mean[f]) ** 2)
    return mean, std
