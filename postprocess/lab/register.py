"""Pose, clock and motion of the finger in a laboratory's pictures, relative to the simulation.

One pose for all frames, with the stated scale as a prior; the simulation's law as
start + a (p((t - delay)/d) - start). Both are fitted to all silhouettes (`fit_outline`): roughly,
each frame loosely bound to the law; then with the scatter about it that the first fit found.
What each frame shows by itself is found last, at that pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    SIZE,
    Frames,
    Shapes,
    fit_outline,
    law_pressure,
    pose_of,
    prepare,
    shapes_of,
    single_pressures,
    state_of,
)
from postprocess.lab.outline_profile import blind_parts, independent_share, outline_profile
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import ROUGH_PX, WaterLikelihood, learn

MAX_FRAMES, LEARN_FROM = 60, 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: largest deviation of the shape at rest from the simulation's
# deviation of a frame from the law, of the range: by itself, in the rough fit, least in the fit
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad: standard uncertainties of a stated camera
ROOT_STD, TURN_STD = 1.5e-3, np.radians(1.5)
GROWTH_STD = 1.5  # px, of the outline: blur and the mould's tolerance
OUTLINE_STD = 0.15  # px: no end of an outline is known better, whatever the particles say
LAW_STD = 0.3  # weak prior of factor and stretch about 1, for parts of the motion
FINER = 4.0  # ratio of those to what the rough fit leaves
ROUGH_POINTS, FINE_POINTS = 3, 2  # of the outline's points one is used
ROUGH, FINE = (6, 20), (6, 60)  # sweeps at each heat, and those that are kept
# spread of factor, delay (s) and stretch at the start
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])
# what may be stated wrongly by a factor: the rate of pictures, the scale
RATES, SCALES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0), (0.5, 2.0)
CLEARLY = 1.3  # times the evidence of what is stated, from which an alternative is the truth
STRETCHED = 1.5  # duration, either way, up to which a fit is one of the stated rate
COARSE_S = 0.012  # s between delays that are tried
# growth of the outline (px): a smaller one tolerates a rough pose and reflections
GROWN_PX = -3.0


@dataclass(frozen=True)
class Law:
    """The recording's motion relative to the simulation's.

    `values`: (factor, delay s, stretch), with their covariance; `misfit`: RMS residual (Pa).
    """

    values: np.ndarray
    covariance: np.ndarray
    misfit: float

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

    `covariance`: of (x px, y px, angle, ln magnification). `growth` (px): of the outline, as it is
    seen. `pressures` and `pressures_std` (frame,) Pa: what each frame at `times` (s of the
    recording's clock) shows by itself; none of vectors.
    """

    pose: Pose
    covariance: np.ndarray
    growth: float
    law: Law
    times: np.ndarray
    pressures: np.ndarray
    pressures_std: np.ndarray
    stated: Pose

    def summary(self) -> dict[str, Any]:
        """What was found, and its difference from what is stated, in a laboratory's units."""
        pose, law, stated = self.pose, self.law, self.stated
        std, scale = np.sqrt(np.diag(self.covariance)), pose.scale_mm_per_px
        return {
            "scale_mm_per_px": scale,
            "scale_std_percent": 100 * std[3],
            "turn_deg": np.degrees(pose.angle),
            "turn_std_deg": np.degrees(std[2]),
            "root_px": pose.at_px,
            "root_std_mm": std[:2] * scale,
            "delay_ms": law.delay * 1e3,
            "delay_std_ms": law.std("delay") * 1e3,
            "pressure_factor": law.values[0],
            "pressure_factor_std": law.std("factor"),
            "stretch": law.values[2],
            "stretch_std": law.std("stretch"),
            "scale_against_stated_percent": 100 * (scale / stated.scale_mm_per_px - 1),
            "turn_against_stated_deg": np.degrees(pose.angle - stated.angle),
            "root_against_stated_mm": (np.asarray(pose.at_px) - stated.at_px) * scale,
        }


