"""Pose, clock and motion of the finger in a laboratory's pictures, relative to the simulation.

One pose for all frames; the simulation's law as start + a (p((t - delay)/d) - start). The pictures
alone are fitted first (`fit_pictures`): roughly, each frame loosely bound to the law; then with the
scatter about it that the first fit found. `causes` compares that with what is stated. What is
stated of scale and clock then sharpens it (`register`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.formats.kinematics import Kinematics
from piv.files.errors import StageError
from piv.images.recording import Recording
from postprocess.lab.dpiv_toml import Dpiv, Start
from postprocess.lab.fit_outline import (
    DELAY,
    FACTORS,
    GROWTH,
    LAW,
    SCALE,
    SIZE,
    Frames,
    Shapes,
    fit_outline,
    law_pressure,
    law_through,
    pose_of,
    prepare,
    shapes_of,
    single_frames,
    state_of,
)
from postprocess.lab.outline_profile import (
    OutlineProfile,
    blind_parts,
    independent_share,
    outline_profile,
    seen_outlines,
)
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import FINE_PX, ROUGH_PX, learn

MAX_FRAMES, LEARN_FROM = 60, 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: largest deviation of the shape at rest from the simulation's
# deviation of a frame from the law, of the range: by itself, in the rough fit, least in the fit
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad: standard uncertainties of a stated camera
ROOT_STD, TURN_STD = 1.5e-3, np.radians(1.5)
GROWTH_STD = 1.5  # px, of the outline: blur and the mould's tolerance
OUTLINE_STD = 0.15  # px: no end of an outline is known better, whatever the particles say
# weak priors, by which the pictures alone decide: of factor and stretch, scale, delay (s)
LAW_STD, WEAK_SCALE, WEAK_DELAY = 0.3, 0.05, 0.02
FINER = 4.0  # ratio of the spread at the start of the rough fit to that of the fine one
# of the outline's points one in so many, blur (px), and sweeps at each heat and kept
ROUGH, FINE = (3, ROUGH_PX, (6, 20)), (2, FINE_PX, (6, 60))
# spread of factor, delay (s) and stretch at the start
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])
# where the fit begins: durations over the simulation's, scales over the stated one, delays of each,
# growth of the outline (px; a smaller one tolerates a rough pose and reflections)
STRETCHES = (0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0, 3.5, 6.0, 10.0)
SCALES = (0.5, 0.7, 1, 1.4, 2)
WRONG = 3.0  # factor of a duration, either way, that no stroke differs by
DELAYS, GROWN_PX = 60, -3.0
MIRRORED = 1.3  # times the evidence, from which the finger bends to the other side


Place = Callable[[tuple[float, float]], tuple[float, float]]


@dataclass(frozen=True)
class Law:
    """The recording's motion relative to the simulation's.

    `values`: (factor, delay s, stretch), with their covariance.
    """

    values: np.ndarray
    covariance: np.ndarray

    @property
    def delay(self) -> float:
        """Clock of the recording minus that of the simulation, s."""
        return float(self.values[1])

    def std(self, name: str) -> float:
        """Standard uncertainty of factor, delay or stretch."""
        at = ("factor", "delay", "stretch").index(name)
        return float(np.sqrt(self.covariance[at, at]))


@dataclass(frozen=True)
class Registration:
    """Pose of the tank frame in the pictures, and the law of motion.

    `covariance`: of (x px, y px, angle, ln magnification). `pressures` (frame,) Pa: what each frame
    at `times` (s of the recording's clock) shows by itself; none of vectors. `place`: of `Known`.
    """

    pose: Pose
    covariance: np.ndarray
    law: Law
    times: np.ndarray
    pressures: np.ndarray
    stated: Pose
    density: float = 0.0  # particles per pixel of the water; 0 of vectors
    place: Place = lambda at: at

    def summary(self) -> dict[str, Any]:
        """What was found, and its difference from what is stated, in a laboratory's units."""
        pose, law, stated = self.pose, self.law, self.stated
        std, scale = np.sqrt(np.diag(self.covariance)), pose.scale_mm_per_px
        return {
            "scale_mm_per_px": scale,
            "scale_std_percent": 100 * std[3],
            "turn_deg": np.degrees(pose.angle),
            "turn_std_deg": np.degrees(std[2]),
            "root_px": self.place(pose.at_px),
            "root_std_mm": std[:2] * scale,
            "delay_ms": law.delay * 1e3,
            "delay_std_ms": law.std("delay") * 1e3,
            "pressure_factor": law.values[0],
            "pressure_factor_std": law.std("factor"),
            "stretch": law.values[2],
            "stretch_std": law.std("stretch"),
            "scale_against_stated_percent": 100 * (scale / stated.scale_mm_per_px - 1),
            "turn_against_stated_deg": np.degrees(pose.angle - stated.angle),
            "root_against_stated_px": np.subtract(self.place(pose.at_px), self.place(stated.at_px)),
        }


@dataclass(frozen=True)
class Known:
    """What is stated of a recording's set-up.

    `pose`, with the relative `scale_std` and `turn_std` (rad); `delay` of the clock (s) with its
    standard uncertainty (None: from the motion); `paired`: the first of each pair of frames is
    used; `hidden`: length (m) of the finger that is hidden from its root on; `light_from`:
    direction (rad) of light from one side; `length_std`: relative standard uncertainty of the
    finger's length; `place`: from the pose's pixels to those of the laboratory's axes.
    """

    pose: Pose
    scale_std: float
    turn_std: float = TURN_STD
    delay: tuple[float, float] | None = None
    paired: bool = False
    hidden: float = 0.0
    light_from: float | None = None
    length_std: float = 0.0
    place: Place = lambda at: at

    def chosen(self, count: int) -> np.ndarray:
        """Indices of the frames of `count` that are fitted."""
        frames = np.arange(0, count, 2 if self.paired else 1)
        evenly = np.linspace(0, frames.size - 1, min(MAX_FRAMES, frames.size))
        return frames[evenly.round().astype(int)]


@dataclass(frozen=True)
class Fit:
    """What the pictures alone show.

    `state` (8,) of `fit_outline` with its `covariance`; `singles` and `singles_std` (4, frame): of
    `single_frames`; `law` (frame,) Pa: the fitted law at `times` (s); `interval` (s): between two
    pictures of the recording.
    """

    images: list[np.ndarray]
    times: np.ndarray
    interval: float
    state: np.ndarray
    covariance: np.ndarray
    law: np.ndarray
    singles: np.ndarray
    singles_std: np.ndarray
    profile: OutlineProfile


def fit_pictures(
    recording: Recording, times: np.ndarray, kinematics: Kinematics, known: Known, seed: int = 1
) -> Fit:
    """Fit a recording (frame times in s of its clock); StageError in one sentence if that fails."""
    chosen = known.chosen(len(recording))
    images, pose = [recording.frame(int(i)) for i in chosen], known.pose
    interval = float(np.ptp(times[chosen]) / max(np.ptp(chosen), 1) * (2 if known.paired else 1))
    times = times[chosen]
    some = images[:: max(1, len(images) // LEARN_FROM)]
    evidence = learn(some, None, known.light_from, kinematics.tip_width / pose.pixel)
    shapes, span = shapes_of(kinematics), kinematics.high - kinematics.low
    state, about = state_of(pose, np.array([1.0, 0.0, 1.0])), np.full(SIZE, np.inf)
    about[FACTORS], about[GROWTH] = LAW_STD, GROWTH_STD
    about[SCALE] = max(WEAK_SCALE, known.scale_std)
    if known.delay is not None:
        state[DELAY], about[DELAY] = known.delay[0], max(3 * known.delay[1], WEAK_DELAY)
    begin = np.array([*[ROOT_STD / pose.pixel] * 2, TURN_STD, known.scale_std, 0.5, *LAW_ABOUT])
    light = known.light_from
    passes = [ROUGH] * (1 if light is None else 3) + [FINE]  # the shade is found from the lit side
    blind = blind_parts(
        np.empty((times.size, 0, 2)), pose, kinematics, recording.shape, known.hidden, None
    )
    first, apart, share = state, np.full(times.size, LOOSE * span), 1.0
    during = np.ones(times.size, bool)  # the simulation, whose law is held where it ends
    for number, (every, blur_px, sweeps) in enumerate(passes):
        frames = prepare(images, times, evidence, blind, blur_px, share)
        few = shapes.thinned(every)
        if number == 0:
            first = _beginning(frames, few, state, about[DELAY])
            # of a clock that is wrong by a factor: the weak prior would pull the fit away from it
            if not 1 / WRONG < first[LAW.stop - 1] < WRONG:
                state[LAW.stop - 1] = first[LAW.stop - 1]
                about[LAW.stop - 1] = LAW_STD * first[LAW.stop - 1]
        elif (every, blur_px, sweeps) == FINE:
            begin[:4] /= FINER
        fitted = frames if during.all() else frames.at(during)
        prior, free = (state, about), apart[during]
        samples = fit_outline(fitted, few, first, begin, prior, free, sweeps, seed + number)
        first = samples.mean(axis=0)
        inside = (times - first[DELAY]) / first[LAW.stop - 1] <= kinematics.time[1]
        during = inside | (inside.sum() < LEARN_FROM)
        law = law_pressure(kinematics, times, first[LAW])
        singles, std = single_frames(frames, shapes, first, law, FREE * span)
        found = pose_of(first, kinematics.root)
        outlines = seen_outlines(shapes, found, singles[0], float(first[GROWTH]))
        blind = blind_parts(outlines, found, kinematics, recording.shape, known.hidden, light)
        profile = outline_profile(images, evidence, shapes, outlines, blind)
        # particles that go along with the finger make pictures less independent than they look
        share = independent_share(profile)
        if number + 1 < len(passes):
            # a law that lies off all pictures would seem to scatter, and hold itself there
            single = times[during], first[LAW], singles[0][during]
            first[LAW] = law_through(kinematics, *single)
            law = law_pressure(kinematics, times, first[LAW])
        excess = ((singles[0] - law) ** 2 - std[0] ** 2)[during]
        scatter = np.sqrt(max(np.mean(excess), (TIED * span) ** 2))
        at_rest = np.abs(law - kinematics.law(kinematics.time[0])) < REST * span
        apart = np.where(at_rest, min(scatter, REST_STD * span), scatter)
    if not np.hypot(*(first[:2] - pose.at_px)) < max(recording.shape):
        raise StageError(
            "the finger is not found in the pictures: no outline near axes.root_px explains them;"
            " correct root_px, scale_mm_per_px or frame_rate_hz"
        )
    covariance = np.cov(samples.T)
    ends = 2**0.5 * pose.pixel / kinematics.length
    covariance[: SCALE + 1, : SCALE + 1] += (OUTLINE_STD * np.diag([1, 1, ends, ends])) ** 2
    return Fit(images, times, interval, first, covariance, law, singles, std, profile)


def _beginning(frames: Frames, shapes: Shapes, state: np.ndarray, delay_std: float) -> np.ndarray:
    """The state (8,) from which the fit begins: the best of many durations and delays.

    StageError where the finger bends to the other side.
    """
    grid = np.meshgrid(STRETCHES, SCALES, np.linspace(0, 1, DELAYS), indexing="ij")
    stretch, scale, part = (values.ravel() for values in grid)
    low, high = np.multiply(delay_std, (-2, 2))
    if np.isinf(delay_std):
        low = frames.times[0] - np.ptp(shapes.kinematics.time) * stretch
        high = frames.times[0] + np.ptp(frames.times)
    tried = np.tile(state, (part.size, 1))
    tried[:, DELAY] += low + part * (high - low)
    tried[:, GROWTH], tried[:, LAW.stop - 1] = GROWN_PX, stretch
    tried[:, SCALE] -= np.log(scale)
    places = shapes.places(frames.times, tried[:, LAW])
    ours, other = (
        of.scores(frames, tried, places).sum(axis=1) for of in (shapes, shapes.mirrored())
    )
    if other.max() > MIRRORED * max(ours.max(), 0.0):
        raise StageError(
            "the finger bends to the other side than the simulation's: the pictures are mirrored;"
            ' correct axes.x in dpiv.toml ("left" where it is "right")'
        )
    first = tried[np.argmax(ours)]
    first[GROWTH] = 0.0
    return np.asarray(first)


def register(fit: Fit, kinematics: Kinematics, known: Known) -> Registration:
    """The registration: what the pictures show, with what is stated of scale and clock."""
    state, covariance = fit.state.copy(), fit.covariance.copy()
    covariance[SCALE, SCALE] += known.length_std**2  # a finger of another length
    stated = [(SCALE, -np.log(known.pose.pixel), known.scale_std)]
    if known.delay is not None:
        stated.append((DELAY, *known.delay))
    for at, value, std in stated:
        gain = covariance[:, at] / (covariance[at, at] + std**2)
        state += gain * (value - state[at])
        covariance -= np.outer(gain, covariance[at])
    law, pose = Law(state[LAW], covariance[LAW, LAW]), pose_of(state, kinematics.root)
    return Registration(
        pose, covariance[:4, :4], law, fit.times, fit.singles[0], known.pose, fit.profile.rate(),
        known.place,
    )  # fmt: skip


def stated_registration(dpiv: Dpiv, kinematics: Kinematics) -> Registration:
    """The registration of vectors as stated; the picture's unit is the stated metre.

    Of vectors without a clock `clock.onset` finds the delay.
    """
    axes = dpiv.axes
    start = dpiv.start if isinstance(dpiv.start, Start) else Start(at_s=0.0, std_s=0.0)
    assert axes.root_mm
    assert axes.root_std_mm
    x, y = np.array(axes.root_mm) * 1e-3
    at = float(-x if axes.x == "left" else x), float(y)
    root_std, turn_std = axes.root_std_mm * 1e-3, float(np.radians(axes.turn_std_deg))
    covariance = np.diag([root_std, root_std, turn_std, dpiv.scale.std_percent / 100]) ** 2
    pose = Pose(1e3, float(np.radians(axes.turn_deg)), kinematics.root, at)
    law = Law(np.array([1.0, -start.at_s, 1.0]), np.diag([0.0, start.std_s**2, 0.0]))
    return Registration(pose, covariance, law, np.empty(0), np.empty(0), pose)
