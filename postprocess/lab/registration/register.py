"""Where the laboratory's finger is in its pictures and when it moves, against the simulation's: pose, time, motion.

Space: one pose for all frames, with the stated scale as a prior. Time: the law of the simulation,
start + a (p((t - delay)/d) - start); a and d say how far and how fast the recording's finger moves beside the simulation's.
Both are fitted together to all silhouettes (`fit_outline`), first roughly, each frame loosely bound to the law; then with
the frames as far off it as the first fit found them. What each frame shows by itself is found last, at the pose so found.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares

from fileio.formats.kinematics import Kinematics, counter_clockwise
from piv.images.masks import dark_body
from piv.images.recording import Recording
from postprocess.lab.data.files import Law, Nuisance, Registration
from postprocess.lab.data.pictures import thinned
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.blind import blind_parts, seen_profile
from postprocess.lab.registration.check_stated import (
    CLEARLY,
    GROWN_PX,
    STRETCHED,
    best_delay,
    stated_wrongly,
)
from postprocess.lab.registration.fit_outline import (
    ROUGH_NUISANCE_STD,
    Frames,
    OutlineFit,
    fit_outline,
    outline_table,
    prepare,
    single_pressures,
)
from postprocess.lab.registration.outline_profile import independent_share, seen_outlines
from postprocess.lab.registration.silhouette import ROUGH_PX, WaterLikelihood, inside_sum, learn

MAX_FRAMES = 60
LEARN_FROM = 4
REST = 0.003  # of the range of pressure: nearer to its start the finger is at rest
REST_STD = 0.002  # of the range: how well the shape at rest is that of the simulation, at most
# of the range: how far a frame may be off the law where it is fitted by itself, in the rough fit; at least, in the final one
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad: how well a laboratory states its camera, where it does not say
ROOT_STD, TURN_STD, SCALE_STD = 1.5e-3, np.radians(1.5), 0.02
FINER = 4.0  # that over what the rough fit leaves
ROUNDS = 6  # of the final fit, at most
ROUGH_POINTS = 3  # of the outline's points the rough fit uses one
# m from the root, away from the tip: where water must be seen, by the fitted and by the stated pose
BEYOND, BEYOND_STATED = (0.001, 0.003), (0.003, 0.005)
SHADE_ROUNDS = 2  # of the rough fit, in which the shaded side is found from the lit one
SWEEPS = (15, 20, 25, 60)


def law_pressure(kinematics: Kinematics, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The simulation's law, stretched: pressures (Pa) at times of the recording's clock."""
    factor, delay, stretch = values
    start = float(kinematics.law(kinematics.time[0]))
    at = np.clip((np.asarray(times) - delay) / stretch, *kinematics.time)
    return start + factor * (kinematics.law(at) - start)


