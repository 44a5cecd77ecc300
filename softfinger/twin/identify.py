"""From films and pressures to a fit, its judgement on a held-out stroke, and what it predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softfinger.twin.fit import Fit, FloatArray, fit
from softfinger.twin.model import LOADS, LOSS, START, START_STD, STIFF, Stroke, Twin, tip_of

CLOSE = 0.03  # of the length, of the tip's RMS: published twins reach 3 to 5 %
_NOISE_PX = 1.0  # a first guess
_EDGES = 3.0  # of an outline: both sides and the tip's end
_TRIED, _DRAWS = 81, 200
_STEP = 0.25  # of the priors' standard deviation, of the slopes that carry the bands


@dataclass(frozen=True)
class Judged:
    """A stroke beside its prediction; places of the tip (frame, 2) m in the tank.

    `low`, `high` (frame, 2): the predicted band (95 %); `error`: distances over the length.
    """

    stroke: Stroke
    values: dict[str, float]
    seen: FloatArray
    predicted: FloatArray
    low: FloatArray
    high: FloatArray
    error: FloatArray

    def summary(self) -> dict[str, float]:
        """RMS and largest distance of the tip, of the length."""
        rms = float(np.sqrt(np.mean(self.error**2)))
        return {"tip_rms_of_length": rms, "tip_max_of_length": float(self.error.max())}


def identified(twin: Twin, strokes: list[Stroke]) -> Fit:
    """The fit of the twin's parameters to films of different names and their pressures."""
    names = [stroke.film.name for stroke in strokes]
    return fit(twin.parameters(names), lambda v: twin.residuals(v, strokes), _NOISE_PX, _EDGES)


def judged(twin: Twin, found: Fit, stroke: Stroke) -> Judged:
    """A stroke, fitted or not, beside what the twin predicts, with the band of the parameters.

    The start of a film that was not fitted is that which suits the prediction best.
    """
    start, values = START.format(stroke.film.name), found.values()
    if start not in values:
        tried = START_STD * np.linspace(-3, 3, _TRIED)
        off = [np.mean(twin.residuals(values | {start: s}, [stroke])[0] ** 2) for s in tried]
        values |= {start: float(tried[int(np.argmin(off))])}
    predicted = _tips(twin, values, stroke)
    seen = twin.pose_of(values).to_tank(twin.seen_tips(values, stroke))
    slopes = []
    for k in range(len(found.z)):
        step = _STEP * np.eye(len(found.z))[k]
        sides = [
            _tips(
                twin, values | found.values(found.z + side * step) | {start: values[start]}, stroke
            )
            for side in (-1, 1)
        ]
        slopes.append((sides[1] - sides[0]) / (2 * _STEP))
    drawn = found.draws(_DRAWS) - found.z
    paths = predicted + np.tensordot(drawn, np.array(slopes), 1)
    low, high = np.percentile(paths, [2.5, 97.5], axis=0)
    error = np.hypot(*(seen - predicted).T) / twin.scene.finger.length
    return Judged(stroke, values, seen, predicted, low, high, error)


def _tips(twin: Twin, values: dict[str, float], stroke: Stroke) -> FloatArray:
    """The predicted tip (frame, 2) m in the tank."""
    return tip_of(twin.at_pictures(values, stroke))


def warnings(found: Fit) -> list[str]:
    """Parameters that the films do not determine, and those at the edge of their priors."""
    out = []
    for row in found.table():
        if row["name"] in (STIFF, LOADS, LOSS) and not row["told"]:
            out.append(
                f"the films do not determine the {row['name']}: it stays near its prior,"
                f" {row['value']:.3g}"
            )
        if row["at_edge"]:
            out.append(
                f"the {row['name']} lies at the edge of what was expected, {row['value']:.3g}:"
                " check scale, root, pressure and geometry"
            )
    return out


def record(found: Fit, fitted: list[Judged], held_out: Judged | None) -> dict[str, Any]:
    """What identify.json holds."""
    return {
        "parameters": found.table(),
        "correlation": found.correlation.round(4).tolist(),
        "residual_px": found.rms,
        "noise_px": found.noise,
        "independent_share": found.share,
        "warnings": warnings(found),
        "fitted": {one.stroke.film.name: one.summary() for one in fitted},
        "held_out": held_out and {held_out.stroke.film.name: held_out.summary()},
    }
