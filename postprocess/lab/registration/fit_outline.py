"""Fitting the finger's outline to many frames at once: one pose, one law of motion, and how far each frame is off that law.

The likelihood of `silhouette` is sampled (adaptive Metropolis for pose and law together, one Metropolis step per frame for its
deviation). The mean of the samples is the estimate: an edge lies, on average, not at the first particle that it meets but
half-way to where it could be; and their scatter is the uncertainty. Pose, clock and bend are not told apart by one frame but by
all: fitting the law to the frames' silhouettes themselves uses every particle near an edge, where a law fitted afterwards to
one bend per frame uses a mean over each frame's.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from fileio.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.outline_sampler import sample
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
COLD = 0.05  # share of the evidence at the beginning: the landscape has a bump per particle, so the chain is cooled into it
# priors of `files.NUISANCE` about 0: edge takes in blur and the mould's tolerance (px), lateral what light or a reflection does to
# one side (px), perspective a camera that looks at the sheet with 5° at half a metre (1/m)
NUISANCE_STD = np.array([1.5, 0.5, 0.2, 0.2])
ROUGH_NUISANCE_STD = np.array(
    [1.5, 0.05, 0.01, 0.01]
)  # while frames are free to be off the law, they would take up the motion
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
    accepted: float

    def mean_pose(self) -> Pose:
        """The pose in the middle of the samples."""
        return moved(self.first, self.pose.mean(axis=0))

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
        evidence_images = [np.where(b, np.float32(0), f) for b, f in zip(blind, evidence_images, strict=True)]
    near = [np.corrcoef(a.ravel()[::3], b.ravel()[::3])[0, 1] for a, b in itertools.pairwise(evidence_images)]
    common = float(np.clip(np.mean(near), 0, 0.99)) if near else 0.0
    mean = float(np.mean([f.mean() for f in evidence_images]))
    integrals = np.stack([integral_image(f, mean).astype(np.float32) for f in evidence_images])
    return Frames(integrals, mean, np.asarray(times, float), (1 - common) / (1 + common))


def outline_table(kinematics: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pressures (n,), outlines (n, point, 2) in m and of their points (n, point, 3) the outward unit normal and the side: 1 on
    the dorsal, -1 on the ventral one, 0 at root and tip, where the normal is along the finger."""
    reach = REACH * (kinematics.high - kinematics.low)
    pressures = np.linspace(kinematics.low - reach, kinematics.high + reach, TABLE)
    outlines = np.array([counter_clockwise(outline) for outline in kinematics.shape("outline", pressures)])
    normals = outward(outlines)
    rest = np.argmin(np.abs(pressures - kinematics.law(kinematics.time[0])))
    side = sides(normals[rest], kinematics.shape("dorsal_direction", pressures[rest]))
    return pressures, outlines, np.dstack([normals, np.broadcast_to(side, normals.shape[:2])])


def settled(rounds: list[tuple[np.ndarray, np.ndarray]]) -> bool:
    """Whether the last two rounds of samples (sample, parameter) agree: their means are no further apart than their scatter."""
    if len(rounds) < 2:
        return False
    early, late = rounds[-2][0], rounds[-1][0]
    scatter = np.sqrt(0.5 * (early.var(axis=0) + late.var(axis=0)))
    return bool(np.all(np.abs(early.mean(axis=0) - late.mean(axis=0)) <= scatter))


def fit_outline(
    frames: Frames,
    kinematics: Kinematics,
    first: Pose,
    law: np.ndarray,
    *,
    deviation: np.ndarray,
    scale_std: float | None,
    stated_delay: tuple[float, float] | None = None,
    nuisance: np.ndarray | None = None,
    nuisance_std: np.ndarray = NUISANCE_STD,
    known_std: np.ndarray | None = None,
    seed: int = 1,
    sweeps: tuple[int, ...],
    rounds: int = 1,
) -> OutlineFit:
    """Fit pose, law and pressures from a first guess of pose and law (factor, delay s, stretch).

    `deviation` (frame,) Pa: standard size of what a frame may be off the law. `scale_std`: relative standard uncertainty of the
    first pose's scale, a prior; None where nothing is known of it. `stated_delay`: value and standard uncertainty (s), likewise.
    `nuisance` (4,): first guess, `nuisance_std`: of its prior about 0. `known_std` (8,): standard uncertainty of the first pose and
    nuisance where they are known, in place of `scale_std` and `nuisance_std`.
    `sweeps`: of the sampler, to be dropped and kept, in at most so many `rounds`, until it has settled.
    ValueError where the recording's finger bends further than the simulation's shapes reach.
    """
    burn, keep = sweeps
    table, outlines, normals = outline_table(kinematics)
    step = table[1] - table[0]
    clock = np.linspace(*kinematics.time, LAW_POINTS)
    history = (kinematics.law(clock) - table[0]) / step
    length_px = kinematics.length / first.scale_m_per_px
    # first steps: half a pixel along the finger; half a millisecond
    tilt = 0.5 / length_px / kinematics.length
    spread = np.array([0.5, 0.5, 0.5 / length_px, 0.5 / length_px, 0.3, 0.3, tilt, tilt, 3e-3, 5e-4, 3e-3])
    nuisance = np.zeros(4) if nuisance is None else nuisance
    mean, weight = np.zeros(spread.size), np.zeros(spread.size)
    mean[4:8], weight[4:8] = -nuisance, nuisance_std**-2.0
    mean[[8, 10]], weight[[8, 10]] = 1.0 - law[[0, 2]], LAW_STD**-2
    if scale_std is not None:
        weight[3] = scale_std**-2
    if stated_delay is not None:
        mean[9], weight[9] = stated_delay[0] - law[1], max(stated_delay[1], 1e-5) ** -2
    if known_std is not None:
        mean[:8], weight[:8] = 0.0, known_std**-2.0
    start = np.array([*first.at_px, first.angle, first.scale_m_per_px, *nuisance, *law])
    apart, rng = np.asarray(deviation, float) / step, np.random.default_rng(seed)
    change, off, steps, cold = np.zeros(spread.size), np.zeros(frames.times.size), np.diag(spread**2), COLD
    done: list[tuple[np.ndarray, np.ndarray]] = []
    while len(done) < rounds and not settled(done):
        states, places, change, off, accepted = sample(
            frames.integrals, frames.mean, outlines, normals, np.asarray(first.anchor), start, change, off, frames.times, history,
            clock[0], clock[1] - clock[0], steps, 0.02 * spread, mean, weight, apart, frames.independent, cold, burn, keep, rng,
        )  # fmt: skip
        done.append((states, places))
        steps, cold, burn = np.cov(states.T) + np.diag((0.02 * spread) ** 2), 1.0, max(burn // 4, 200)
    # where it would not settle, the drift of all rounds but the first is part of the uncertainty
    last = done[-2:] if settled(done) else done[-max(rounds - 1, 1) :]
    states, places = (np.concatenate(parts) for parts in zip(*last, strict=True))
    middle = places.mean(axis=0)
    if middle.min() < 1 or middle.max() > TABLE - 2:
        raise ValueError(
            f"the recording's finger bends further than the simulation's by more than {REACH:.0%}; give the simulation the"
            " recording's pressure (motion.strokes in scene.toml)"
        )
    return OutlineFit(
        first, states[:, :4], states[:, 4:8] + nuisance, states[:, 8:] + law, table[0] + step * places, frames.times, float(accepted)
    )  # fmt: skip
