"""Turek and Hron's flag behind a cylinder: forces and motion of its end, grid by grid."""

import numpy as np

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.shedding import periods
from docs.evidence.validation.solve import CASES, provenance, reference, solved
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.scene.scene import Scene
from pipeline.structure.finger import ElasticFinger
from softfinger.study.rows import read_study

NAME = "turek_hron"  # of the published numbers, and of the runs whose flag rests or bends
FLUTTER = "turek_hron_flutter"  # of the runs that shed vortices, which take hours
LATE = 0.5  # of the run, after which it is evaluated
Series = tuple[np.ndarray, np.ndarray]  # times in s, values


def forces(scene: Scene) -> dict[str, Series]:
    """Drag and lift on cylinder and flag, N/m."""
    table = np.genfromtxt(scene.out / "run" / "forces.csv", delimiter=",", names=True)
    each = {"drag": "fx", "lift": "fy"}
    return {k: (table["time"], table[n] / scene.finger.width) for k, n in each.items()}


def end_of_flag(scene: Scene) -> dict[str, Series]:
    """Displacement of the middle of the flag's end, along and across the stream, mm."""
    chain, file = ElasticFinger.of(scene).chain, read_elastic_motion(scene.out / FILE)
    time, pressure, delta = (file[name].values for name in ("time", "pressure", "delta"))
    line = chain.profile(pressure, delta)[:, -2:] @ [1, 1j]
    end = line[:, 1] - line[:, 0]
    dorsal = -1j * end / np.abs(end)
    place = 1e3 * (line[:, 1] + 0.5 * chain.thickness(pressure)[:, -1] * dorsal)
    return {"along": (time, (place - place[0]).real), "across": (time, (place - place[0]).imag)}


def swing(series: Series, beat: Series | None) -> dict[str, float]:
    """Mean and amplitude, by the extremes of the last whole period, and frequency, Hz.

    As Turek and Hron define them. `beat`, the flag's end or the lift, gives the periods, since
    drag swings twice in each; None: of a steady flow, the mean over time.
    """
    time, value = series
    late = time > LATE * time[-1]
    time, value = time[late], value[late]
    across = np.interp(time, *(beat or series))
    begun = periods(time, across - 0.5 * (across.max() + across.min()))
    if beat is None or len(begun) < 3:
        return {"mean": float(value.mean())}
    last = value[(time >= begun[-2]) & (time <= begun[-1])]
    return {
        "mean": float(0.5 * (last.max() + last.min())),
        "amplitude": float(0.5 * np.ptp(last)),
        "frequency": float((len(begun) - 1) / (begun[-1] - begun[0])),
    }


def measure(name: str) -> Result:
    """Drag, lift and displacement of the runs of a study against the published table."""
    published = reference(NAME)
    checks = []
    for row in (one.run for one in read_study(CASES / "studies" / f"{name}.csv")):
        scene = solved(row, name, "solve")
        of_water = forces(scene)
        series = of_water | (end_of_flag(scene) if scene.coupled else {})
        test, grid = row.split("_", 1)
        beat = series.get("across", series["lift"])
        limits = published["tolerance"]
        limits = limits.get(test, limits[test[:3]])
        for quantity, wanted in published[test].items():
            found = swing(series[quantity], beat if "amplitude" in wanted else None)
            for part, value in wanted.items():
                unit = {"frequency": "Hz"}.get(part, "N/m" if quantity in of_water else "mm")
                checks.append(
                    Check(f"{row}.{quantity}.{part}", f"{test.upper()} on grid {grid}: {part} of"
                          f" {quantity}", found.get(part, 0.0),
                          limits[part], "relative", "asked of the finest grid", value,
                          published["source"], unit)
                )  # fmt: skip
    return Result(name, scene.title, tuple(checks), provenance=provenance(scene))
