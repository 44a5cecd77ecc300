"""Why a registration does not explain its pictures: one list of causes, in order.

Scale, root, clock, camera moved, outline: the first that explains the pictures stands first. The
outline is tested at the scale, the root and each frame's bend that explain it best: where those
leave nothing to explain it is not named, and where they cannot, it stands alone.
The standard uncertainties of a fit hold for a silhouette that is the finger's. Where particles are
missing beside the outline or lie within it, the fit may be off by many of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.formats.kinematics import Kinematics
from postprocess.lab.fit_outline import DELAY, GROWTH, LAW, REACH, SCALE, law_pressure
from postprocess.lab.outline_profile import (
    EDGE,
    FAR,
    INSIDE,
    LENGTHS,
    NAMES,
    NEAR,
    SIDES,
    OutlineProfile,
    independent_share,
)
from postprocess.lab.register import GROWTH_STD, ROOT_STD, Fit, Known

GROWN = 1.5  # px, of the outline at most: a sound fit is a little smaller than the finger
FAR_OFF = 3.0  # standard deviations from a stated or plausible value
SURE = 4.5  # standard deviations of a count: parts and bands make sixty of them
# Ratios to the water's own density: beside the outline at least (seeding is uneven there, but what
# is denser bounds the outline as well), and within it at most.
MISSING, WITHIN = 0.35, 0.08
SHADOW = "particles are missing beside it, as in a shadow"
UNLIKE = "fewer particles lie on its edge than beside it, as by a shadow or a reflection"
GREEN, RED, ORANGE = np.array([[103, 194, 39], [66, 60, 235], [66, 140, 255]])  # BGR

EDGE_OF_SHAPES = 0.97  # of REACH: a fit that would go on stays below it
LARGEST = 1.8  # factor by which the duration may differ, either way
MISFIT = 0.04  # of the range of pressure: rms distance of single pictures from the law
JUMP = 6.0  # standard deviations of a jump: every instant is tried
MOVED = np.array([1.0, 1.0, 0.01])[:, None]  # px, px, rad: least jump of the camera
SHARP = 0.6  # of a camera's jump: the least part of it between the two pictures beside it
ENDS = 4  # pictures before and behind a jump, at least
FEWEST = 2 * ENDS + 4  # pictures, for a jump to be looked for: six things are fitted
NOISE = 0.002  # of the range of pressure: what a single picture is not known better than


@dataclass(frozen=True)
class FitCheck:
    """Sentences on what does not fit (none: accepted), and a picture of it.

    A frame, its outline (point, 2) px with y up, which of its points do not fit, and the finger's
    where dpiv.toml states it.
    """

    refusals: list[str]
    picture: np.ndarray
    outline: np.ndarray
    wrong: np.ndarray
    stated: np.ndarray


def check_fit(fit: Fit, kinematics: Kinematics, known: Known) -> FitCheck:
    """Check a fit against its own pictures and what is `known`: the list of causes."""
    profile, motion = fit.profile, motion_causes(fit, kinematics, known)
    moved = any("the camera moved" in cause for cause in motion)  # so that no one pose fits
    # no outline fits a finger that bends beyond the shapes: the pictures before it tell
    seen = ~_beyond(fit.singles[0], kinematics)
    before = replace(profile, count=profile.count[seen], area=profile.area[seen])
    parts = {} if moved else _wrong_parts(before)
    # scale, root and clock of an outline that is not the finger's are its fault
    causes = motion if moved else outline_causes(fit, parts, known)
    causes = causes or [*stated_causes(fit, known), *motion]
    missing = profile.rate() * profile.area[..., NEAR] - profile.count[..., NEAR]
    worst = int(np.argmax((profile.count[..., INSIDE] + missing).sum(axis=1)))
    wrong = np.isin(profile.part, list(parts)) | (not moved and _unlike(fit))
    stated = known.pose.to_px(kinematics.shape("outline", fit.singles[0][worst]))
    return FitCheck(causes, fit.images[worst], profile.outlines[worst], wrong, stated)


def _beyond(pressures: np.ndarray, kinematics: Kinematics) -> np.ndarray:
    """Which of the pressures (n,) Pa lie where the table of shapes ends."""
    reach = EDGE_OF_SHAPES * REACH * (kinematics.high - kinematics.low)
    return (pressures > kinematics.high + reach) | (pressures < kinematics.low - reach)


def _off(fit: Fit, at: int, stated: float, std: float) -> tuple[float, bool]:
    """Difference of a value of the state from a stated one, and whether it is too far off."""
    off = float(fit.state[at] - stated)
    return off, abs(off) > FAR_OFF * float(np.hypot(std, np.sqrt(fit.covariance[at, at])))


def stated_causes(fit: Fit, known: Known) -> list[str]:
    """A scale, a root or a turn that is not the stated one."""
    out, pose = [], known.pose
    scale_std = float(np.hypot(known.scale_std, known.length_std))
    off, wrong = _off(fit, SCALE, -float(np.log(pose.pixel)), scale_std)
    if wrong:
        scale, std = 1e3 * np.exp(-fit.state[SCALE]), np.sqrt(fit.covariance[SCALE, SCALE])
        out.append(
            f"the scale is wrong: the finger in the pictures has {scale:.4g} mm/px ±"
            f" {100 * std:.1g} %, {100 * np.expm1(-off):+.1f} % off the stated one, which is known"
            f" to {100 * scale_std:.2g} %; correct scale.scale_mm_per_px ({scale:.4g} fits), its"
            " std_percent, or finger_length_std_mm"
        )
    px = np.sqrt(np.diag(fit.covariance)[:2])
    off = np.hypot(*(fit.state[:2] - pose.at_px)) * pose.pixel
    if off > FAR_OFF * np.hypot(ROOT_STD, pose.pixel * px.max()):
        (x, y), (x0, y0) = known.place(tuple(fit.state[:2])), known.place(pose.at_px)
        out.append(
            f"the root is wrong: in the pictures it lies {1e3 * off:.1f} mm from where axes.root_px"
            f" = [{x0:.0f}, {y0:.0f}] states it; write root_px = [{x:.0f}, {y:.0f}]"
        )
    turn, wrong = _off(fit, 2, pose.angle, known.turn_std)
    if wrong:
        out.append(
            f"the finger hangs {np.degrees(turn):+.1f}° from how axes.turn_deg states it; write"
            f" turn_deg = {np.degrees(fit.state[2]):.1f}, or a larger turn_std_deg"
        )
    return out


def motion_causes(fit: Fit, kinematics: Kinematics, known: Known) -> list[str]:
    """A clock or a camera that the motion contradicts: the one that explains most, or none."""
    stretch = fit.state[LAW.stop - 1]
    span = kinematics.high - kinematics.low
    if _beyond(fit.law, kinematics).any():
        return [
            f"the recording's finger bends further than the simulation's by more than {REACH:.0%};"
            " give the simulation the recording's pressure (motion.strokes in scene.toml), or"
            " compare the motion that water bends further (COUPLED=1)"
        ]
    if not 1 / LARGEST < stretch < LARGEST:
        return [
            f"the clock is wrong: the stroke of the pictures takes {stretch:.2g} times the"
            f" simulation's; correct frame_rate_hz to {stretch:.2g} times the stated one (of"
            " pictures in pairs: the pairs per second), or motion.strokes of the scene"
        ]
    if known.delay is not None:
        off, wrong = _off(fit, DELAY, *known.delay)
        if wrong:
            return [
                f"the clock is wrong: the finger moves {abs(1e3 * off):.0f} ms"
                f" {'later' if off > 0 else 'earlier'} than start.at_s states; correct it"
                f" (at_s = {-fit.state[DELAY]:.3f} fits), or its std_s"
            ]
    if jump := _jump(fit, kinematics):
        return [jump]
    misfit = float(np.sqrt(np.mean((fit.singles[0] - fit.law) ** 2)))
    if misfit > MISFIT * span:
        off = abs(kinematics.splines["bend"](kinematics.high, 1)) * misfit
        return [
            f"single pictures lie {np.degrees(off):.1f}° (rms) off the simulation's law of motion,"
            " however it is stretched; check frame_rate_hz, missing pictures, and motion.strokes of"
            " the scene, or compare the motion that water changes (COUPLED=1)"
        ]
    return []


def _jump(fit: Fit, kinematics: Kinematics) -> str:
    """A sentence on the most significant jump of clock or camera; empty where there is none.

    Least squares of what single pictures show by the fitted law, a smooth lag or drift, and a jump
    from one picture on.
    """
    times, values = fit.times, fit.state[LAW]
    if times.size < FEWEST:
        return ""
    span, lag = kinematics.high - kinematics.low, np.linspace(-1, 1, times.size)
    slopes = []
    for step in np.diag([1e-3, 2e-4, 1e-3]):
        ahead, back = (law_pressure(kinematics, times, values + s * step) for s in (1, -1))
        slopes.append((ahead - back) / (2 * step.max()))
    # a finger that lags smoothly, as one with hysteresis, has no jump
    law = np.stack([*slopes, slopes[1] * lag**2, slopes[1] * lag**3], axis=-1)
    noise = np.hypot(fit.singles_std[0], NOISE * span)
    sure, late = _steps(fit.singles[0] - fit.law, noise, law, slopes[1])
    clock = sure * (np.abs(late) > 0.7 * fit.interval)
    # where the outline does not explain the pictures, the pose goes with the finger's bend, over
    # several pictures; a camera jumps from one to the next, in x, y and angle together
    drift = np.column_stack([lag**0, lag, (fit.law - fit.law[0]) / span])
    pose = fit.singles[1:] / MOVED
    # single pictures scatter by a third of their standard uncertainties
    std = 0.5 * np.hypot(fit.singles_std[1:] / MOVED, 0.1)
    found = [_steps(p, s, drift, lag**0) for p, s in zip(pose, std, strict=True)]
    size = np.array([one[1] for one in found])
    far = (np.hypot(*size[:2]) > 1) | (np.abs(size[2]) > 1)
    sharp = np.sum(size * np.diff(pose, prepend=0), axis=0) > SHARP * np.sum(size**2, axis=0)
    camera = np.linalg.norm([one[0] for one in found], axis=0) * (far & sharp)
    most = camera if camera.max() > clock.max() else clock
    at = int(np.argmax(most))
    if most[at] <= JUMP:
        return ""
    when, part = f"from {times[at]:.3f} s of the recording on", "give the part before or behind it"
    if most is camera:
        where = "the finger lies elsewhere in the pictures"
        return f"the camera moved: {when} {where}; {part} as a recording of its own"
    where, why = "ahead of", "pictures are missing there"
    if late[at] > 0:
        where, why = "behind", "a picture is there twice, or the finger halted"
    return (
        f"the clock jumps: {when} the finger is {1e3 * abs(late[at]):.0f} ms {where} its motion"
        f" before: {why} (dropped frames); {part} as a recording of its own, or compare the motion"
        " that water changes (COUPLED=1)"
    )


def _steps(
    values: np.ndarray, noise: np.ndarray, smooth: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Significance and size of a step at each of the values (n,) beside `smooth` ones (n, m).

    `change`: of the values by a step of one; `noise`: standard deviation of each.
    """
    sure, size = np.zeros((2, values.size))
    for split in range(ENDS, values.size - ENDS):
        basis = np.column_stack([smooth, np.where(np.arange(values.size) >= split, change, 0.0)])
        basis = basis / noise[:, None]
        fit = np.linalg.lstsq(basis, values / noise, rcond=None)[0]
        left = values / noise - basis @ fit
        scatter = max(float(np.sum(left**2)) / (values.size - basis.shape[1]), 0.3)
        std = float(np.sqrt(scatter * np.linalg.pinv(basis.T @ basis)[-1, -1]))
        if std > 0:
            sure[split], size[split] = abs(fit[-1]) / std, fit[-1]
    return sure, size


