"""Which stroke to record next: how much each of a few would narrow the rubber's bands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from piv.files.errors import StageError
from piv.formats.user_tables import read_history
from softfinger.twin.film import MOST_FRAMES, Film
from softfinger.twin.fit import BAND, Fit, FloatArray, Parameter
from softfinger.twin.model import (
    LOADS,
    LOSS,
    START,
    START_STD,
    STIFF,
    Stroke,
    Twin,
    outward,
    write_log,
)

FOLDER = "next"  # of the strokes' pressures, in the twin's folder
_STEP = 0.25  # of the parameters' standard deviations, of the slopes
_DECAY = 1.5  # s that a free decay is filmed for
_NAME = "next"


def candidates(pressure: Path) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Strokes by name, times (s) and pressures (Pa), that follow from a recorded one."""
    t, p = read_history(pressure, "pressure", least=2)
    t, p = t[t >= 0] - t[t >= 0][0], p[t >= 0]
    first, hold = p[0], t[-1] + np.array([0.01, _DECAY])
    return {
        "the same stroke once more": (t, p),
        "twice as fast": (np.append(0.5 * t, t[-1]), np.append(p, p[-1])),
        "1.3 times as deep": (t, first + 1.3 * (p - first)),
        "let go after the stroke": (np.append(t, hold), np.append(p, [first, first])),
        "held for longer": (np.append(t, hold[1]), np.append(p, p[-1])),
        "the opposite pressure": (t, first - 0.5 * (p - first)),
    }


def advised(twin: Twin, found: Fit, stroke: Stroke, folder: Path) -> list[dict[str, Any]]:
    """Strokes with the `half_widths` that the fit would have with them, best first.

    By the Jacobian of the outlines, with the noise and the independence that the fit has found;
    the camera stays where it is. First is what narrows the widest band most. The pressures are
    written into `folder`. Strokes that the bending states do not cover are left out.
    """
    rows, wet = [], [("in air", replace(twin, air=True))] if not twin.air else []
    for name, (t, p) in candidates(stroke.pressure).items():
        path = folder / f"{name.replace(' ', '_')}.csv"
        write_log(path, t, p)
        for where, filmed in [("", twin), *wet]:
            try:
                covariance = with_film(filmed, found, path, float(t[-1]))
            except StageError:
                continue  # a softer rubber than the states cover
            about = {"stroke": f"{name} {where}".strip(), "pressure": f"{FOLDER}/{path.name}"}
            rows.append(about | half_widths(found, covariance))
    return sorted(rows, key=lambda row: row[widest(found)])


def widest(found: Fit) -> str:
    """The property of the rubber with the widest band."""
    now = half_widths(found, found.covariance)
    return max(now, key=lambda name: now[name])


def advice(found: Fit, rows: list[dict[str, Any]]) -> str:
    """What to record next, in a sentence."""
    name = widest(found)
    now, then = half_widths(found, found.covariance)[name], rows[0][name]
    return (
        f"the widest band is that of the {name}, {_percent(now)}; record {rows[0]['stroke']}"
        f" ({rows[0]['pressure']}): {_percent(then)} are expected then"
    )


def _percent(half: float) -> str:
    return f"{100 * np.expm1(-half):+.0f} to {100 * np.expm1(half):+.0f} %"


def half_widths(found: Fit, covariance: FloatArray) -> dict[str, float]:
    """Half of the logarithmic band (95 %) of each property of the rubber."""
    return {
        one.name: BAND * one.std * float(covariance[k, k]) ** 0.5
        for k, one in enumerate(found.parameters)
        if one.name in (STIFF, LOADS, LOSS)
    }


def with_film(twin: Twin, found: Fit, pressure: Path, end: float) -> FloatArray:
    """The covariance of the fit's parameters with one more film, whose start is not known."""
    none = np.zeros((1, 1, 1))
    stroke = Stroke(Film(_NAME, np.linspace(0, end, MOST_FRAMES), none, none), pressure)
    more = replace(
        found,
        parameters=(*found.parameters, Parameter(START.format(_NAME), 0.0, START_STD)),
        z=np.append(found.z, 0.0),
        covariance=block_diag(found.covariance, 1.0),
    )
    outlines = twin.seen(more.values(), stroke)
    across, slopes = outward(outlines), []
    for step in np.diag(_STEP * more.std):
        moved = twin.seen(more.values(more.z + step), stroke) - outlines
        slopes.append(np.sum(moved * across, axis=-1).ravel() / step.sum())
    jacobian = np.stack(slopes, axis=-1)
    known = np.linalg.inv(more.covariance) + found.share / found.noise**2 * jacobian.T @ jacobian
    return np.linalg.inv(known)[:-1, :-1]
