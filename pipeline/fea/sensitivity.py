"""Standard uncertainty of R and EI from inputs of the actuator that are not known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.fea.analyse import bend
from pipeline.fea.settings import UNCERTAIN_AT_KPA, Actuator, Fea, Material
from pipeline.formats.bending_states import BendingStates, FloatArray
from piv.files.child_process import worker_pool

_PRESSURE_STD_PA = 200.0 / np.sqrt(3)  # the sensor's ±0.2 kPa, as limits of an even distribution
_SENSOR = "pressure ± 0.2 kPa"


def variations(
    actuator: Actuator, fea: Fea
) -> dict[str, tuple[tuple[Actuator, Fea], tuple[Actuator, Fea]]]:
    """Each uncertain input at its two ends.

    Roof and channel ± 0.5 mm, the split of C10 and C01 in Mooney–Rivlin layers, a finer mesh.
    """

    def resized(step: float) -> Actuator:
        heights = {"roof": actuator.roof + step, "channel": actuator.channel + step}
        return actuator.model_copy(update=heights)

    step = min(5e-4, actuator.roof / 2, actuator.channel / 2)
    result = {
        f"roof and channel ± {step * 1e3:g} mm": ((resized(-step), fea), (resized(step), fea))
    }
    low, high = (_split(actuator, share) for share in (0.0, 0.4))
    if low != actuator:
        result["C01 = 0 or 0.4 of C10 + C01"] = ((low, fea), (high, fea))
    finer = fea.model_copy(update={"mesh": fea.mesh.refined(1.5)})
    return result | {"mesh 1.5 × finer": ((actuator, fea), (actuator, finer))}


def _split(actuator: Actuator, share: float) -> Actuator:
    """The same small-strain stiffness, with C01 = `share` of C10 + C01 in Mooney–Rivlin layers."""

    def layer(material: Material) -> Material:
        if material.law != "mooney_rivlin":
            return material
        total = material.number("C10") + material.number("C01")
        parameters = {"C10": (1 - share) * total, "C01": share * total}
        return material.model_copy(update={"parameters": parameters})

    m = actuator.materials
    layers = m.model_copy(update={"upper": layer(m.upper), "lower": layer(m.lower)})
    return actuator.model_copy(update={"materials": layers})


def bending(actuator: Actuator, fea: Fea, pressures: FloatArray) -> FloatArray:
    """1/R (1/m) and, where it is computed, EI (N m²) at `pressures` (Pa): (1 or 2, pressure).

    Raises RuntimeError where the unit cell does not converge.
    """
    states = bend(actuator, fea, pressures=pressures, turns=(0.0,))
    if len(states.pressure) != len(pressures):
        missing = min(set(pressures) - set(states.pressure)) / 1e3
        raise RuntimeError(
            f"a variation of the unit cell does not converge at {missing:g} kPa:"
            " narrow the pressures in [fea]"
        )
    return np.array([1 / states.radius, *([states.law.stiffness] if states.law else [])])


def _shares(
    actuator: Actuator,
    fea: Fea,
    pressures: FloatArray,
    processes: int,
    done: Callable[[], object],
) -> dict[str, FloatArray]:
    """Standard uncertainty of what `bending` returns, by source; ends are evenly distributed."""
    result = {}
    with worker_pool(processes) as pool:
        jobs = {
            name: (ends, [pool.submit(bending, a, f, pressures) for a, f in ends])
            for name, ends in variations(actuator, fea).items()
        }
        for name, ((low, high), (first, second)) in jobs.items():
            half = 2 if low[1] == high[1] else 1
            result[name] = np.abs(second.result() - first.result()) / half / np.sqrt(3)
            done()
    return result


def with_uncertainty(
    states: BendingStates,
    actuator: Actuator,
    fea: Fea,
    processes: int,
    done: Callable[[], object] = lambda: None,
) -> BendingStates:
    """States with `radius_std`, the uncertainty of the stiffness, and each source's share.

    The curvature is varied, as R is infinite at rest: std(R) = R² std(1/R).
    """
    low, high = fea.first_pressure_kpa, fea.last_pressure_kpa
    within = {at for at in UNCERTAIN_AT_KPA if low < at < high} | {low, high} - {0.0}
    inside = 1e3 * np.array(sorted(within))
    both = _shares(actuator, fea, inside, processes, done)
    slope = np.abs(np.gradient(1 / states.radius, states.pressure))
    sensor = np.interp(inside, states.pressure, slope * _PRESSURE_STD_PA)
    by_source = {name: share[0] for name, share in both.items()} | {_SENSOR: sensor}
    knots = np.append(inside, 0.0)
    values = np.append(_together(by_source), sensor.min())
    order = np.argsort(knots)
    std = np.interp(states.pressure, knots[order], values[order])
    straight = np.isinf(states.radius)
    radius_std = np.where(straight, np.inf, np.where(straight, 1.0, states.radius) ** 2 * std)
    note = {"pressures_kpa": (inside / 1e3).tolist(), "curvature_std": _lists(by_source)}
    law = states.law
    if law:
        stiffness = {name: share[1] for name, share in both.items()}
        law = replace(law, stiffness_std=np.interp(states.pressure, inside, _together(stiffness)))
        note["bending_stiffness_std"] = _lists(stiffness)
    about = states.about | {"uncertainty": note}
    return replace(states, radius_std=radius_std, law=law, about=about)


def _together(sources: dict[str, FloatArray]) -> FloatArray:
    """Root of the sum of squares of independent sources."""
    return np.sqrt(np.sum([share**2 for share in sources.values()], axis=0))


def _lists(sources: dict[str, FloatArray]) -> dict[str, list[float]]:
    return {name: share.tolist() for name, share in sources.items()}
