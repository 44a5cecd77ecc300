"""Pose, clock and motion of the finger in a laboratory's pictures, relative to the simulation.

One pose for all frames, with the stated scale as a prior; the simulation's law as
start + a (p((t - delay)/d) - start). Both are fitted to all silhouettes (`fit_outline`): roughly,
each frame loosely bound to the law; then with the scatter about it that the first fit found.
What each frame shows by itself is found last, at that pose.
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
REST_STD = 0.002  # of the range: largest deviation of the shape at rest from the simulation's
# deviation of a frame from the law, of the range: by itself, in the rough fit, least in the fit
FREE, LOOSE, TIED = 0.05, 0.01, 0.001
# m, rad, 1: standard uncertainties of a stated camera, where none are stated
ROOT_STD, TURN_STD, SCALE_STD = 1.5e-3, np.radians(1.5), 0.02
FINER = 4.0  # ratio of those to what the rough fit leaves
ROUNDS = 6  # of the final fit, at most
ROUGH_POINTS = 3  # of the outline's points the rough fit uses one
# m beyond the root where water must be seen, by the fitted and by the stated pose
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
    """Least-squares (factor, delay, stretch), covariance, and RMS residual (Pa)."""
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


def _first_pose(recording: Recording, frames: list[np.ndarray], kinematics: Kinematics) -> Pose:
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
    scale, at = 1e3 * kinematics.length / length, (float(root[0]), float(root[1]))
    return Pose(scale, float(turn), kinematics.root, at)


def _search_delay(
    frames: Frames,
    kinematics: Kinematics,
    pose: Pose,
    stated: float | None,
    stated_std: float = 0.0,
) -> float:
    """Delay (s) at which the simulation's motion fits the frames best."""
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

    `stated`: pose, with the relative `scale_std`; None: from the first frame. `stated_delay`: of
    the clock (s), with its standard uncertainty; None: from the motion. `paired`: the first of each
    pair of frames is used. `hidden`: length (m) of the finger that is hidden from its root on.
    `light_from`: direction (rad) of light from one side. `length_std`: relative standard
    uncertainty of the finger's length. `sweeps`: of the rough and of the final fit. ValueError
    where the root is not seen though `hidden` is 0.
    """
    chosen = chosen_frames(recording, paired)
    images = [recording.frame(int(i)) for i in chosen]
    evidence = learn(images[:: max(1, len(images) // LEARN_FROM)])
    pose = stated or _first_pose(recording, images, kinematics)
    alike = kinematics, recording.shape, hidden
    blind = blind_parts(np.empty((len(images), 0, 2)), pose, *alike, None)
    frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
    if not hidden and stated:  # without its root a fit may go anywhere
        _check_root(frames, kinematics, stated, evidence, BEYOND_STATED)
    known: dict[str, Any] = {"stated_delay": stated_delay, "scale": None}
    pose_std = np.array([*[ROOT_STD / pose.pixel] * 2, TURN_STD, SCALE_STD])
    if scale_std is not None:
        pose_std[3] = float(np.hypot(scale_std, length_std))
        known["scale"] = pose.pixel, pose_std[3]
    wrong, shown = stated_wrongly(frames, kinematics, pose, scale_known=stated is not None)
    delay = _search_delay(frames, kinematics, pose, *(stated_delay or (None,)))
    first = np.array([1.0, delay, 1.0])
    span = kinematics.high - kinematics.low
    roughly = known | {
        "about": pose_std,
        "nuisance_std": ROUGH_NUISANCE_STD,
        "deviation": np.full(frames.times.size, LOOSE * span),
        "sweeps": sweeps[:2],
        "seed": seed,
        "every": ROUGH_POINTS,
    }
    try:
        rough = fit_outline(frames, kinematics, pose, first, **roughly)
    except ValueError as error:
        raise ValueError(wrong or str(error)) from error
    at_stated_rate = 1 / STRETCHED < rough.law[:, 2].mean() < STRETCHED
    as_good = CLEARLY * rough.evidence(frames, kinematics, GROWN_PX) > shown
    if wrong and not (at_stated_rate and as_good):
        raise ValueError(wrong)
    for _ in range(SHADE_ROUNDS if light_from is not None else 0):
        blind = blind_parts(seen_outlines(kinematics, *rough.means()), pose, *alike, light_from)
        frames = prepare(images, times[chosen], evidence, blind, ROUGH_PX)
        rough = fit_outline(frames, kinematics, pose, first, **roughly)
    begin, bent, nuisance = rough.means()
    values, _, _ = fit_law(kinematics, frames.times, bent, first)
    # particles that go along with the finger make pictures less independent than they look
    profile, blind = seen_profile((images, evidence, kinematics, *rough.means()), blind)
    frames = prepare(images, times[chosen], evidence, blind)
    frames = replace(frames, independent=min(frames.independent, independent_share(profile)))
    finely = known | {
        "about": pose_std / FINER,
        "nuisance": nuisance,
        "deviation": _deviation(kinematics, rough, values),
        "sweeps": sweeps[2:],
        "seed": seed + 1,
        "rounds": ROUNDS,
    }
    fine = fit_outline(frames, kinematics, begin, values, **finely)
    if not hidden:
        _check_root(frames, kinematics, fine.mean_pose(), evidence, BEYOND)
    return with_length(_registration(frames, kinematics, fine, stated), scale_std, length_std)


def _check_root(
    frames: Frames,
    kinematics: Kinematics,
    pose: Pose,
    evidence: WaterLikelihood,
    beyond: tuple[float, float],
) -> None:
    """ValueError where the edge of the root is not seen: it is dark `beyond` (m from, m to) it."""
    start = float(kinematics.law(kinematics.time[0]))
    along = kinematics.shape("tip_direction", start)
    dorsal = kinematics.shape("dorsal_direction", start)
    half = 0.3 * float(np.ptp((kinematics.shape("outline", start) - kinematics.root) @ dorsal))
    corners = [(-beyond[0], -half), (-beyond[0], half), (-beyond[1], half), (-beyond[1], -half)]
    patch = pose.to_px(np.array([kinematics.root + a * along + d * dorsal for a, d in corners]))
    dense = np.linspace(patch, np.roll(patch, -1, 0), 40, endpoint=False, axis=1).reshape(-1, 2)
    sums = [inside_sum(i, counter_clockwise(dense), frames.mean) for i in frames.integrals]
    area = (beyond[1] - beyond[0]) * 2 * half / pose.pixel**2
    rows, columns = (n - 1 for n in frames.integrals.shape[1:])
    outside = (patch < 0).any() or (patch > [columns - 1, rows - 1]).any()
    if np.mean(sums) > 0.5 * evidence.rate * area or (outside and beyond == BEYOND):
        dark = "there are no particles either, as in a holder or a shadow"
        raise ValueError(
            f"beyond the root {'the picture ends' if outside else dark}, so its edge is not seen;"
            " correct axes.root_px in dpiv.toml if it is wrong, else give root_hidden_mm, the part"
            " of the finger from its root on that is not to be used, and a scale that does not come"
            " from the finger"
        )


def _deviation(kinematics: Kinematics, rough: OutlineFit, values: np.ndarray) -> np.ndarray:
    """Standard deviation (Pa) of each frame from the law, by the scatter of the rough fit."""
    span, start = kinematics.high - kinematics.low, float(kinematics.law(kinematics.time[0]))
    predicted, found = law_pressure(kinematics, rough.times, values), rough.parameter
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
        assert registration.stated is not None  # a stated scale has a stated pose
        share = scale_std**2 / (scale_std**2 + length_std**2)
        variance = share * length_std**2
    pose = registration.pose
    pose = pose.scaled((pose.pixel / (registration.stated or pose).pixel) ** (share - 1))
    turn = np.diag([1.0, 1.0, 1.0, share])
    covariance = turn @ registration.covariance @ turn
    covariance[3, 3] += variance
    return replace(registration, pose=pose, covariance=covariance)


def _registration(
    frames: Frames, kinematics: Kinematics, fine: OutlineFit, stated: Pose | None
) -> Registration:
    values, free = fine.law.mean(axis=0), FREE * (kinematics.high - kinematics.low)
    expected = law_pressure(kinematics, frames.times, values)
    seen, std = single_pressures(frames, kinematics, fine, expected, free)
    nuisance = Nuisance(fine.nuisance.mean(axis=0), fine.nuisance.std(axis=0))
    misfit = float(np.sqrt(np.mean((seen - expected) ** 2)))
    law = Law(values, np.cov(fine.law.T), misfit)
    pose, covariance = fine.mean_pose(), np.cov(fine.pose.T)
    return Registration(pose, covariance, nuisance, law, frames.times, seen, std, stated)
