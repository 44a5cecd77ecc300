"""The finger's motion, simulated and recorded, and what other runs change of it.

Bend and duration are quantities of the comparison; the flow is judged at the recording's motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from pipeline.formats.kinematics import SHAPE, Kinematics
from piv.files.errors import StageError
from postprocess.lab.fit_outline import law_pressure
from postprocess.lab.inputs_toml import Finer, Input
from postprocess.lab.level import EMPTY
from postprocess.lab.register import Registration
from postprocess.lab.validation import POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.virtual_experiment import Sides

QUANTITIES = (
    ("final_bend", "bend angle at the end", "rad"),
    ("duration", "duration of the stroke", "s"),
)
PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts
INSTANTS = 801  # at which the bend is looked at
BACK = 0.05  # of the largest bend, to the other side: beyond its shapes they go on straight
APART = 0.01  # of the largest bend: between two shapes of a coupled motion


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `bend` (rad) and `duration` (s): of the motion. `table`: change of `flow.COLUMNS` at each
    instant; None where the flow is not compared. `share` of the change by which the recording's
    motion differs, and its `share_std` by the registration; None where this is not known.
    """

    of: Input | Finer
    bend: float
    duration: float
    table: pd.DataFrame | None = None
    share: float | None = None
    share_std: float = 0.0

    def moves(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Mean change of `columns` over the instants `rows`, (component,)."""
        assert self.table is not None
        return self.table.loc[rows, list(columns)].mean().to_numpy(float)

    def std(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty of the mean of `columns` over the instants `rows`, (component,).

        By the change's RMS: where its sign changes, its mean is no small error.
        """
        assert self.table is not None
        change = self.table.loc[rows, list(columns)].to_numpy(float)
        return self.of.per_change * np.sqrt(np.mean(change**2, axis=0))


@dataclass(frozen=True)
class Comparison:
    """Motions of both sides, their flows (None: not compared), and the effects of the runs.

    `bend_std` (rad): of the FEA at the end of the stroke; 0: its bands do not count. `levels`: as
    of `level.level_windows`, and the `level` that is compared.
    """

    kinematics: Kinematics
    registration: Registration
    bend_std: float
    flow: Sides | None = None
    effects: list[Effect] = field(default_factory=list)
    levels: pd.DataFrame = field(default_factory=lambda: EMPTY)
    level: str = ""

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.of.kind == "numerical"]

    @property
    def of_motion(self) -> list[Effect]:
        """The runs that tell what the recording's own motion changes."""
        return [e for e in self.effects if e.share is not None]


def final_bend(kinematics: Kinematics, factor: float = 1.0) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def bend_done(kinematics: Kinematics, times: np.ndarray) -> np.ndarray:
    """Share of the simulation's largest change of bend that is done at times (n,) s."""

    def moved(at: np.ndarray) -> np.ndarray:
        bend = kinematics.bend(kinematics.law(np.append(kinematics.time[0], at)))
        return np.abs(bend[1:] - bend[0])

    whole = moved(np.linspace(*kinematics.time, INSTANTS))
    return np.asarray(moved(np.clip(times, *kinematics.time)) / whole.max())


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, INSTANTS)
    done = bend_done(kinematics, times)
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def over_bend(motion: Kinematics) -> Kinematics:
    """A motion whose shapes are known over time, as a coupled one's, with shapes over its bend.

    The parameter is the angle (rad) by which the finger has bent, the shapes are those of the way
    to the largest bend. StageError for a finger that bends to both sides.
    """
    bend, times = motion.data["shape_bend"].values, motion.law.x
    sign = np.sign(bend[np.argmax(np.abs(bend - bend[0]))] - bend[0])
    angle = (bend - bend[0]) * sign
    if angle.min() < -BACK * angle.max():
        raise StageError(
            "COUPLED=1 compares a finger that bends to one side, and this one bends to both; cut"
            " the scene's strokes and the recording"
        )
    way = [0]
    for k in range(angle.size):
        if angle[k] >= angle[way[-1]] + APART * angle.max():
            way.append(k)
    data = motion.data.isel({SHAPE: way}).assign_coords({SHAPE: angle[way]})
    splines = {
        name: CubicSpline(angle[way], of_time(of_time.x[way]))
        for name, of_time in motion.splines.items()
    }
    law = CubicSpline(times, (motion.bend(motion.law(times)) - bend[0]) * sign)
    return replace(motion, data=data, law=law, splines=splines)


def difference(nominal: Kinematics, other: Kinematics) -> tuple[float, float]:
    """By how much final bend (rad) and duration (s) of another motion exceed the nominal ones.

    Those of the nominal law, shifted and stretched, whose bend over time is nearest to the other's.
    """
    times = np.linspace(*nominal.time, 101)
    wanted = other.bend(other.law(np.clip(times, *other.time)))
    fit = least_squares(
        lambda values: nominal.bend(law_pressure(nominal, times, values)) - wanted,
        (1.0, 0.0, 1.0),
        x_scale=(0.01, 0.001, 0.01),
    )
    factor, _, stretch = (float(value) for value in fit.x)
    bend = final_bend(nominal, factor) - final_bend(nominal)
    return bend, stroke_duration(nominal) * (stretch - 1)


def _motions(case: Comparison) -> np.ndarray:
    """Final bend (rad) and duration (s): simulated, recorded, standard uncertainty; (2, 3)."""
    law, kinematics = case.registration.law, case.kinematics
    factor, _, stretch = law.values
    seen, lasts = final_bend(kinematics, factor), stroke_duration(kinematics)
    slope = abs(final_bend(kinematics, factor + 0.01) - seen) / 0.01
    return np.array(
        [
            [final_bend(kinematics), seen, slope * law.std("factor")],
            [lasts, lasts * stretch, lasts * law.std("stretch")],
        ]
    )


def at_recorded_motion(case: Comparison) -> Comparison:
    """The case with the recording's bend and duration in changes of the runs of pressure and time.

    The flow goes with the bend, and with the speed, the inverse of the duration. As it is where the
    motion was not seen, or those runs were not made.
    """
    named = {e.of.name: e for e in case.effects}
    if case.registration.times.size == 0 or not {"pressure", "duration"} <= set(named):
        return case
    (bend, bend_seen, bend_std), (lasts, lasts_seen, lasts_std) = _motions(case)
    slower = lasts / (lasts + named["duration"].duration) - 1
    for name, seen, std, change in (
        ("pressure", bend_seen - bend, bend_std, named["pressure"].bend),
        ("duration", lasts / lasts_seen - 1, lasts * lasts_std / lasts_seen**2, slower),
    ):
        named[name] = replace(named[name], share=seen / change, share_std=std / abs(change))
    return replace(case, effects=list(named.values()))


def motion_quantities(case: Comparison) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke; none where the recording does not show them."""
    if case.registration.times.size == 0:
        return []
    inputs, out = [e for e in case.effects if e.of.kind == "input"], []
    for (name, label, unit), (simulated, seen, std) in zip(QUANTITIES, _motions(case), strict=True):
        sources = [Source("silhouette", "data", np.array([std]), POSTERIOR)]
        for e in inputs:
            change = e.bend if name == "final_bend" else e.duration
            part = np.array([abs(change) * e.of.per_change])
            sources.append(Source(e.of.name, "input", part, e.of.how))
        if case.bend_std and name == "final_bend":
            band = np.array([case.bend_std])
            sources.append(Source("geometry and material", "input", band, "FEA's band"))
        both = np.array([simulated]), np.array([seen])
        out.append(ValidatedQuantity(name, label, unit, *both, abs(float(seen)), sources))
    return out