@dataclass(frozen=True)
class Known:
    """What is stated of a recording's set-up.

    `pose`, with the relative `scale_std` and `turn_std` (rad); `delay` of the clock (s) with its
    standard uncertainty (None: from the motion); `paired`: the first of each pair of frames is
    used; `hidden`: length (m) of the finger that is hidden from its root on; `light_from`:
    direction (rad) of light from one side; `length_std`: relative standard uncertainty of the
    finger's length.
    """

    pose: Pose
    scale_std: float
    turn_std: float = TURN_STD
    delay: tuple[float, float] | None = None
    paired: bool = False
    hidden: float = 0.0
    light_from: float | None = None
    length_std: float = 0.0

    def chosen(self, count: int) -> np.ndarray:
        """Indices of the frames of `count` that are fitted."""
        frames = np.arange(0, count, 2 if self.paired else 1)
        evenly = np.linspace(0, frames.size - 1, min(MAX_FRAMES, frames.size))
        return frames[evenly.round().astype(int)]


def learned(images: list[np.ndarray], known: Known, pose: Pose, width: float) -> WaterLikelihood:
    """The likelihood of some of the images, of a finger of a `width` (m)."""
    some = images[:: max(1, len(images) // LEARN_FROM)]
    return learn(some, light_from=known.light_from, width_px=width / pose.pixel)


def register(
    recording: Recording, times: np.ndarray, kinematics: Kinematics, known: Known, seed: int = 1
) -> Registration:
    """Register a recording (frame times in s of its clock) to the simulation's finger.

    StageError in one sentence where it fails.
    """
    chosen = known.chosen(len(recording))
    images, times = [recording.frame(int(i)) for i in chosen], times[chosen]
    pose = known.pose
    evidence = learned(images, known, pose, kinematics.tip_width)
    shapes, span = shapes_of(kinematics), kinematics.high - kinematics.low
    few = shapes.thinned(ROUGH_POINTS)
    state, about = state_of(pose, np.array([1.0, 0.0, 1.0])), np.full(SIZE, np.inf)
    about[FACTORS], about[GROWTH] = LAW_STD, GROWTH_STD
    begin = np.array([*[ROOT_STD / pose.pixel] * 2, TURN_STD, 0.0, 0.5, *LAW_ABOUT])
    reach, step = np.ptp(times) + 0.1, 0.006
    about[3] = begin[3] = float(np.hypot(known.scale_std, known.length_std))
    if known.delay is not None:
        state[DELAY], about[DELAY] = known.delay[0], max(known.delay[1], 1e-5)
        reach, step = max(0.04, 3 * about[DELAY]), 0.004
    first, loose = state.copy(), np.full(times.size, LOOSE * span)
    outlines = np.empty((times.size, 0, 2))
    for light in (None,) if known.light_from is None else (None, *[known.light_from] * 2):
        # the shaded side is found from the lit one
        blind = blind_parts(outlines, pose, kinematics, recording.shape, known.hidden, light)
        frames = prepare(images, times, evidence, blind, ROUGH_PX)
        if light is None:
            delays = state[DELAY] + np.arange(-reach, reach, step)
            first[DELAY] = best_delay(frames, few, state, delays)[0]
            wrong = stated_wrongly(frames, few, state)
        try:
            samples = fit_outline(frames, few, first, begin, (state, about), loose, ROUGH, seed)
        except StageError as error:
            raise StageError(wrong[1] or str(error)) from error
        rough = samples.mean(axis=0)
        law, deviation = law_pressure(kinematics, times, rough[LAW]), FREE * span
        seen, std = single_pressures(frames, few, rough, law, deviation)
        found = pose_of(rough, kinematics.root), seen, float(rough[GROWTH])
        profile = outline_profile(images, evidence, shapes, *found, blind)
        outlines = profile.outlines
    rough[GROWTH] = GROWN_PX
    worse = wrong[0] > CLEARLY * few.scores(frames, rough[None], few.places_of(seen)[None]).sum()
    if wrong[1] and (worse or not 1 / STRETCHED < rough[-1] < STRETCHED):
        raise StageError(wrong[1])
    # particles that go along with the finger make pictures less independent than they look
    share = independent_share(profile)
    frames = prepare(images, times, evidence, blind, independent=share)
    scatter = np.sqrt(max(np.mean((seen - law) ** 2 - std**2), (TIED * span) ** 2))
    at_rest = np.abs(law - kinematics.law(kinematics.time[0])) < REST * span
    apart = np.where(at_rest, min(scatter, REST_STD * span), scatter)
    begin[:4] /= FINER
    samples = fit_outline(
        frames, shapes.thinned(FINE_POINTS), samples.mean(axis=0), begin, (state, about), apart,
        FINE, seed + 1,
    )  # fmt: skip
    fine, spread = samples.mean(axis=0), np.cov(samples.T)
    law = law_pressure(kinematics, times, fine[LAW])
    seen, std = single_pressures(frames, shapes, fine, law, deviation)
    length = kinematics.length / (pose := pose_of(fine, kinematics.root)).pixel
    spread[:4, :4] += (OUTLINE_STD * np.diag([1, 1, 2**0.5 / length, 2**0.5 / length])) ** 2
    misfit = float(np.sqrt(np.mean((seen - law) ** 2)))
    motion = Law(fine[LAW], spread[LAW, LAW], misfit), times, seen, std
    registration = Registration(pose, spread[:4, :4], float(fine[GROWTH]), *motion, known.pose)
    return with_length(registration, known.scale_std, known.length_std)


def best_delay(
    frames: Frames, shapes: Shapes, state: np.ndarray, delays: np.ndarray
) -> tuple[float, float]:
    """The delay (s) at which a motion fits the frames best, and its evidence; `state` (8,)."""
    states = np.tile(state, (delays.size, 1))
    states[:, DELAY] = delays
    places = shapes.places(frames.times, states[:, LAW])
    scores = shapes.scores(frames, states, places).sum(axis=1)
    best = int(np.argmax(scores))
    return float(delays[best]), float(scores[best])


def stated_wrongly(frames: Frames, shapes: Shapes, state: np.ndarray) -> tuple[float, str]:
    """Evidence of the best alternative to what is stated, and a sentence on it.

    An empty sentence where what is stated explains the frames about as well.
    """
    span, lasts = float(np.ptp(frames.times)), float(np.ptp(shapes.kinematics.time))

    def score(stretch: float = 1.0, scale: float = 1.0, of: Shapes = shapes) -> float:
        reach = max(span, stretch * lasts)
        delays = np.arange(-reach, span, max(COARSE_S * stretch, reach / 80))
        seen = np.array([*state[:3], state[3] - np.log(scale), GROWN_PX, 1, 0, stretch])
        return best_delay(frames, of, seen, delays)[1]

    others = {
        "the finger bends to the other side than the simulation's; the pictures are mirrored:"
        ' correct axes.x in dpiv.toml ("left" where it is "right")': score(of=shapes.mirrored())
    }
    for factor in SCALES:
        text = f"the finger is as long as if the scale were {factor:g} times the stated one"
        others[f"{text}; correct [scale] in dpiv.toml"] = score(scale=factor)
    for factor in RATES:
        text = f"the finger moves as if the pictures were taken {factor:g} times as fast as stated"
        text += "; correct frame_rate_hz in dpiv.toml (of pictures in pairs: the pairs per second),"
        others[f"{text} or motion.strokes of the scene"] = score(stretch=factor)
    shown, best = max((evidence, text) for text, evidence in others.items())
    return (shown, best) if shown > CLEARLY * max(score(), 0.0) else (-np.inf, "")


def with_length(registration: Registration, scale_std: float, length_std: float) -> Registration:
    """A registration with the uncertainty `length_std` (relative) of the finger's length.

    The fit's prior is of scale and length together; the change of the scale is shared by variance.
    """
    share = scale_std**2 / (scale_std**2 + length_std**2)
    pose = registration.pose
    factor = (pose.pixel / registration.stated.pixel) ** (share - 1)
    pose = replace(pose, scale_mm_per_px=factor * pose.scale_mm_per_px)
    turn = np.diag([1.0, 1.0, 1.0, share])
    covariance = turn @ registration.covariance @ turn
    covariance[3, 3] += share * length_std**2
    return replace(registration, pose=pose, covariance=covariance)


def stated_registration(dpiv: Dpiv, kinematics: Kinematics) -> Registration:
    """The registration of vectors as stated; the picture's unit is the stated metre."""
    axes, start = dpiv.axes, dpiv.start
    assert isinstance(start, Start)
    assert axes.root_mm
    assert axes.root_std_mm
    x, y = np.array(axes.root_mm) * 1e-3
    at = float(-x if axes.x == "left" else x), float(y)
    root_std, turn_std = axes.root_std_mm * 1e-3, float(np.radians(axes.turn_std_deg))
    covariance = np.diag([root_std, root_std, turn_std, dpiv.scale.std_percent / 100]) ** 2
    pose = Pose(1e3, float(np.radians(axes.turn_deg)), kinematics.root, at)
    law = Law(np.array([1.0, -start.at_s, 1.0]), np.diag([0.0, start.std_s**2, 0.0]), 0.0)
    none = np.empty(0)
    return Registration(pose, covariance, 0.0, law, none, none, none, pose)
