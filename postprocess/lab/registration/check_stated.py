"""Handedness, scale or frame rate that are stated clearly wrongly, named before the fit.

A fit begun there ends anywhere, and its complaint names the simulation. The stated values are
scored against alternatives; an alternative counts only where the fit is not as good as well.
"""

from __future__ import annotations

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.fit_outline import Frames, outline_table
from postprocess.lab.registration.outline_sampler import all_scores

RATES, SCALES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0), (0.5, 2.0)
CLEARLY = 1.3  # times the evidence of what is stated, from which an alternative is the truth
STRETCHED = 1.5  # duration, either way, up to which a fit is one of the stated rate
COARSE_S = 0.012  # s between delays that are tried
# growth of the outline (px): a smaller one tolerates a rough pose and reflections
GROWN_PX = -3.0

Shapes = tuple[np.ndarray, np.ndarray, np.ndarray]  # of `outline_table`


def best_delay(
    frames: Frames,
    shapes: Shapes,
    kinematics: Kinematics,
    pose: Pose,
    delays: np.ndarray,
    stretch: float = 1.0,
    grown_px: float = -1.0,
) -> tuple[float, float]:
    """The delay (s) at which the simulation's motion fits the frames best, and its evidence.

    `grown_px`: growth of the outlines; smaller ones tolerate a rough pose.
    """
    table, outlines, normals = shapes
    pictures = frames.integrals, frames.mean, outlines, normals, np.asarray(pose.anchor)
    seat = (*pose.at_px, pose.angle, pose.pixel, grown_px, 0.0)
    scores = []
    for delay in delays:
        at = np.clip((frames.times - delay) / stretch, *kinematics.time)
        places = (kinematics.law(at) - table[0]) / (table[1] - table[0])
        scores.append(all_scores(*pictures, seat, places).sum())
    best = int(np.argmax(scores))
    return float(delays[best]), float(scores[best])


def _mirrored(shapes: Shapes, anchor: tuple[float, float]) -> Shapes:
    """The outlines of a finger that bends to the other side of the vertical through `anchor`."""
    table, outlines, normals = shapes
    flip = np.array([-1.0, 1.0, 1.0])
    turned = (outlines[:, ::-1] - anchor) * flip[:2] + anchor
    return table, np.ascontiguousarray(turned), np.ascontiguousarray(normals[:, ::-1] * flip)


def stated_wrongly(
    frames: Frames, kinematics: Kinematics, pose: Pose, *, scale_known: bool
) -> tuple[str, float]:
    """A sentence on the alternative that explains the frames clearly better, and its evidence.

    An empty sentence where there is none.
    """
    shapes = outline_table(kinematics)
    span = float(frames.times[-1] - frames.times[0])

    def score(stretch: float = 1.0, scale: float = 1.0, of: Shapes = shapes) -> float:
        reach = max(span, stretch * float(np.ptp(kinematics.time)))
        delays = np.arange(-reach, span, max(COARSE_S * stretch, reach / 80))
        seen = pose.scaled(scale)
        return best_delay(frames, of, kinematics, seen, delays, stretch, GROWN_PX)[1]

    others = {
        "the finger bends to the other side than the simulation's; the pictures are mirrored:"
        ' correct axes.x in dpiv.toml ("left" where it is "right")': score(
            of=_mirrored(shapes, kinematics.root)
        )
    }
    for factor in SCALES if scale_known else ():
        text = f"the finger is as long as if the scale were {factor:g} times the stated one"
        others[f"{text}; correct [scale] in dpiv.toml"] = score(scale=factor)
    for factor in RATES:
        text = f"the finger moves as if the pictures were taken {factor:g} times as fast as stated"
        text += "; correct frame_rate_hz in dpiv.toml (of pictures in pairs: the pairs per second),"
        others[f"{text} or motion.strokes of the scene"] = score(stretch=factor)
    best = max(others, key=lambda name: others[name])
    return (best, others[best]) if others[best] > CLEARLY * max(score(), 0.0) else ("", 0.0)
