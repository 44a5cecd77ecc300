"""Final bend angle and duration of the stroke, simulated and recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.files import Registration
from postprocess.lab.judgement.case import Case
from postprocess.lab.judgement.validation import POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.registration.register import fit_law

PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts


def _motion_values(case: Case) -> tuple[tuple[float, float], tuple[float, float]]:
    """(simulation, recording) of the final bend angle (rad) and of the stroke's duration (s)."""
    factor, _, stretch = case.registration.law.values
    length = stroke_duration(case.kinematics)
    bend = final_bend(case.kinematics, 1.0), final_bend(case.kinematics, factor)
    return bend, (length, length * float(stretch))


def motion_sentence(registration: Registration) -> str:
    """The motion in the pictures relative to the simulation's, without the inputs' uncertainty."""
    law = registration.law
    clock = f"± {1960 * law.std('delay'):.1f} ms"
    if registration.times.size == 0:
        return f"vectors do not show the finger; the clock is stated to {clock}"
    parts = []
    for name, value, verb, unit in (
        ("factor", law.values[0], "bends as at", "the pressure"),
        ("stretch", law.values[2], "takes", "the time"),
    ):
        band = 1.96 * law.std(name)
        same = "as simulated" if abs(value - 1) < band else "otherwise than simulated"
        parts.append(f"{verb} {value:.3f} ± {band:.3f} times {unit} ({same})")
    ahead = f"its clock is {law.delay * 1e3:.1f} {clock} ahead (95 %)"
    return f"the finger {' and '.join(parts)}; {ahead}"


def final_bend(kinematics: Kinematics, factor: float) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def motion_of_run(nominal: Kinematics, run: Kinematics) -> tuple[float, float]:
    """Differences of a run's motion from the nominal one: final bend (rad), duration (s)."""
    times = np.linspace(*nominal.time, 201)
    values = fit_law(nominal, times, run.law(times), np.array([1.0, 0.0, 1.0]))
    bend = final_bend(nominal, float(values[0])) - final_bend(nominal, 1.0)
    return bend, stroke_duration(nominal) * (float(values[2]) - 1)


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
    named = {e.name: e for e in case.effects}
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
    names = (
        ("final_bend", "bend angle at the end", "rad"),
        ("duration", "duration of the stroke", "s"),
    )
    inputs = [e for e in case.effects if e.kind == "input"]
    changes = ([e.bend for e in inputs], [e.duration for e in inputs])
    out = []
    for name, values, std, change in zip(
        names, _motion_values(case), _motion_stds(case), changes, strict=True
    ):
        sources = [Source("silhouette", "data", np.array([std]), POSTERIOR)]
        for e, moved in zip(inputs, change, strict=True):
            sources.append(Source(e.name, "input", np.array([abs(moved) * e.per_std]), e.how))
        if case.geometry and name[0] == "final_bend":
            band = np.array([case.bend_std])
            sources.append(Source("geometry and material", "input", band, "FEA's band"))
        s, d = (np.array([v]) for v in values)
        out.append(ValidatedQuantity(*name, s, d, abs(values[1]), sources))
    return out
