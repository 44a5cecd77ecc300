"""Where the laboratory's finger is in its pictures and when it moves, against the simulation's: pose, time, motion.

Space: one pose for all frames (`fit_outline`), with the stated scale as a prior. Time: the law of the simulation,
start + a (p((t - delay)/d) - start), is fitted to the pressures that the frames show; a and d say how far and how fast
the recording's finger moves beside the simulation's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import least_squares

from piv.masks import dark_body
from piv.readers import Recording
from postprocess.lab.family import Family
from postprocess.lab.fit_outline import (
    Frames,
    OutlineFit,
    _all,
    fit_outline,
    outline_table,
    prepare,
)
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import learn

MAX_FRAMES = 60
LEARN_FROM = 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: how well the shape at rest is that of the simulation
DELAYS = np.arange(-0.3, 0.3001, 0.004)  # s: searched around the stated start
LAW = ("factor", "delay", "stretch")
SWEEPS = (1500, 800, 2500, 3000)
THIN = 40  # samples of the pose to which the law is fitted


@dataclass(frozen=True)
class Law:
    """The recording's motion in terms of the simulation's: (factor, delay s, stretch), covariance, rms misfit (Pa)."""

    values: np.ndarray
    covariance: np.ndarray
    misfit: float

    @property
    def delay(self) -> float:
        """Clock of the recording minus that of the simulation, s."""
        return float(self.values[1])

    def std(self, name: str) -> float:
        """Standard uncertainty of factor, delay or stretch."""
        return float(np.sqrt(self.covariance[LAW.index(name), LAW.index(name)]))


@dataclass(frozen=True)
class Registration:
    """Pose of the tank frame in the pictures with the covariance of (x px, y px, angle, ln scale), and the motion's law.

    `times` (frame,) s of the recording's clock, `pressures` and `pressures_std` (Pa): what each fitted frame shows.
    """

    pose: Pose
    covariance: np.ndarray
    edge_px: float
    law: Law
    times: np.ndarray
    pressures: np.ndarray
    pressures_std: np.ndarray
    stated: Pose | None


def law_pressure(family: Family, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The simulation's law, stretched: pressures (Pa) at times of the recording's clock."""
    factor, delay, stretch = values
    start = float(family.law(family.time[0]))
    at = np.clip((np.asarray(times) - delay) / stretch, *family.time)
    return start + factor * (family.law(at) - start)


