"""A fixed cylinder in a current sheds vortices: drag, lift and Strouhal number."""

import numpy as np

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import forces, law_and_body, provenance, record_of, reference
from pipeline.scene.scene import Scene

LATE = 0.4  # of the run, which its last periods are taken from


def periods(time: np.ndarray, lift: np.ndarray) -> np.ndarray:
    """Times (s) at which the lift rises through 0."""
    up = np.flatnonzero((lift[:-1] < 0) & (lift[1:] >= 0))
    part = lift[up] / (lift[up] - lift[up + 1])
    return np.asarray(time[up] + part * (time[up + 1] - time[up]))


def measure(scene: Scene) -> Result:
    """Mean drag, amplitude of the lift and Strouhal number over the last whole periods."""
    ref, (_, body) = reference(scene.name)["shedding"], law_and_body(scene)
    assert scene.current is not None
    speed, history = scene.current.speed or 0.0, forces(scene)
    unit = 0.5 * scene.fluid.density * speed**2 * body.diameter
    late = history.time > LATE * history.time[-1]
    time, drag, lift = (x[late] for x in (history.time, history.fx / unit, history.fy / unit))
    begun = periods(time, lift)
    whole = (time >= begun[0]) & (time < begun[-1])
    strouhal = (len(begun) - 1) / (begun[-1] - begun[0]) * body.diameter / speed
    amplitude = 0.5 * np.ptp(lift[whole])
    lost = abs(record_of(scene)["through_flow"]["momentum_unexplained"])
    source, asked = (
        ref["source"],
        "what is asked of a current; published computations differ by 2 %",
    )
    checks = (
        Check("shedding.drag", "mean drag coefficient", float(drag[whole].mean()), 0.02,
              "relative", asked, ref["drag"], source),
        Check("shedding.strouhal", "Strouhal number", float(strouhal), 0.02, "relative", asked,
              ref["strouhal"], source),
        Check("shedding.lift", "amplitude of the lift coefficient", float(amplitude), 0.05,
              "relative", "published computations give 0.32 to 0.34", ref["lift"], source),
        Check("shedding.momentum", "momentum along x that is unexplained, over what the ends give",
              lost, 0.02, "at most", "as much as is asked of the drag"),
    )  # fmt: skip
    return Result(scene.name, scene.title, checks, provenance=provenance(scene))
