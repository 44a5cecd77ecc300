"""From films and pressures to a fit, its judgement on a held-out stroke, and what it predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from piv.files.errors import StageError
from softfinger.twin.fit import Fit, FloatArray, fit
from softfinger.twin.model import (
    CHAIN,
    DRAG,
    LOADS,
    LOSS,
    MASS,
    START,
    START_STD,
    STIFF,
    TILT_X,
    TILT_Y,
    Motion,
    Stroke,
    Twin,
    direction,
    tip_of,
)

CLOSE = 0.03  # of the length, of the tip's RMS: published twins reach 3 to 5 %
_NOISE_PX = 1.0  # a first guess
_EDGES = 3.0  # of an outline: both sides and the tip's end
_TRIED, _DRAWS = 81, 100
_BETTER = 0.98  # of the residuals: as good a fit is not another one
_WIDE = np.log(1.1)  # of a band: what is not known within 10 % is named
_SPEED = 0.01  # s over which the tip's speed is taken
# whose uncertainty makes that of the motion
GROUPS = {"rubber": (STIFF, LOADS), "damping": (LOSS,), "water": (MASS, DRAG)}


@dataclass(frozen=True)
class Judged:
    """A stroke beside its prediction; places of the tip (frame, 2) m in the tank.

    `low`, `high` (frame, 2): the predicted band (95 %); `error`: distances over the length;
    `motion`: by quantity its value, its band and the shares of GROUPS in it; `drawn`: runs that the
    bands are of.
    """

    stroke: Stroke
    values: dict[str, float]
    seen: FloatArray
    predicted: FloatArray
    low: FloatArray
    high: FloatArray
    error: FloatArray
    motion: list[dict[str, Any]]
    drawn: int

    def summary(self) -> dict[str, Any]:
        """RMS and largest distance of the tip, of the length, and its path over time."""
        rms = float(np.sqrt(np.mean(self.error**2)))
        paths = {"tip": self.predicted, "low": self.low, "high": self.high, "seen": self.seen}
        return {
            "tip_rms_of_length": rms,
            "tip_max_of_length": float(self.error.max()),
            "times": self.stroke.film.times.tolist(),
            **{name: path.round(6).tolist() for name, path in paths.items()},
            "motion": self.motion,
            "drawn": self.drawn,
        }


def identified(twin: Twin, strokes: list[Stroke], first: Fit | None = None) -> Fit:
    """The fit of the twin's parameters to films of different names and their pressures.

    `first`: one to begin from. A silhouette is about as wide from either side of a slant, so that
    a fit may end on the wrong one. The camera is fitted from each, then all from the better one.
    """
    asked = twin.parameters([stroke.film.name for stroke in strokes])
    start = None if first is None else first.z
    found = fit(asked, lambda v: twin.residuals(v, strokes), _NOISE_PX, _EDGES, start)
    of_camera = np.array([one.name not in CHAIN for one in asked])
    camera = [one for one in asked if one.name not in CHAIN]
    best, start = _BETTER * found.rms, None
    for signs in ((-1, 1), (1, -1), (-1, -1)):
        z = found.z.copy()
        for name, sign in zip((TILT_X, TILT_Y), signs, strict=True):
            z[[one.name for one in asked].index(name)] *= sign
        seen = fit(
            camera,
            lambda v: twin.residuals(found.values() | v, strokes),
            _NOISE_PX,
            _EDGES,
            z[of_camera],
        )
        if seen.rms < best:
            best, start = seen.rms, z
            start[of_camera] = seen.z
    if start is None:
        return found
    return fit(asked, lambda v: twin.residuals(v, strokes), _NOISE_PX, _EDGES, start)


def judged(twin: Twin, found: Fit, stroke: Stroke) -> Judged:
    """A stroke, fitted or not, beside what the twin predicts, with the band of the parameters.

    The start of a film that was not fitted is that which suits the prediction best.
    """
    start, values = START.format(stroke.film.name), found.values()
    if start not in values:
        values |= {start: best_start(twin, values, stroke)}
    predicted = tip_of(twin.at_pictures(values, stroke))
    seen = twin.seen_tips(values, stroke)
    drawn, paths, others = [], [], []
    for z in found.draws(_DRAWS):
        tried = values | found.values(z) | {start: values[start]}
        try:
            paths.append(tip_of(twin.at_pictures(tried, stroke)))
        except StageError:
            continue  # a softer rubber than the states cover
        others.append(list(quantities(twin, tried, stroke).values()))
        drawn.append(z - found.z)
    low, high = np.percentile(paths, [2.5, 97.5], axis=0)
    error = np.hypot(*(seen - predicted).T) / twin.scene.finger.length
    own = quantities(twin, values, stroke)
    columns = np.transpose(others)
    motion = [
        {"name": name, "value": own[name], "band": np.percentile(column, [2.5, 97.5]).tolist()}
        | shares(found, np.array(drawn), column)
        for name, column in zip(own, columns, strict=True)
    ]
    return Judged(stroke, values, seen, predicted, low, high, error, motion, len(drawn))


def best_start(
    twin: Twin, values: dict[str, float], stroke: Stroke, motion: Motion | None = None
) -> float:
    """The start (s) of a film on its pressure's clock that suits the model, or another motion."""
    start = START.format(stroke.film.name)

    def off(tried: float) -> float:
        placed = twin.at_pictures(values | {start: tried}, stroke, motion)
        return float(np.mean(stroke.film.at(twin.posed(values, placed)) ** 2))

    return float(min(START_STD * np.linspace(-3, 3, _TRIED), key=off))