def fit_law(
    family: Family, times: np.ndarray, pressures: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Least-squares (factor, delay, stretch), their covariance from the residuals, and the rms residual (Pa)."""
    noise = 0.005 * (family.high - family.low)
    fit = least_squares(
        lambda z: (law_pressure(family, times, z) - pressures) / noise,
        first,
        x_scale=(0.01, 0.001, 0.01),
        bounds=([0.2, -1.0, 0.2], [3.0, 1.0, 5.0]),
        loss="soft_l1",
    )
    rest = (law_pressure(family, times, fit.x) - pressures) / noise
    scatter = np.sum(rest**2) / max(rest.size - 3, 1)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * scatter
    return fit.x, covariance, float(noise * np.sqrt(np.mean(rest**2)))


def first_pose(recording: Recording, frames: list[np.ndarray], family: Family) -> Pose:
    """A rough pose from the finger's root and tip in the first frame, in which it is straight."""
    mask = dark_body(frames[0]).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    (cx, cy), size, angle = cv2.minAreaRect(max(contours, key=cv2.contourArea))
    length, along = (size[0], angle) if size[0] > size[1] else (size[1], angle + 90)
    direction = np.array([np.cos(np.radians(along)), -np.sin(np.radians(along))])  # picture, y up
    direction *= 1 if direction[1] < 0 else -1  # the finger hangs
    centre = np.array([cx, recording.shape[0] - 1 - cy])
    rest = family.shape("tip", float(family.law(family.time[0]))) - family.root
    turn = np.arctan2(direction[1], direction[0]) - np.arctan2(rest[1], rest[0])
    root = centre - 0.5 * length * direction
    return Pose(length / family.length, float(turn), family.root, (float(root[0]), float(root[1])))


def search_delay(frames: Frames, family: Family, pose: Pose, stated: float | None) -> float:
    """Delay (s) at which the simulation's motion fits the frames best: a correlation over time of the finger's picture."""
    table, outlines, normals = outline_table(family)
    span = frames.times[-1] - frames.times[0]
    around = (
        np.arange(-0.04, 0.0401, 0.004) if stated is not None else np.arange(-span - 0.1, span + 0.1, 0.006)
    )
    scores = []
    for delay in around + (stated or 0.0):
        pressures = law_pressure(family, frames.times, np.array([1.0, delay, 1.0]))
        places = (pressures - table[0]) / (table[1] - table[0])
        scores.append(
            _all(
                frames.sums,
                outlines,
                normals,
                np.asarray(pose.at_px),
                pose.angle,
                pose.px_per_m,
                np.asarray(pose.anchor),
                -1.0,
                places,
            ).sum()
        )
    return float(around[int(np.argmax(scores))] + (stated or 0.0))


def register(
    recording: Recording,
    times: np.ndarray,
    family: Family,
    stated: Pose | None,
    stated_delay: float | None,
    *,
    scale_std: float | None,
    paired: bool = False,
    sweeps: tuple[int, int, int, int] = SWEEPS,
    seed: int = 1,
) -> Registration:
    """Register a recording (frame times in s of its clock) to the simulation's finger.

    `stated`: the pose that the laboratory states, or None: from root and tip in the first frame. `stated_delay`: likewise the
    clock's, None: from the motion alone. `paired`: frames 1-2, 3-4 … are taken close together, so only the first of each is used.
    `sweeps`: of the sampler, to be dropped and kept, in the rough and in the final fit.
    """
    frames_used = np.arange(0, len(recording), 2 if paired else 1)
    count = min(MAX_FRAMES, frames_used.size)
    chosen = frames_used[np.unique(np.linspace(0, frames_used.size - 1, count).round().astype(int))]
    images = [recording.frame(int(i)) for i in chosen]
    evidence = learn(images[:: max(1, len(images) // LEARN_FROM)])
    frames = prepare(images, times[chosen], evidence)
    pose = stated or first_pose(recording, images, family)
    delay = search_delay(frames, family, pose, stated_delay)
    first = np.array([1.0, delay, 1.0])
    rough = fit_outline(
        frames,
        family,
        pose,
        law_pressure(family, frames.times, first),
        scale_std=scale_std,
        seed=seed,
        burn=sweeps[0],
        keep=sweeps[1],
    )
    values, _, _ = fit_law(family, frames.times, rough.parameter.mean(axis=0), first)
    span, start = family.high - family.low, float(family.law(family.time[0]))
    predicted = law_pressure(family, frames.times, values)
    at_rest = np.abs(predicted - start) < REST * span
    guess = np.where(at_rest, start, rough.parameter.mean(axis=0))
    known = np.where(at_rest, REST_STD * span, np.inf)
    fine = fit_outline(
        frames,
        family,
        replace(rough.mean_pose(), px_per_m=pose.px_per_m),
        guess,
        scale_std=scale_std,
        law_std=known,
        seed=seed + 1,
        burn=sweeps[2],
        keep=sweeps[3],
    )
    return _registration(frames, family, fine, values, stated)


def _registration(
    frames: Frames, family: Family, fit: OutlineFit, first: np.ndarray, stated: Pose | None
) -> Registration:
    mean = fit.parameter.mean(axis=0)
    values, covariance, misfit = fit_law(family, frames.times, mean, first)
    step = max(1, len(fit.pose) // THIN)
    some = np.array([fit_law(family, frames.times, p, values)[0] for p in fit.parameter[::step]])
    return Registration(
        fit.mean_pose(),
        np.cov(fit.pose[:, :4].T),
        float(fit.pose[:, 4].mean()),
        Law(values, covariance + np.cov(some.T), misfit),
        frames.times,
        mean,
        fit.parameter.std(axis=0),
        stated,
    )
