"""The finger's own motion as quantities: final bend angle and duration of the stroke, simulated and recorded."""

from __future__ import annotations

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.files import Registration
from postprocess.lab.judgement.inputs_of_budget import Case, MotionPart
from postprocess.lab.judgement.validation import Source, ValidatedQuantity
from postprocess.lab.registration.register import fit_law

PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts


def motion_values(case: Case) -> tuple[tuple[float, float], tuple[float, float]]:
    """(simulation, recording) of the final bend angle (rad) and of the stroke's duration (s)."""
    factor, _, stretch = case.registration.law.values
    length = stroke_duration(case.kinematics)
    return (final_bend(case.kinematics, 1.0), final_bend(case.kinematics, factor)), (
        length,
        length * float(stretch),
    )


def motion_sentence(registration: Registration) -> str:
    """What the pictures show of the motion, against the simulation's alone: no input's uncertainty is in it."""
    law = registration.law
    if registration.times.size == 0:
        return f"vectors do not show the finger; the clock is stated to ± {1960 * law.std('delay'):.1f} ms"
    parts = []
    for name, value, what in (
        ("factor", law.values[0], "bends as at"),
        ("stretch", law.values[2], "takes"),
    ):
        band = 1.96 * law.std(name)
        same = "as simulated" if abs(value - 1) < band else "otherwise than simulated"
        of = "the pressure" if name == "factor" else "the time"
        parts.append(f"{what} {value:.3f} ± {band:.3f} times {of} ({same})")
    return f"the finger {' and '.join(parts)}; its clock is {law.delay * 1e3:.1f} ± {1960 * law.std('delay'):.1f} ms ahead (95 %)"


def final_bend(kinematics: Kinematics, factor: float) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def motion_of_run(nominal: Kinematics, run: Kinematics) -> tuple[float, float]:
    """Final bend (rad) and duration (s) by which a run's motion differs from the nominal one, in terms of its law."""
    times = np.linspace(*nominal.time, 201)
    values, _, _ = fit_law(nominal, times, run.law(times), np.array([1.0, 0.0, 1.0]))
    return (
        final_bend(nominal, float(values[0])) - final_bend(nominal, 1.0),
        stroke_duration(nominal) * (float(values[2]) - 1),
    )


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, 801)
    bend = kinematics.bend(kinematics.law(times))
    done = np.maximum.accumulate(np.abs(bend - bend[0])) / np.abs(bend - bend[0]).max()
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def recorded_motion_parts(case: Case) -> list[MotionPart]:
    """The recording's bend and duration in changes of the runs `pressure` and `duration`; none where the motion is the recording's own,
    was not seen, or those runs are not there."""
    pressure, duration = case.effect("pressure"), case.effect("duration")
    if (
        case.measured_motion
        or case.registration.times.size == 0
        or pressure is None
        or duration is None
    ):
        return []
    law, (bend, length) = case.registration.law, motion_values(case)
    parts = []
    for effect, own, (simulated, seen), std in (
        (pressure, pressure.bend, bend, bend_std(case)),
        (duration, duration.duration, length, length[0] * law.std("stretch")),
    ):
        share, unlike = (seen - simulated) / own, abs(seen - simulated - own) / abs(simulated)
        parts.append(MotionPart(effect, share, std / abs(own), unlike))
    return parts


def bend_std(case: Case) -> float:
    """Standard uncertainty of the recording's final bend angle (rad) by the silhouette."""
    law = case.registration.law
    factor = float(law.values[0])
    ahead, here = (final_bend(case.kinematics, factor + step) for step in (0.01, 0.0))
    return abs(ahead - here) / 0.01 * law.std("factor")


def motion_quantities(case: Case) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke: does the simulation's finger move as the recording's?"""
    bend, length = motion_values(case)
    law = case.registration.law
    one = lambda v: np.array([v])  # noqa: E731
    seen_by = {"final_bend": bend_std(case), "duration": length[0] * law.std("stretch")}
    how = "posterior of the registration"
    sources = {key: [Source("silhouette", "data", one(std), how)] for key, std in seen_by.items()}
    for effect in (e for e in case.effects if e.kind == "input"):
        for key, change in (("final_bend", effect.bend), ("duration", effect.duration)):
            sources[key].append(
                Source(effect.name, "input", one(abs(change) * effect.per_std), effect.how)
            )
    if case.geometry:
        sources["final_bend"].append(
            Source("geometry and material", "input", one(case.bend_std), "FEA's band")
        )
    return [
        ValidatedQuantity("final_bend", "bend angle at the end", "rad", one(bend[0]), one(bend[0]), one(bend[1]), abs(bend[1]), sources["final_bend"]),
        ValidatedQuantity("duration", "duration of the stroke", "s", one(length[0]), one(length[0]), one(length[1]), length[1], sources["duration"]),
    ]  # fmt: skip