def _unlike(fit: Fit) -> bool:
    """Whether the outline had to be grown or shrunk too much."""
    return not -FAR_OFF * GROWTH_STD <= fit.state[GROWTH] <= GROWN


def outline_causes(fit: Fit, parts: dict[int, str], known: Known) -> list[str]:
    """An outline that does not explain the pictures: its `parts`, or its growth."""
    growth, out = float(fit.state[GROWTH]), []
    if parts:
        places = {what: {NAMES[k]: 0 for k in parts if parts[k] == what} for what in parts.values()}
        where = "; ".join(f"at its {' and '.join(names)} {what}" for what, names in places.items())
        held = 0 in parts or {2, 2 + LENGTHS} <= set(parts)  # the root, or both sides next to it
        hidden = ", or give root_hidden_mm where its root is not" if held else ""
        out.append(
            f"the finger's outline does not explain the pictures: {where}; light the finger so that"
            f" water is seen all around it{hidden}"
        )
    if _unlike(fit):
        change, limit = ("grown", GROWN) if growth > 0 else ("shrunk", FAR_OFF * GROWTH_STD)
        out.append(
            f"the outline had to be {change} by {abs(growth):.1f} px on all sides, more than blur"
            f" and a mould's tolerance make of it ({limit:.1f} px): a shadow beside the finger, or"
            " a finger of another thickness"
        )
    shadow = {SHADOW, UNLIKE} & set(parts.values()) or growth > GROWN
    if shadow and known.light_from is None:
        out.append("if light comes from one side, state light_from_deg")
    return out


