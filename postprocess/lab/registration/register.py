"""Pose, clock and motion of the finger in a laboratory's pictures, relative to the simulation.

One pose for all frames, with the stated scale as a prior; the simulation's law as
start + a (p((t - delay)/d) - start). Both are fitted to all silhouettes (`fit_outline`): roughly,
each frame loosely bound to the law; then with the scatter about it that the first fit found.
What each frame shows by itself is found last, at that pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.data.files import Law, Registration
from postprocess.lab.data.pictures import thinned
from postprocess.lab.data.pose import Pose
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
    SIZE,
    fit_outline,
    pose_of,
    prepare,
    shapes_of,
    single_pressures,
    state_of,
)
from postprocess.lab.registration.outline_profile import (
    blind_parts,
    independent_share,
    outline_profile,
)
from postprocess.lab.registration.silhouette import ROUGH_PX, WaterLikelihood, learn

MAX_FRAMES, LEARN_FROM = 60, 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: largest deviation of the shape at rest from the simulation's
# deviation of a frame from the law, of the range: by itself, in the rough fit, least in the fit
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad: standard uncertainties of a stated camera, where none are stated
ROOT_STD, TURN_STD = 1.5e-3, np.radians(1.5)
GROWTH_STD = 1.5  # px, of the outline: blur and the mould's tolerance
OUTLINE_STD = 0.15  # px: no end of an outline is known better, whatever the particles say
LAW_STD = 0.3  # weak prior of factor and stretch about 1, for parts of the motion
FINER = 4.0  # ratio of those to what the rough fit leaves
ROUGH_POINTS, FINE_POINTS = 3, 2  # of the outline's points one is used
ROUGH, FINE = (6, 20), (6, 60)  # sweeps at each heat, and those that are kept
# spread of factor, delay (s) and stretch at the start
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])


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
        return thinned(np.arange(0, count, 2 if self.paired else 1), MAX_FRAMES)


def law_pressure(kinematics: Kinematics, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The simulation's law, stretched: pressures (Pa) at times of the recording's clock."""
    factor, delay, stretch = values
    start = float(kinematics.law(kinematics.time[0]))
    at = np.clip((np.asarray(times) - delay) / stretch, *kinematics.time)
    return start + factor * (kinematics.law(at) - start)


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
    frames = prepare(images, times, evidence, blind)
    # particles that go along with the finger make pictures less independent than they look
    frames = replace(frames, independent=min(frames.independent, independent_share(profile)))
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


def with_length(registration: Registration, scale_std: float, length_std: float) -> Registration:
    """A registration with the uncertainty `length_std` (relative) of the finger's length.

    The fit's prior is of scale and length together; the change of the scale is shared by variance.
    """
    share = scale_std**2 / (scale_std**2 + length_std**2)
    pose = registration.pose
    pose = pose.scaled((pose.pixel / registration.stated.pixel) ** (share - 1))
    turn = np.diag([1.0, 1.0, 1.0, share])
    covariance = turn @ registration.covariance @ turn
    covariance[3, 3] += share * length_std**2
    return replace(registration, pose=pose, covariance=covariance)
