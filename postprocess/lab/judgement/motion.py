"""Final bend angle and duration of the stroke, simulated and recorded."""

from __future__ import annotations

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.files import Registration
from postprocess.lab.judgement.case import Case, MotionPart
from postprocess.lab.judgement.validation import Source, ValidatedQuantity
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
    values, _, _ = fit_law(nominal, times, run.law(times), np.array([1.0, 0.0, 1.0]))
    bend = final_bend(nominal, float(values[0])) - final_bend(nominal, 1.0)
    return bend, stroke_duration(nominal) * (float(values[2]) - 1)


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, 801)
    bend = kinematics.bend(kinematics.law(times))
    done = np.maximum.accumulate(np.abs(bend - bend[0])) / np.abs(bend - bend[0]).max()
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def recorded_motion_parts(case: Case) -> list[MotionPart]:
    """The recording's bend and duration in changes of the runs `pressure` and `duration`.

    None where the motion was not seen, or those runs were not made.
    """
    pressure, duration = case.effect("pressure"), case.effect("duration")
    if case.registration.times.size == 0 or pressure is None or duration is None:
        return []
    law, (bend, length) = case.registration.law, _motion_values(case)
    parts = []
    for effect, own, (simulated, seen), std in (
        (pressure, pressure.bend, bend, _bend_std(case)),
        (duration, duration.duration, length, length[0] * law.std("stretch")),
    ):
        share, unlike = (seen - simulated) / own, abs(seen - simulated - own) / abs(simulated)
        parts.append(MotionPart(effect, share, std / abs(own), unlike))
    return parts


def _bend_std(case: Case) -> float:
    """Standard uncertainty of the recording's final bend angle (rad) by the silhouette."""
    law = case.registration.law
    factor = float(law.values[0])
    ahead, here = (final_bend(case.kinematics, factor + step) for step in (0.01, 0.0))
    return abs(ahead - here) / 0.01 * law.std("factor")


def motion_quantities(case: Case) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke, simulated and recorded."""
    bend, length = _motion_values(case)
    stds = _bend_std(case), length[0] * case.registration.law.std("stretch")
    how = "posterior of the registration"
    one = lambda v: np.array([v])  # noqa: E731
    of_bend, of_length = ([Source("silhouette", "data", one(std), how)] for std in stds)
    for e in (e for e in case.effects if e.kind == "input"):
        for sources, change in ((of_bend, e.bend), (of_length, e.duration)):
            sources.append(Source(e.name, "input", one(abs(change) * e.per_std), e.how))
    if case.geometry:
        band = one(case.bend_std)
        of_bend.append(Source("geometry and material", "input", band, "FEA's band"))
    quantities = (
        ("final_bend", "bend angle at the end", "rad", bend, abs(bend[1]), of_bend),
        ("duration", "duration of the stroke", "s", length, length[1], of_length),
    )
    return [
        ValidatedQuantity(name, label, unit, one(s), one(s), one(d), scale, sources)
        for name, label, unit, (s, d), scale, sources in quantities
    ]
