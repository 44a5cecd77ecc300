"""The water's share from coupled runs of the fitted scene, which confirm or correct the model's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from pipeline.formats.bending_states import write
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.runs.run import Run, open_run
from pipeline.structure.finger import ElasticFinger
from piv.formats.user_tables import read_history
from softfinger.make import Machine, make
from softfinger.twin.fit import Fit, FloatArray, Parameter, fit
from softfinger.twin.identify import Judged, best_start
from softfinger.twin.model import (
    DRAG,
    LOADS,
    LOSS,
    MASS,
    PRIORS,
    SMOOTHING,
    START,
    STIFF,
    Motion,
    Stroke,
    Twin,
    scaled,
    tip_of,
    write_log,
)

LEAST_STD = 0.05  # of the water's coefficients: the errors of a coarse grid
_NOISE_PX = 0.1  # no camera blurs it


def coupled(
    twin: Twin,
    folder: Path,
    level: str,
    stroke: Stroke,
    name: str,
    rubber: dict[str, float] | None = None,
    last: str = "solve",
) -> tuple[Run, Motion]:
    """The coupled run of the scene in `folder` under a stroke's pressure, in out/`name`.

    A log that begins before the film is followed from its beginning. `rubber`: parameters in place
    of those of the scene; `last`: stage up to which it is made. StageError.
    """
    out = folder / "out" / name
    t, p = read_history(stroke.pressure, "pressure", least=2)
    begin = min(float(t[0]), 0.0)
    log, states = (folder / "out" / f"{name}{end}" for end in (".csv", ".h5"))
    write_log(log, t - begin, p)
    step = twin.scene.numerics.time_step
    moved = {
        "motion.source": "structure", "motion.strokes": [],
        "motion.pressure_csv": str(log.resolve()), "motion.smoothing": SMOOTHING,
        "motion.end_time": step * int((t[-1] - begin) / step),
    }  # fmt: skip
    if rubber is not None:
        write(states, scaled(twin.states, rubber[STIFF], rubber[LOADS]))
        moved |= {"motion.states": str(states.resolve()), "structure.loss_factor": rubber[LOSS]}
    run = open_run(folder, level, moved, out)
    make(run, last, Machine())
    motion = read_elastic_motion(out / FILE)
    time, pressure, turned = (motion[key].values for key in ("time", "pressure", "delta"))
    outlines = twin.outlines(ElasticFinger.of(run.scene), pressure, turned)
    return run, (time + begin - 0.5 * SMOOTHING, outlines)  # as the averaged pressure lags


def water(twin: Twin, values: dict[str, float], stroke: Stroke, run: Motion) -> Fit:
    """Added mass and drag with which the chain moves as the coupled run of the same rubber did."""

    def residuals(tried: dict[str, float]) -> list[FloatArray]:
        time, outlines = twin.run(values | tried, stroke.pressure)
        own = (time >= run[0][0]) & (time <= run[0][-1])
        apart = outlines[own] - make_interp_spline(*run, k=1)(time[own])
        return [(apart / twin.pose.pixel).reshape(len(apart), -1)]

    # wide priors: the run tells them
    asked = [Parameter(name, 1.0, 3 * PRIORS[name], "", ratio=True) for name in (MASS, DRAG)]
    return fit(asked, residuals, _NOISE_PX)


def corrected(found: Fit) -> dict[str, tuple[float, float]]:
    """Priors of the water's coefficients by a coupled run: mean, relative standard deviation."""
    widths = found.std * [one.std for one in found.parameters]
    return {
        name: (value, max(float(width), LEAST_STD))
        for (name, value), width in zip(found.values().items(), widths, strict=True)
    }


def compared(twin: Twin, one: Judged, run: Motion) -> dict[str, float]:
    """RMS distances of a coupled run's tip from those of film and chain, of the length.

    From the film's with the start that suits the run best.
    """
    start = START.format(one.stroke.film.name)
    own = one.values | {start: best_start(twin, one.values, one.stroke, run)}
    seen = twin.seen_tips(own, one.stroke, run)
    off = {
        "film": tip_of(twin.at_pictures(own, one.stroke, run)) - seen,
        "chain": tip_of(twin.at_pictures(one.values, one.stroke, run)) - one.predicted,
    }
    rms = {name: float(np.sqrt(np.mean(np.sum(path**2, axis=1)))) for name, path in off.items()}
    return {name: value / twin.scene.finger.length for name, value in rms.items()}