def fit_law(
    kinematics: Kinematics, times: np.ndarray, pressures: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Least-squares (factor, delay, stretch), their covariance from the residuals, and the rms residual (Pa)."""
    noise = 0.005 * (kinematics.high - kinematics.low)
    fit = least_squares(
        lambda z: (law_pressure(kinematics, times, z) - pressures) / noise,
        first,
        x_scale=(0.01, 0.001, 0.01),
        bounds=([0.2, -1.0, 0.2], [3.0, 1.0, 5.0]),
        loss="soft_l1",
    )
    rest = (law_pressure(kinematics, times, fit.x) - pressures) / noise
    scatter = np.sum(rest**2) / max(rest.size - 3, 1)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * scatter
    return fit.x, covariance, float(noise * np.sqrt(np.mean(rest**2)))


def first_pose(recording: Recording, frames: list[np.ndarray], kinematics: Kinematics) -> Pose:
    """A rough pose from the finger's root and tip in the first frame, in which it is straight."""
    mask = dark_body(frames[0]).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    (cx, cy), size, angle = cv2.minAreaRect(max(contours, key=cv2.contourArea))
    length, along = (size[0], angle) if size[0] > size[1] else (size[1], angle + 90)
    direction = np.array([np.cos(np.radians(along)), -np.sin(np.radians(along))])  # picture, y up
    direction *= 1 if direction[1] < 0 else -1  # the finger hangs
    centre = np.array([cx, recording.shape[0] - 1 - cy])
    rest = kinematics.shape("tip", float(kinematics.law(kinematics.time[0]))) - kinematics.root
    turn = np.arctan2(direction[1], direction[0]) - np.arctan2(rest[1], rest[0])
    root = centre - 0.5 * length * direction
    return Pose(
        kinematics.length / length, float(turn), kinematics.root, (float(root[0]), float(root[1]))
    )


def search_delay(
    frames: Frames,
    kinematics: Kinematics,
    pose: Pose,
    stated: float | None,
    stated_std: float = 0.0,
) -> float:
    """Delay (s) at which the simulation's motion fits the frames best: a correlation over time of the finger's picture."""
    span = frames.times[-1] - frames.times[0]
    reach, step = (span + 0.1, 0.006) if stated is None else (max(0.04, 3 * stated_std), 0.004)
    delays = np.arange(-reach, reach, step) + (stated or 0.0)
    return best_delay(frames, outline_table(kinematics), kinematics, pose, delays)[0]


def chosen_frames(recording: Recording, paired: bool) -> np.ndarray:
    """Indices of the frames that are fitted: the first of each pair where they are `paired`."""
    return thinned(np.arange(0, len(recording), 2 if paired else 1), MAX_FRAMES)


def register(
    recording: Recording,
    times: np.ndarray,
    kinematics: Kinematics,
    stated: Pose | None,
    stated_delay: tuple[float, float] | None,
    *,
    scale_std: float | None,
    paired: bool = False,
    hidden: float = 0.0,
    light_from: float | None = None,
    length_std: float = 0.0,
    sweeps: tuple[int, int, int, int] = SWEEPS,
    seed: int = 1,
) -> Registration:
    """Register a recording (frame times in s of its clock) to the simulation's finger.

    `stated`: the pose that the laboratory states, or None: from root and tip in the first frame. `stated_delay`: likewise the
    clock's, with its standard uncertainty (s); None: from the motion alone. `paired`: frames 1-2, 3-4 … are taken close
    together, so only the first of each is used. `hidden`: length (m) of the finger that is hidden, from its root on. `light_from`:
    direction (rad from the picture's x axis) of light that comes from one side. `length_std`: standard uncertainty of the finger's
    length over it. `sweeps`: as of `fit_outline`, of the rough and of the final fit. ValueError where the root is not seen though `hidden` is 0.
    """
    chosen = chosen_frames(recording, paired)
    images = [recording.frame(int(i)) for i in chosen]
    evidence = learn(images[:: max(1, len(images) // LEARN_FROM)])
    pose = stated or first_pose(recording, images, kinematics)
    alike = kinematics, recording.shape, hidden
    blind = blind_parts(np.empty((len(images), 0, 2)), pose, *alike, None)
    frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
    if not hidden and stated:  # without its root a fit may go anywhere
        check_root(frames, kinematics, stated, evidence, BEYOND_STATED)
    prior = (
        None if scale_std is None else (pose.scale_m_per_px, float(np.hypot(scale_std, length_std)))
    )
    wrong, shown = stated_wrongly(frames, kinematics, pose, scale_known=stated is not None)
    first = np.array([1.0, search_delay(frames, kinematics, pose, *(stated_delay or (None,))), 1.0])
    span = kinematics.high - kinematics.low
    known: dict[str, Any] = {"scale": prior, "stated_delay": stated_delay}
    first_std = np.array(
        [ROOT_STD / pose.scale_m_per_px] * 2 + [TURN_STD, prior[1] if prior else SCALE_STD]
    )
    roughly = known | {
        "about": first_std,
        "nuisance_std": ROUGH_NUISANCE_STD,
        "deviation": np.full(frames.times.size, LOOSE * span),
    }
    roughly |= {"sweeps": sweeps[:2], "seed": seed, "every": ROUGH_POINTS}
    try:
        rough = fit_outline(frames, kinematics, pose, first, **roughly)
    except ValueError as error:
        raise ValueError(wrong or str(error)) from error
    at_stated_rate = 1 / STRETCHED < rough.law[:, 2].mean() < STRETCHED
    if wrong and not (
        at_stated_rate and CLEARLY * rough.evidence(frames, kinematics, GROWN_PX) > shown
    ):
        raise ValueError(wrong)
    for _ in range(SHADE_ROUNDS if light_from is not None else 0):
        blind = blind_parts(seen_outlines(kinematics, *rough.means()), pose, *alike, light_from)
        frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
        rough = fit_outline(frames, kinematics, pose, first, **roughly)
    begin, bent, taken_up = rough.means()
    values, _, _ = fit_law(kinematics, frames.times, bent, first)
    # particles that go along with the finger stay beside it: pictures are then less independent than they look
    profile, blind = seen_profile((images, evidence, kinematics, *rough.means()), blind)
    frames = prepare(images, times[chosen], evidence, blind)
    frames = replace(frames, independent=min(frames.independent, independent_share(profile)))
    tied = deviation_from_law(kinematics, rough, values)
    known |= {"nuisance": taken_up, "about": first_std / FINER}
    fine = fit_outline(
        frames,
        kinematics,
        begin,
        values,
        deviation=tied,
        seed=seed + 1,
        sweeps=sweeps[2:],
        rounds=ROUNDS,
        **known,
    )
    if not hidden:
        check_root(frames, kinematics, fine.mean_pose(), evidence, BEYOND)
    return with_length(_registration(frames, kinematics, fine, stated), scale_std, length_std)


def check_root(
    frames: Frames,
    kinematics: Kinematics,
    pose: Pose,
    evidence: WaterLikelihood,
    beyond: tuple[float, float],
) -> None:
    """ValueError where it is as dark `beyond` (m from, m to) the finger's root as in it: the root's edge is then not seen."""
    start = float(kinematics.law(kinematics.time[0]))
    along, dorsal = (
        kinematics.shape("tip_direction", start),
        kinematics.shape("dorsal_direction", start),
    )
    half = 0.3 * float(np.ptp((kinematics.shape("outline", start) - kinematics.root) @ dorsal))
    corners = [(-beyond[0], -half), (-beyond[0], half), (-beyond[1], half), (-beyond[1], -half)]
    patch = pose.to_px(np.array([kinematics.root + a * along + d * dorsal for a, d in corners]))
    dense = np.vstack(
        [
            np.linspace(a, b, 40, endpoint=False)
            for a, b in zip(patch, np.roll(patch, -1, 0), strict=True)
        ]
    )
    sums = [inside_sum(i, counter_clockwise(dense), frames.mean) for i in frames.integrals]
    area = (beyond[1] - beyond[0]) * 2 * half / pose.scale_m_per_px**2
    rows, columns = (n - 1 for n in frames.integrals.shape[1:])
    outside = (patch < 0).any() or (patch > [columns - 1, rows - 1]).any()
    if np.mean(sums) > 0.5 * evidence.rate * area or (outside and beyond == BEYOND):
        what = (
            "the picture ends"
            if outside
            else "there are no particles either, as in a holder or a shadow"
        )
        raise ValueError(
            f"beyond the finger's root {what}, so its edge is not seen; correct axes.root_px in dpiv.toml if it is wrong, else give"
            " root_hidden_mm, how much of the finger from its root on is not to be used, and a scale that does not come from the finger"
        )


def deviation_from_law(kinematics: Kinematics, rough: OutlineFit, values: np.ndarray) -> np.ndarray:
    """How far (Pa, standard deviation) each frame may be off the law: what the rough fit's scatter about it leaves beyond its own."""
    span, start = kinematics.high - kinematics.low, float(kinematics.law(kinematics.time[0]))
    predicted = law_pressure(kinematics, rough.times, values)
    off = np.mean((rough.parameter.mean(axis=0) - predicted) ** 2) - np.mean(
        rough.parameter.var(axis=0)
    )
    moving = max(np.sqrt(max(off, 0.0)), TIED * span)
    at_rest = np.abs(predicted - start) < REST * span
    return np.where(at_rest, min(moving, REST_STD * span), moving)


def with_length(
    registration: Registration, scale_std: float | None, length_std: float
) -> Registration:
    """A registration whose scale is that of the finger, for a finger whose length is known to `length_std` (relative) only.

    The fit's prior was that of stated scale and length together; what it moved the scale by is shared between them by variance.
    """
    share = 1.0
    variance = length_std**2
    if scale_std is not None and length_std > 0:
        assert registration.stated is not None  # a stated scale has a stated pose
        share = scale_std**2 / (scale_std**2 + length_std**2)
        variance = share * length_std**2
    stated = (registration.stated or registration.pose).scale_m_per_px
    scale = stated * (registration.pose.scale_m_per_px / stated) ** share
    turn = np.diag([1.0, 1.0, 1.0, share])
    covariance = turn @ registration.covariance @ turn
    covariance[3, 3] += variance
    return replace(
        registration, pose=replace(registration.pose, scale_m_per_px=scale), covariance=covariance
    )


def _registration(
    frames: Frames, kinematics: Kinematics, fine: OutlineFit, stated: Pose | None
) -> Registration:
    values = fine.law.mean(axis=0)
    law = law_pressure(kinematics, frames.times, values)
    seen, std = single_pressures(
        frames, kinematics, fine, law, FREE * (kinematics.high - kinematics.low)
    )
    return Registration(
        fine.mean_pose(),
        np.cov(fine.pose.T),
        Nuisance(fine.nuisance.mean(axis=0), fine.nuisance.std(axis=0)),
        Law(values, np.cov(fine.law.T), float(np.sqrt(np.mean((seen - law) ** 2)))),
        frames.times,
        seen,
        std,
        stated,
    )