def quantities(twin: Twin, values: dict[str, float], stroke: Stroke) -> dict[str, float]:
    """Of the stroke's motion: largest change of bend, its instant, and largest speed of the tip."""
    time, outlines = twin.run(values, stroke.pressure)
    out = direction(outlines) @ [1, 1j]
    turned = np.degrees(np.unwrap(np.angle(out / out[0])))
    peak = int(np.argmax(np.abs(turned)))
    step = max(round(_SPEED / (time[1] - time[0])), 1)
    tip = tip_of(outlines)
    speed = np.hypot(*(tip[step:] - tip[:-step]).T).max() / (step * (time[1] - time[0]))
    names = "largest change of bend, °", "its instant, s", "largest tip speed, m/s"
    return dict(zip(names, (float(turned[peak]), float(time[peak]), float(speed)), strict=True))


def shares(found: Fit, drawn: FloatArray, column: FloatArray) -> dict[str, float]:
    """Shares of GROUPS in the variance of a quantity (draw,), by a plane through the draws.

    What two groups have in common is halved between them; the rest is what is not linear.
    """
    off = column - column.mean()
    slopes = np.linalg.lstsq(drawn, off, rcond=None)[0]
    total = max(float(off @ off), 1e-30)
    names = [one.name for one in found.parameters]
    return {
        group: float(sum((slopes[k] * drawn[:, k]) @ off for k, n in enumerate(names) if n in of))
        / total
        for group, of in GROUPS.items()
    }


def warnings(found: Fit) -> list[str]:
    """What the films do not determine or not within 10 %, and what is at the edge of its prior."""
    out = []
    for row in found.table():
        (low, high), name = row["band"], row["name"]
        if name in (STIFF, LOADS, LOSS) and not row["told"]:
            out.append(
                f"the films do not determine the {name}: it stays near its prior,"
                f" {row['value']:.3g}"
            )
        elif name in (STIFF, LOADS, LOSS) and np.log(high / low) > 2 * _WIDE:
            out.append(f"the {name} is not known within 10 %: {low:.3g} to {high:.3g}")
        if row["at_edge"]:
            out.append(
                f"the {name} lies at the edge of what was expected, {row['value']:.3g}:"
                " check scale, root, pressure and geometry, and that the camera faces the finger"
            )
    return out


def record(
    found: Fit, fitted: list[Judged], held_out: Judged | None, more: dict[str, Any]
) -> dict[str, Any]:
    """What identify.json holds, with `more`."""
    return more | {
        "parameters": found.table(),
        "correlation": found.correlation.round(4).tolist(),
        "residual_px": found.rms,
        "noise_px": found.noise,
        "independent_share": found.share,
        "warnings": warnings(found),
        "fitted": {one.stroke.film.name: one.summary() for one in fitted},
        "held_out": held_out and {held_out.stroke.film.name: held_out.summary()},
    }
