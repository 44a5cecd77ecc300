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
from postprocess.lab.registration.blind import blind_parts, seen_profile
from postprocess.lab.registration.check_motion import check_motion
from postprocess.lab.registration.fit_outline import NUISANCE_STD
from postprocess.lab.registration.outline_profile import (
    EDGE,
    FAR,
    INSIDE,
    NAMES,
    NEAR,
    NEXT,
    ON_EDGE,
    SIDES,
    SURE,
    OutlineProfile,
    independent_share,
    seen_outlines,
)
from postprocess.lab.registration.register import LEARN_FROM, ROOT_STD, TURN_STD, chosen_frames
from postprocess.lab.registration.silhouette import learn

GROWN = 1.5  # px, of the outline at most: a sound fit is a little smaller than the finger
FAR_OFF = 3.0  # standard deviations from a stated or plausible value
# ratio to the water's own density: at least beside the outline, at most within it
MISSING, WITHIN = 0.8, 0.08
BAD_PICTURES = 0.2  # share of the pictures that may fit worse than that
SHADOW = "particles are missing beside it, as in a shadow"
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
    recording: Recording,
    times: np.ndarray,
    registration: Registration,
    kinematics: Kinematics,
    *,
    scale_std: float | None,
    turn_std: float | None = None,
    paired: bool = False,
    hidden: float = 0.0,
    light_from: float | None = None,
) -> FitCheck:
    """Check a registration against its pictures; arguments as of `register`, `turn_std` in rad."""
    chosen = chosen_frames(recording, paired)
    images = [recording.frame(int(i)) for i in chosen]
    evidence = learn(images[:: max(1, len(images) // LEARN_FROM)])
    seen = kinematics, registration.pose, registration.pressures, registration.nuisance.values
    drawn = np.empty((len(images), 0, 2)) if light_from is None else seen_outlines(*seen)
    blind = blind_parts(drawn, registration.pose, kinematics, recording.shape, hidden, light_from)
    profile, _ = seen_profile((images, evidence, *seen), blind)
    parts = _wrong_parts(profile)
    motion = check_motion(kinematics, registration, np.diff(times).max())
    refusals = check_priors(registration, scale_std, turn_std)
    refusals += motion
    if parts:
        refusals.append(_parts_sentence(parts))
    worst = _worst_picture(profile)
    if not parts and (share := float(np.mean(_bad_pictures(profile)))) > BAD_PICTURES:
        refusals.append(
            f"in {share:.0%} of the pictures, as the one at {registration.times[worst]:.3f} s,"
            " particles lie where the fitted finger is; take out pictures in which something else"
            " hides it"
        )
    shadow = SHADOW in parts.values() or registration.nuisance.values[0] > GROWN
    if shadow and light_from is None:
        refusals.append("if light comes from one side, state light_from_deg")
    wrong = np.isin(profile.part, list(parts))
    return FitCheck(refusals, images[worst], profile.outlines[worst], wrong)


def check_priors(
    registration: Registration, scale_std: float | None, turn_std: float | None
) -> list[str]:
    """Sentences on values that lie too far from what is stated or plausible."""
    out = []
    std = np.sqrt(np.diag(registration.covariance))
    pose, stated = registration.pose, registration.stated
    edge, lateral = registration.nuisance.values
    most = FAR_OFF * NUISANCE_STD
    if not -most[0] <= edge <= GROWN:
        change, limit = ("grown", GROWN) if edge > 0 else ("shrunk", most[0])
        out.append(
            f"the outline had to be {change} by {abs(edge):.1f} px on all sides, more than blur and"
            f" a mould's tolerance make of it ({limit:.1f} px): a shadow beside the finger, or a"
            " finger of another thickness"
        )
    if abs(lateral) > most[1]:
        side = "dorsal" if lateral > 0 else "ventral"
        out.append(
            f"the outline had to be moved by {abs(lateral):.1f} px to the finger's {side} side: a"
            " shadow or a reflection on one side; light it from two sides or blacken the finger"
        )
    if stated is not None:
        turn = float(np.degrees(pose.angle - stated.angle))
        if abs(turn) > np.degrees(FAR_OFF * np.hypot(turn_std or TURN_STD, std[2])):
            out.append(
                f"the finger hangs {turn:+.1f}° from how axes.turn_deg states it; correct it, or"
                " give axes.turn_std_deg if it is not known as well"
            )
        off = (np.asarray(pose.at_px) - stated.at_px) * pose.pixel
        if np.hypot(*off) > FAR_OFF * np.hypot(ROOT_STD, pose.pixel * std[:2].max()):
            place = f"({off[0] * 1e3:+.1f}, {off[1] * 1e3:+.1f}) mm"
            out.append(f"the root lies {place} from where axes.root_px states it; correct it")
        away = float(np.log(pose.pixel / stated.pixel))
        if scale_std is not None and abs(away) > FAR_OFF * np.hypot(scale_std, std[3]):
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
    sees = area[:, EDGE] > 0.3 * np.median(area[area[:, EDGE] > 0, EDGE])
    on_edge = float(np.median(count[sees, EDGE] / np.maximum(water[sees, EDGE], 1.0)))
    tests = (
        (INSIDE, 1, WITHIN, WITHIN, "particles lie within it"),
        (EDGE, 1, ON_EDGE, ON_EDGE, BRIGHT),
        (EDGE, -1, on_edge, 0.5 * on_edge, SHADOW),
        (NEAR, 1, 1.0, ON_EDGE, BRIGHT),
        (NEAR, -1, 1.0, MISSING, SHADOW),
        (NEXT, -1, 1.0, MISSING, SHADOW),
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


def _bad_pictures(profile: OutlineProfile) -> np.ndarray:
    """Pictures (frame,) with more particles within the outline than `WITHIN` allows."""
    allowed = WITHIN * profile.rate() * profile.area[..., INSIDE].sum(axis=1)
    too_many = profile.count[..., INSIDE].sum(axis=1) - allowed
    return too_many > FAR_OFF * np.sqrt(np.maximum(allowed, 1.0))


def _worst_picture(profile: OutlineProfile) -> int:
    """The picture that the outline fits worst: particles within it and missing beside it."""
    rate = profile.rate()
    within = profile.count[..., INSIDE].sum(axis=1)
    beside = profile.count[..., NEAR].sum(axis=1) - rate * profile.area[..., NEAR].sum(axis=1)
    return int(np.argmax(within - beside))


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