def _wrong_parts(profile: OutlineProfile) -> dict[int, str]:
    """Parts of the outline, by their place in `NAMES`, that the pictures contradict, and how.

    Whole sides are tested as well, for what is too little in one part. Counts of pictures that
    share particles are weighed by `independent_share`.
    """
    share, whole = independent_share(profile), profile.rate()
    count, area = profile.count.sum(axis=0), profile.area.sum(axis=0)
    density = count / area.clip(1)
    # the water's own rate beside each part, since light is uneven; beyond the root may be a wall
    enough = area[:, FAR] > 0.3 * np.median(area[:, FAR])
    own = np.where(enough, density[:, FAR], whole)
    own[0] = whole
    water = np.maximum(own, 0.5 * whole)[:, None] * area
    beside = np.maximum(density[:, NEAR], water[:, NEAR] / area[:, NEAR].clip(1))
    water[:, EDGE] = beside * area[:, EDGE]
    sees = area[:, EDGE] > 0.3 * np.median(area[area[:, EDGE] > 0, EDGE])
    on_edge = float(np.median(count[sees, EDGE] / np.maximum(water[sees, EDGE], 1.0)))
    tests = (
        (INSIDE, 1, WITHIN, WITHIN, "particles lie within it"),
        (EDGE, -1, on_edge, 0.5 * on_edge, UNLIKE),
        (NEAR, -1, 1.0, MISSING, SHADOW),
    )
    sides = [[k for k, name in enumerate(NAMES) if name.startswith(side)] for side in SIDES]
    found: dict[int, str] = {}
    for parts in [*([k] for k in range(len(NAMES))), *sides]:
        for band, sign, expected, limit, what in tests:
            seen, of_water = count[parts, band].sum(), water[parts, band].sum()
            noise = np.sqrt(max(expected * of_water, 1.0) / share)
            off = sign * (seen - expected * of_water) / noise
            if off > SURE and sign * (seen - limit * of_water) > 0:
                found |= {part: what for part in parts if part not in found}
    return found


def draw_fit(check: FitCheck) -> bytes:
    """PNG of the picture with the outline on it, what does not fit in red, the stated in orange."""
    colours = np.where(check.wrong[:, None], RED, GREEN)
    return outlined(check.picture, [(check.stated, ORANGE), (check.outline, colours)])


def outlined(picture: np.ndarray, outlines: list[tuple[np.ndarray, np.ndarray]]) -> bytes:
    """PNG of a picture with outlines (point, 2; px, y up) in the colours (point, BGR) of each."""
    grey = np.clip(picture * (255 / max(np.percentile(picture, 99.5), 1.0)), 0, 255)
    drawn = cv2.cvtColor(grey.astype(np.uint8), cv2.COLOR_GRAY2BGR)
    for outline, colours in outlines:
        corners = np.column_stack([outline[:, 0], len(picture) - 1 - outline[:, 1]])
        corners = np.round(corners * 16).astype(np.int32)
        for k, colour in enumerate(np.broadcast_to(colours, (len(corners), 3)).tolist()):
            ends = corners[k - 1].tolist(), corners[k].tolist()
            cv2.line(drawn, *ends, colour, 2, cv2.LINE_AA, 4)
    return bytes(cv2.imencode(".png", drawn)[1])
