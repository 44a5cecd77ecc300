"""Handedness, scale or frame rate that are stated clearly wrongly, named before the fit.

A fit begun there ends anywhere, and its complaint names the simulation. The stated values are
scored against alternatives; an alternative counts only where the fit is not as good as well.
"""

from __future__ import annotations

import numpy as np

from postprocess.lab.registration.fit_outline import DELAY, LAW, Frames, Shapes

RATES, SCALES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0), (0.5, 2.0)
CLEARLY = 1.3  # times the evidence of what is stated, from which an alternative is the truth
STRETCHED = 1.5  # duration, either way, up to which a fit is one of the stated rate
COARSE_S = 0.012  # s between delays that are tried
# growth of the outline (px): a smaller one tolerates a rough pose and reflections
GROWN_PX = -3.0


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
