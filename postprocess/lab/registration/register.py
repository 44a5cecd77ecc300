"""Pose, clock and motion of the finger in a laboratory's pictures, relative to the simulation.

One pose for all frames, with the stated scale as a prior; the simulation's law as
start + a (p((t - delay)/d) - start). Both are fitted to all silhouettes (`fit_outline`): roughly,
each frame loosely bound to the law; then with the scatter about it that the first fit found.
What each frame shows by itself is found last, at that pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import least_squares

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from piv.images.masks import dark_body
from piv.images.recording import Recording
from postprocess.lab.data.files import Law, Registration
from postprocess.lab.data.pictures import thinned
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.blind import blind_parts
from postprocess.lab.registration.check_stated import (
    CLEARLY,
    GROWN_PX,
    STRETCHED,
    best_delay,
    stated_wrongly,
)
from postprocess.lab.registration.fit_outline import (
    DELAY,
    FACTORS,
    GROWTH,
    LAW,
    LAW_ABOUT,
    SIZE,
    OutlineFit,
    fit_outline,
    prepare,
    shapes_of,
    single_pressures,
    state_of,
)
from postprocess.lab.registration.outline_profile import independent_share, outline_profile
from postprocess.lab.registration.silhouette import ROUGH_PX, WaterLikelihood, learn

MAX_FRAMES, LEARN_FROM = 60, 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: largest deviation of the shape at rest from the simulation's
# deviation of a frame from the law, of the range: by itself, in the rough fit, least in the fit
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad, 1: standard uncertainties of a stated camera, where none are stated
ROOT_STD, TURN_STD, SCALE_STD = 1.5e-3, np.radians(1.5), 0.02
GROWTH_STD = 1.5  # px, of the outline: blur and the mould's tolerance
OUTLINE_STD = 0.15  # px: no end of an outline is known better, whatever the particles say
LAW_STD = 0.3  # weak prior of factor and stretch about 1, for parts of the motion
FINER = 4.0  # ratio of those to what the rough fit leaves
ROUGH_POINTS, FINE_POINTS = 3, 2  # of the outline's points one is used
SHADE_ROUNDS = 2  # of the rough fit, in which the shaded side is found from the lit one
SWEEPS, QUICK_SWEEPS = (6, 20, 6, 60), (4, 10, 4, 30)  # of the rough and of the final fit


@dataclass(frozen=True)
class Known:
    """What is stated of a recording's set-up.

    `pose`, with the relative `scale_std` (None: from the first frame and the finger's length) and
    `turn_std` (rad); `delay` of the clock (s) with its standard uncertainty (None: from the
    motion); `paired`: the first of each pair of frames is used; `hidden`: length (m) of the finger
    that is hidden from its root on; `light_from`: direction (rad) of light from one side;
    `length_std`: relative standard uncertainty of the finger's length.
    """

    pose: Pose | None = None
    scale_std: float | None = None
    turn_std: float | None = None
    delay: tuple[float, float] | None = None
    paired: bool = False
    hidden: float = 0.0
    light_from: float | None = None
    length_std: float = 0.0

    def chosen(self, count: int) -> np.ndarray:
        """Indices of the frames of `count` that are fitted."""
        return thinned(np.arange(0, count, 2 if self.paired else 1), MAX_FRAMES)


def law_pressure(kinematics: Kinematics, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The simulation's law, stretched: pressures (Pa) at times of the recording's clock."""
    factor, delay, stretch = values
    start = float(kinematics.law(kinematics.time[0]))
    at = np.clip((np.asarray(times) - delay) / stretch, *kinematics.time)
    return start + factor * (kinematics.law(at) - start)


def fit_law(
    kinematics: Kinematics, times: np.ndarray, pressures: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """Least-squares (factor, delay, stretch) of pressures (Pa) at times (s)."""
    noise = 0.005 * (kinematics.high - kinematics.low)
    fit = least_squares(
        lambda z: (law_pressure(kinematics, times, z) - pressures) / noise,
        first,
        x_scale=(0.01, 0.001, 0.01),
        bounds=([0.2, -1.0, 0.2], [3.0, 1.0, 5.0]),
        loss="soft_l1",
    )
    return np.asarray(fit.x)


def _first_pose(frame: np.ndarray, kinematics: Kinematics) -> Pose:
    """A rough pose from the finger's root and tip in the first frame, in which it is straight."""
    mask = dark_body(frame).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    (cx, cy), size, angle = cv2.minAreaRect(max(contours, key=cv2.contourArea))
    length, along = (size[0], angle) if size[0] > size[1] else (size[1], angle + 90)
    direction = np.array([np.cos(np.radians(along)), -np.sin(np.radians(along))])  # picture, y up
    direction *= 1 if direction[1] < 0 else -1  # the finger hangs
    rest = kinematics.shape("tip", float(kinematics.law(kinematics.time[0]))) - kinematics.root
    turn = np.arctan2(direction[1], direction[0]) - np.arctan2(rest[1], rest[0])
    x, y = np.array([cx, frame.shape[0] - 1 - cy]) - 0.5 * length * direction
    return Pose(1e3 * kinematics.length / length, float(turn), kinematics.root, (x, y))


def learned(images: list[np.ndarray], known: Known, pose: Pose, width: float) -> WaterLikelihood:
    """The likelihood of some of the images, of a finger of a `width` (m)."""
    some = images[:: max(1, len(images) // LEARN_FROM)]
    return learn(some, light_from=known.light_from, width_px=width / pose.pixel)


def register(
    recording: Recording,
    times: np.ndarray,
    kinematics: Kinematics,
    known: Known,
    *,
    sweeps: tuple[int, int, int, int] = SWEEPS,
    seed: int = 1,
) -> Registration:
    """Register a recording (frame times in s of its clock) to the simulation's finger.

    `sweeps`: of the rough and of the final fit. ValueError in one sentence where it fails.
    """
    chosen = known.chosen(len(recording))
    images = [recording.frame(int(i)) for i in chosen]
    pose = known.pose or _first_pose(images[0], kinematics)
    evidence = learned(images, known, pose, kinematics.tip_width)
    alike = kinematics, recording.shape, known.hidden
    blind = blind_parts(np.empty((len(images), 0, 2)), pose, *alike, None)
    frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
    shapes = shapes_of(kinematics)
    few = shapes.thinned(ROUGH_POINTS)
    state, about = state_of(pose, np.array([1.0, 0.0, 1.0])), np.full(SIZE, np.inf)
    about[FACTORS], about[GROWTH] = LAW_STD, GROWTH_STD
    begin = np.array([*[ROOT_STD / pose.pixel] * 2, TURN_STD, SCALE_STD, 0.5, *LAW_ABOUT])
    if known.scale_std is not None:
        about[3] = begin[3] = float(np.hypot(known.scale_std, known.length_std))
    if known.delay is not None:
        state[DELAY], about[DELAY] = known.delay[0], max(known.delay[1], 1e-5)
    wrong, shown = stated_wrongly(frames, few, state, scale_known=known.pose is not None)
    span, lasts = kinematics.high - kinematics.low, float(np.ptp(frames.times))
    reach, step = (
        (lasts + 0.1, 0.006) if known.delay is None else (max(0.04, 3 * about[DELAY]), 0.004)
    )
    first, loose = state.copy(), np.full(chosen.size, LOOSE * span)
    first[DELAY] = best_delay(frames, few, state, state[DELAY] + np.arange(-reach, reach, step))[0]
    prior, how = (state, about), (sweeps[:2], seed)
    try:
        rough = fit_outline(frames, few, first, begin, prior, loose, *how)
    except StageError as error:
        raise StageError(wrong or str(error)) from error
    stretch, shrunk = rough.state[-1], rough.states.mean(axis=0, keepdims=True)
    shrunk[:, GROWTH] = GROWN_PX
    places = shapes.places_of(rough.pressures.mean(axis=0))[None]
    as_good = CLEARLY * few.scores_at(frames, shrunk, places).sum() > shown
    if wrong and not (as_good and 1 / STRETCHED < stretch < STRETCHED):
        raise StageError(wrong)
    profile = outline_profile(images, evidence, shapes, *rough.seen, blind)
    for _ in range(SHADE_ROUNDS if known.light_from is not None else 0):
        blind = blind_parts(profile.outlines, pose, *alike, known.light_from)
        frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
        rough = fit_outline(frames, few, first, begin, prior, loose, *how)
        profile = outline_profile(images, evidence, shapes, *rough.seen, blind)
    law = fit_law(kinematics, frames.times, rough.pressures.mean(axis=0), first[LAW])
    frames = prepare(images, times[chosen], evidence, blind)
    # particles that go along with the finger make pictures less independent than they look
    frames = replace(frames, independent=min(frames.independent, independent_share(profile)))
    first = np.array([*rough.state[:5], *law])
    apart = _deviation(kinematics, frames.times, rough, law)
    begin[:4] /= FINER
    how = sweeps[2:], seed + 1
    fine = fit_outline(
        frames, shapes.thinned(FINE_POINTS), first, begin, (state, about), apart, *how
    )
    values, spread = fine.state[LAW], np.cov(fine.states.T)
    expected = law_pressure(kinematics, frames.times, values)
    seen, std = single_pressures(frames, shapes, fine.state, expected, FREE * span)
    length = kinematics.length / fine.seen[0].pixel
    spread[:4, :4] += (OUTLINE_STD * np.diag([1, 1, 2**0.5 / length, 2**0.5 / length])) ** 2
    misfit = float(np.sqrt(np.mean((seen - expected) ** 2)))
    motion = Law(values, spread[LAW, LAW], misfit), frames.times, seen, std
    growth = float(fine.state[GROWTH])
    found = Registration(fine.seen[0], spread[:4, :4], growth, *motion, known.pose)
    return with_length(found, known.scale_std, known.length_std)


def _deviation(
    kinematics: Kinematics, times: np.ndarray, rough: OutlineFit, law: np.ndarray
) -> np.ndarray:
    """Standard deviation (Pa) of each frame from the law, by the scatter of the rough fit."""
    span, start = kinematics.high - kinematics.low, float(kinematics.law(kinematics.time[0]))
    predicted, found = law_pressure(kinematics, times, law), rough.pressures
    off = np.mean((found.mean(axis=0) - predicted) ** 2) - np.mean(found.var(axis=0))
    moving = max(np.sqrt(max(off, 0.0)), TIED * span)
    at_rest = np.abs(predicted - start) < REST * span
    return np.where(at_rest, min(moving, REST_STD * span), moving)


def with_length(
    registration: Registration, scale_std: float | None, length_std: float
) -> Registration:
    """A registration with the uncertainty `length_std` (relative) of the finger's length.

    The fit's prior is of scale and length together; the change of the scale is shared by variance.
    """
    share, variance = 1.0, length_std**2
    if scale_std is not None and length_std > 0:
        share = scale_std**2 / (scale_std**2 + length_std**2)
        variance = share * length_std**2
    pose = registration.pose
    pose = pose.scaled((pose.pixel / (registration.stated or pose).pixel) ** (share - 1))
    turn = np.diag([1.0, 1.0, 1.0, share])
    covariance = turn @ registration.covariance @ turn
    covariance[3, 3] += variance
    return replace(registration, pose=pose, covariance=covariance)
