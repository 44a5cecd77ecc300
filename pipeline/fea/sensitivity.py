"""What is not known of the actuator, varied one at a time, as a standard uncertainty of R and EI over the pressure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fileio.child_process import worker_pool
from fileio.formats.bending_states import BendingStates
from pipeline.fea.analyse import bend
from pipeline.fea.settings import Actuator, Fea, Material

FloatArray = NDArray[np.float64]
PRESSURES_KPA = np.array([-40.0, -30, -20, -15, -10, -5, 5, 10, 15, 20, 30, 40])
PRESSURE_STD_PA = 200.0 / np.sqrt(3)  # the sensor's ±0.2 kPa, as limits of an even distribution


@dataclass(frozen=True)
class Variation:
    """One doubtful input at its two ends; half the difference of their curvatures over √3 is its share."""

    name: str
    low: tuple[Actuator, Fea]
    high: tuple[Actuator, Fea]


def variations(actuator: Actuator, fea: Fea) -> list[Variation]:
    """Roof and channel ± 0.5 mm, split of C10 and C01 (Mooney–Rivlin layers only), one and a half times finer mesh."""

    def resized(step: float) -> Actuator:
        return actuator.model_copy(
            update={"roof": actuator.roof + step, "channel": actuator.channel + step}
        )

    step = min(5e-4, actuator.roof / 2, actuator.channel / 2)
    result = [
        Variation(
            f"roof and channel ± {step * 1e3:g} mm", (resized(-step), fea), (resized(step), fea)
        )
    ]
    split = [_split(actuator, share) for share in (0.0, 0.4)]
    if split[0] != actuator:
        result.append(Variation("C01 = 0 or 0.4 of C10 + C01", (split[0], fea), (split[1], fea)))
    finer = fea.model_copy(update={"mesh": fea.mesh.refined(1.5)})
    return [*result, Variation("mesh 1.5 × finer", (actuator, fea), (actuator, finer))]


def _split(actuator: Actuator, share: float) -> Actuator:
    """The same small-strain stiffness with C01 the given share of C10 + C01 in every Mooney–Rivlin layer."""

    def layer(material: Material) -> Material:
        if material.law != "mooney_rivlin":
            return material
        total = material.number("C10") + material.number("C01")
        return material.model_copy(
            update={"parameters": {"C10": (1 - share) * total, "C01": share * total}}
        )

    materials = actuator.materials
    return actuator.model_copy(
        update={
            "materials": materials.model_copy(
                update={"upper": layer(materials.upper), "lower": layer(materials.lower)}
            )
        }
    )


def bending(actuator: Actuator, fea: Fea, pressures: FloatArray) -> FloatArray:
    """1/R (1/m) of the unit cell at `pressures` (Pa), and EI (N m²) where it is asked for, (1 or 2, pressure).

    Raises RuntimeError where it does not converge.
    """
    states = bend(actuator, fea, pressures=pressures, turns=(0.0,))
    if len(states.pressure) != len(pressures):
        missing = sorted(set(pressures) - set(states.pressure))[0] / 1e3
        raise RuntimeError(
            f"a variation of the unit cell does not converge at {missing:g} kPa: narrow the pressures in [fea]"
        )
    return np.array([1 / states.radius, *([states.law.stiffness] if states.law else [])])


def shares(
    actuator: Actuator,
    fea: Fea,
    pressures: FloatArray,
    processes: int,
    done: Callable[[], object] = lambda: None,
) -> dict[str, FloatArray]:
    """Standard uncertainty of what `bending` returns, by source, at `pressures` (Pa)."""
    cases = variations(actuator, fea)
    ends = [end for case in cases for end in (case.low, case.high)]
    result = {}
    with worker_pool(processes) as pool:
        jobs = [pool.submit(bending, a, f, pressures) for a, f in ends]
        for number, case in enumerate(cases):
            low, high = jobs[2 * number].result(), jobs[2 * number + 1].result()
            result[case.name] = (
                np.abs(high - low) / (2 if case.low[1] == case.high[1] else 1) / np.sqrt(3)
            )
            done()
    return result


def with_uncertainty(
    states: BendingStates,
    actuator: Actuator,
    fea: Fea,
    processes: int,
    done: Callable[[], object] = lambda: None,
) -> BendingStates:
    """States with `radius_std`, that of the stiffness, and the shares of each source in their settings.

    The curvature is varied, as R is infinite at rest: std(R) = R² std(1/R). The sources are independent and each is
    taken as evenly distributed between its ends.
    """
    ends = np.array([fea.first_pressure_kpa, fea.last_pressure_kpa])
    within = PRESSURES_KPA[(ends[0] < PRESSURES_KPA) & (ends[1] > PRESSURES_KPA)]
    inside = 1e3 * np.union1d(within, ends[ends != 0])
    both = shares(actuator, fea, inside, processes, done)
    by_source = {name: share[0] for name, share in both.items()}
    curvature = 1 / states.radius
    by_source["pressure ± 0.2 kPa"] = np.interp(
        inside, states.pressure, np.abs(np.gradient(curvature, states.pressure)) * PRESSURE_STD_PA
    )
    variance = np.sum([share**2 for share in by_source.values()], axis=0)
    knots, values = (
        np.append(inside, 0.0),
        np.append(np.sqrt(variance), by_source["pressure ± 0.2 kPa"].min()),
    )
    order = np.argsort(knots)
    std = np.interp(states.pressure, knots[order], values[order])
    straight = np.isinf(states.radius)
    radius_std = np.where(straight, np.inf, np.where(straight, 1.0, states.radius) ** 2 * std)
    note = {
        "pressures_kpa": (inside / 1e3).tolist(),
        "curvature_std": {k: v.tolist() for k, v in by_source.items()},
    }
    law = states.law
    if law:
        stiffness = {name: share[1] for name, share in both.items()}
        variance = np.sum([share**2 for share in stiffness.values()], axis=0)
        law = replace(law, stiffness_std=np.interp(states.pressure, inside, np.sqrt(variance)))
        note["bending_stiffness_std"] = {k: v.tolist() for k, v in stiffness.items()}
    return replace(
        states, radius_std=radius_std, law=law, about=states.about | {"uncertainty": note}
    )
