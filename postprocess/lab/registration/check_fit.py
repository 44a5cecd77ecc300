"""Whether a registration explains the pictures, part by part, picture by picture, and plausibly.

The standard uncertainties of a fit hold for a silhouette that is the finger's. Where particles are
missing beside the outline or lie within it, the fit may be off by many of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fileio.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.data.files import Registration
from postprocess.lab.registration.check_motion import check_motion
from postprocess.lab.registration.fit_outline import shapes_of
from postprocess.lab.registration.outline_profile import (
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
from postprocess.lab.registration.register import GROWTH_STD, ROOT_STD, Known, learned

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
GREEN, RED = (103, 194, 39), (66, 60, 235)  # BGR


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


def draw_fit(check: FitCheck) -> bytes:
    """PNG of the picture with the outline on it, the part that does not fit in red."""
    grey = check.picture.astype(np.float32)
    grey *= 255 / max(float(np.percentile(grey, 99.5)), 1.0)
    grey = np.clip(grey, 0, 255).astype(np.uint8)
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    corners = np.column_stack([check.outline[:, 0], grey.shape[0] - 1 - check.outline[:, 1]])
    corners = np.round(corners * 16).astype(np.int32)
    for k, wrong in enumerate(check.wrong):
        ends = tuple(corners[k].tolist()), tuple(corners[(k + 1) % len(corners)].tolist())
        cv2.line(picture, *ends, RED if wrong else GREEN, 3 if wrong else 1, cv2.LINE_AA, 4)
    return bytes(cv2.imencode(".png", picture)[1])
