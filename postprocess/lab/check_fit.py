"""Whether a registration explains the pictures, part by part, picture by picture, and plausibly.

The standard uncertainties of a fit hold for a silhouette that is the finger's. Where particles are
missing beside the outline or lie within it, the fit may be off by many of them. Nor do they hold
where the law of motion does not explain single pictures.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.fit_outline import law_pressure, shapes_of
from postprocess.lab.outline_profile import (
    EDGE,
    FAR,
    INSIDE,
    NAMES,
    NEAR,
    SIDES,
    OutlineProfile,
    blind_parts,
    independent_share,
    outline_profile,
)
from postprocess.lab.register import (
    GROWTH_STD,
    ROOT_STD,
    Known,
    Registration,
    learned,
)

GROWN = 1.5  # px, of the outline at most: a sound fit is a little smaller than the finger
FAR_OFF = 3.0  # standard deviations from a stated or plausible value
SURE = 4.5  # standard deviations of a count: parts and bands make sixty of them
# Ratios to the water's own density: beside the outline at least (seeding is uneven there, but what
# is denser bounds the outline as well), and within it at most; on the edge, to that beside it.
MISSING, WITHIN, ON_EDGE = 0.35, 0.08, 1.25
BAD_PICTURES = 0.2  # share of the pictures that may fit worse than that
SHADOW = "particles are missing beside it, as in a shadow"
UNLIKE = "fewer particles lie on its edge than beside it, as by a shadow or a reflection"
BRIGHT = "it is brighter than the water, as by a reflection"
GREEN, RED, ORANGE = np.array([[103, 194, 39], [66, 60, 235], [66, 140, 255]])  # BGR

LARGEST = 2.0  # factor by which pressure and duration may differ, either way
MISFIT = 0.04  # of the range of pressure: rms distance of single pictures from the law
JUMP = 6.0  # standard deviations of a jump: every instant is tried
ENDS = 4  # pictures before and behind a jump, at least
FEWEST = 2 * ENDS + 4  # pictures, for a jump to be looked for: six things are fitted
NOISE = 0.002  # of the range of pressure: what a single picture is not known better than


@dataclass(frozen=True)
class FitCheck:
    """Sentences on what does not fit (none: accepted), and a picture of it.

    A frame, its outline (point, 2) px with y up, and which of its points do not fit.
    """

    refusals: list[str]
    picture: np.ndarray
    outline: np.ndarray
    wrong: np.ndarray


def check_fit(
    recording: Recording, registration: Registration, kinematics: Kinematics, known: Known
) -> FitCheck:
    """Check a registration against its pictures and what is `known`."""
    chosen = known.chosen(len(recording))
    images = [recording.frame(int(i)) for i in chosen]
    pose, shapes = registration.pose, shapes_of(kinematics)
    evidence = learned(images, known, pose, kinematics.tip_width)
    seen = images, evidence, shapes, pose, registration.pressures, registration.growth
    profile = outline_profile(*seen)
    outlines, shape = profile.outlines, recording.shape
    blind = blind_parts(outlines, pose, kinematics, shape, known.hidden, known.light_from)
    if blind is not None:
        profile = outline_profile(*seen, blind)
    parts = _wrong_parts(profile)
    refusals = [_parts_sentence(parts)] if parts else []
    refusals += check_priors(registration, known)
    # of the recording, of which long ones are fitted in part: a dropped frame shifts by one of it
    interval = np.ptp(registration.times) / max(np.ptp(chosen), 1) * (2 if known.paired else 1)
    refusals += check_motion(kinematics, registration, float(interval))
    rate = profile.rate()
    within = profile.count[..., INSIDE].sum(axis=1)
    allowed = WITHIN * rate * profile.area[..., INSIDE].sum(axis=1)
    bad = within - allowed > FAR_OFF * np.sqrt(np.maximum(allowed, 1.0))
    missing = rate * profile.area[..., NEAR].sum(axis=1) - profile.count[..., NEAR].sum(axis=1)
    worst = int(np.argmax(within + missing))
    if not parts and bad.mean() > BAD_PICTURES:
        refusals.append(
            f"in {bad.mean():.0%} of the pictures, as the one at {registration.times[worst]:.3f} s,"
            " particles lie where the fitted finger is; take out pictures in which something else"
            " hides it"
        )
    shadow = {SHADOW, UNLIKE} & set(parts.values()) or registration.growth > GROWN
    if shadow and known.light_from is None:
        refusals.append("if light comes from one side, state light_from_deg")
    wrong = np.isin(profile.part, list(parts))
    return FitCheck(refusals, images[worst], profile.outlines[worst], wrong)


def check_priors(registration: Registration, known: Known) -> list[str]:
    """Sentences on values that lie too far from what is stated or plausible."""
    out = []
    std = np.sqrt(np.diag(registration.covariance))
    pose, stated = registration.pose, registration.stated
    growth, most = registration.growth, FAR_OFF * GROWTH_STD
    if not -most <= growth <= GROWN:
        change, limit = ("grown", GROWN) if growth > 0 else ("shrunk", most)
        out.append(
            f"the outline had to be {change} by {abs(growth):.1f} px on all sides, more than blur"
            f" and a mould's tolerance make of it ({limit:.1f} px): a shadow beside the finger, or"
            " a finger of another thickness"
        )
    turn = float(np.degrees(pose.angle - stated.angle))
    if abs(turn) > np.degrees(FAR_OFF * np.hypot(known.turn_std, std[2])):
        out.append(
            f"the finger hangs {turn:+.1f}° from how axes.turn_deg states it; correct it, or"
            " give axes.turn_std_deg if it is not known as well"
        )
    off = (np.asarray(pose.at_px) - stated.at_px) * pose.pixel
    if np.hypot(*off) > FAR_OFF * np.hypot(ROOT_STD, pose.pixel * std[:2].max()):
        place = f"({off[0] * 1e3:+.1f}, {off[1] * 1e3:+.1f}) mm"
        out.append(f"the root lies {place} from where axes.root_px states it; correct it")
    away = float(np.log(pose.pixel / stated.pixel))
    scale_std = np.hypot(known.scale_std, known.length_std)
    if abs(away) > FAR_OFF * scale_std:
        out.append(
            f"the scale that the finger's length shows is {100 * away:+.1f} % off the stated"
            f" one, which is known to {100 * scale_std:.2g} %; correct the scale, its"
            " std_percent, or finger_length_std_mm"
        )
    return out


def _wrong_parts(profile: OutlineProfile) -> dict[int, str]:
    """Parts of the outline, by their place in `NAMES`, that the pictures contradict, and how.

    Whole sides are tested as well, for what is too little in one part. Counts of pictures that
    share particles are weighed by `independent_share`.
    """
    share = independent_share(profile)
    count, area = profile.count.sum(axis=0), profile.area.sum(axis=0)
    whole = profile.rate()
    # the water's own rate beside each part, since light is uneven; beyond the root may be a wall
    enough = area[:, FAR] > 0.3 * np.median(area[:, FAR])
    own = np.where(enough, count[:, FAR] / np.maximum(area[:, FAR], 1), whole)
    own[0] = whole
    water = np.maximum(own, 0.5 * whole)[:, None] * area
    beside = np.maximum(
        count[:, NEAR] / np.maximum(area[:, NEAR], 1), water[:, NEAR] / area[:, NEAR].clip(1)
    )
    water[:, EDGE] = beside * area[:, EDGE]
    sees = area[:, EDGE] > 0.3 * np.median(area[area[:, EDGE] > 0, EDGE])
    on_edge = float(np.median(count[sees, EDGE] / np.maximum(water[sees, EDGE], 1.0)))
    tests = (
        (INSIDE, 1, WITHIN, WITHIN, "particles lie within it"),
        (EDGE, 1, ON_EDGE, ON_EDGE, BRIGHT),
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


def _parts_sentence(parts: dict[int, str]) -> str:
    """Where the outline does not fit, in words."""
    places: dict[str, list[str]] = {}
    for part, what in parts.items():
        names = places.setdefault(what, [])
        if NAMES[part] not in names:
            names.append(NAMES[part])
    where = "; ".join(f"at its {' and '.join(names)} {what}" for what, names in places.items())
    return (
        f"the finger's outline does not explain the pictures: {where}; light the finger so that"
        " water is seen all around it, or give root_hidden_mm where its root is not"
    )


_WATER = (
    "or water or another stiffness changes the motion, for which there are COUPLED=1 and"
    " structure.bending_stiffness"
)


def check_motion(kinematics: Kinematics, registration: Registration, interval: float) -> list[str]:
    """Sentences on what the law does not explain; `interval` (s): between successive pictures."""
    factor, _, stretch = registration.law.values
    span = kinematics.high - kinematics.low
    if not 1 / LARGEST < stretch < LARGEST:
        return [
            f"the stroke of the pictures takes {stretch:.2g} times the simulation's; correct"
            " frame_rate_hz (of pictures in pairs: the pairs per second), or motion.strokes of the"
            " scene"
        ]
    if not 1 / LARGEST < factor < LARGEST:
        return [
            f"the finger of the pictures bends as at {factor:.2g} times the simulation's pressure;"
            " correct motion.strokes of the scene"
        ]
    at, jump, std = _largest_jump(kinematics, registration)
    if abs(jump) > max(JUMP * std, 0.7 * interval):
        where, why = "ahead of", "pictures are missing there"
        if jump > 0:
            where, why = "behind", "a picture is there twice, or the finger halted"
        return [
            f"from {at:.3f} s of the recording on the finger is {abs(jump) * 1e3:.0f} ms {where}"
            f" its motion before: {why} (dropped frames), so give the part before or behind it as a"
            f" recording of its own; {_WATER}"
        ]
    if registration.law.misfit > MISFIT * span:
        off = abs(kinematics.splines["bend"](kinematics.high, 1)) * registration.law.misfit
        return [
            f"single pictures lie {np.degrees(off):.1f}° (rms) off the simulation's law of motion,"
            " however it is stretched; check frame_rate_hz, missing pictures, and motion.strokes of"
            f" the scene; {_WATER}"
        ]
    return []


def _largest_jump(kinematics: Kinematics, registration: Registration) -> tuple[float, float, float]:
    """The most significant jump of the clock: when (s), its size and standard deviation (s).

    Least squares of the pictures' pressures by the law, a smooth lag, and a delay from one picture
    on. Negative: the motion is ahead of the clock.
    """
    times, values = registration.times, registration.law.values
    if times.size < FEWEST:
        return 0.0, 0.0, np.inf
    span = kinematics.high - kinematics.low
    noise = np.hypot(registration.pressures_std, NOISE * span)
    rest = (registration.pressures - law_pressure(kinematics, times, values)) / noise
    steps = np.array([1e-3, 2e-4, 1e-3])
    basis = np.empty((times.size, 6))
    for k, step in enumerate(steps):
        change = step * np.eye(3)[k]
        ahead, back = (law_pressure(kinematics, times, values + s * change) for s in (1, -1))
        basis[:, k] = (ahead - back) / (2 * step) / noise
    # a finger that lags smoothly, as one with hysteresis, has no jump
    for k, power in ((3, 2), (4, 3)):
        basis[:, k] = basis[:, 1] * np.linspace(-1, 1, times.size) ** power
    best = (0.0, 0.0, np.inf)
    for split in range(ENDS, times.size - ENDS):
        basis[:, 5] = np.where(np.arange(times.size) >= split, basis[:, 1], 0.0)
        fit = np.linalg.lstsq(basis, rest, rcond=None)[0]
        left = rest - basis @ fit
        scatter = max(float(np.sum(left**2)) / (times.size - 6), 0.3)
        inverse = np.linalg.pinv(basis.T @ basis)
        std = float(np.sqrt(scatter * inverse[5, 5]))
        if std > 0 and abs(fit[5]) / std > abs(best[1]) / best[2]:
            best = (float(times[split]), float(fit[5]), std)
    return best


def draw_fit(check: FitCheck) -> bytes:
    """PNG of the picture with the outline on it, the part that does not fit in red."""
    return outlined(check.picture, [(check.outline, np.where(check.wrong[:, None], RED, GREEN))])


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
