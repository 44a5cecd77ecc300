"""Final bend angle and duration of the stroke, simulated and recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.inputs_toml import Input, Numerics
from postprocess.lab.judgement.case import Case, Effect
from postprocess.lab.judgement.validation import POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.registration.register import law_pressure

PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts


def _motion_values(case: Case) -> tuple[tuple[float, float], tuple[float, float]]:
    """(simulation, recording) of the final bend angle (rad) and of the stroke's duration (s)."""
    factor, _, stretch = case.registration.law.values
    length = stroke_duration(case.kinematics)
    bend = final_bend(case.kinematics, 1.0), final_bend(case.kinematics, factor)
    return bend, (length, length * float(stretch))


def final_bend(kinematics: Kinematics, factor: float) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def effect_of(of: Input | Numerics, nominal: Kinematics, run: Kinematics) -> Effect:
    """What a run changes of the motion: factor and stretch of its law against the nominal one."""
    times = np.linspace(*nominal.time, 201)
    wanted, scale = run.law(times), nominal.high - nominal.low
    fit = least_squares(
        lambda values: (law_pressure(nominal, times, values) - wanted) / scale,
        (1.0, 0.0, 1.0),
        x_scale=(0.01, 0.001, 0.01),
    )
    factor, _, stretch = (float(value) for value in fit.x)
    bend = final_bend(nominal, factor) - final_bend(nominal, 1.0)
    return Effect(of, bend, stroke_duration(nominal) * (stretch - 1))


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, 801)
    bend = kinematics.bend(kinematics.law(times))
    done = np.maximum.accumulate(np.abs(bend - bend[0])) / np.abs(bend - bend[0]).max()
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def at_recorded_motion(case: Case) -> Case:
    """The case with the recording's bend and duration in changes of the runs of pressure and time.

    As it is where the motion was not seen, or those runs were not made.
    """
    named = {e.of.name: e for e in case.effects}
    if case.registration.times.size == 0 or not {"pressure", "duration"} <= set(named):
        return case
    values, stds = _motion_values(case), _motion_stds(case)
    for name, (simulated, seen), std in zip(("pressure", "duration"), values, stds, strict=True):
        own = named[name].bend if name == "pressure" else named[name].duration
        share, unlike = (seen - simulated) / own, abs(seen - simulated - own) / abs(simulated)
        named[name] = replace(named[name], share=share, share_std=std / abs(own), unlike=unlike)
    return replace(case, effects=list(named.values()))


def _motion_stds(case: Case) -> tuple[float, float]:
    """Standard uncertainties of the recording's final bend (rad) and duration (s)."""
    law = case.registration.law
    factor = float(law.values[0])
    ahead, here = (final_bend(case.kinematics, factor + step) for step in (0.01, 0.0))
    bend = abs(ahead - here) / 0.01 * law.std("factor")
    return bend, stroke_duration(case.kinematics) * law.std("stretch")


def motion_quantities(case: Case) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke, simulated and recorded."""
    if case.registration.times.size == 0:
        return []
    inputs = [e for e in case.effects if e.kind == "input"]
    names = (
        ("final_bend", "bend angle at the end", "rad", [e.bend for e in inputs]),
        ("duration", "duration of the stroke", "s", [e.duration for e in inputs]),
    )
    out = []
    for (name, label, unit, moved), values, std in zip(
        names, _motion_values(case), _motion_stds(case), strict=True
    ):
        sources = [Source("silhouette", "data", np.array([std]), POSTERIOR)]
        for e, change in zip(inputs, moved, strict=True):
            part = np.array([abs(change) * e.of.per_change])
            sources.append(Source(e.of.name, "input", part, e.how))
        if case.bend_std and name == "final_bend":
            band = np.array([case.bend_std])
            sources.append(Source("geometry and material", "input", band, "FEA's band"))
        s, d = (np.array([v]) for v in values)
        out.append(ValidatedQuantity(name, label, unit, s, d, abs(values[1]), sources))
    return out
