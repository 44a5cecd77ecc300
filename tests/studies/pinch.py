"""`python -m tests.studies.pinch`: writes docs/record/pinch_variations.csv and pinch_lift.csv.

Of the runs of cases/pinch/studies/variations.csv that are made: findings and numbers of the flow,
and what the flow between the fingers does to a small sphere. Rows of other runs stay. SI units.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.formats.records import RUN
from pipeline.runs.run import Run, run_of
from postprocess.compare.findings import read_findings
from postprocess.compare.pinch_summary import APPROACH, pinch_summary
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.stage import judge
from postprocess.evidence.centreline import beside_middle, crossings, on_middle
from postprocess.evidence.evidence import Evidence
from postprocess.evidence.fields import frame
from postprocess.evidence.load import load_evidence
from postprocess.evidence.pair_integrals import LATE
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.time_windows import gap_reached
from postprocess.tables import write_table
from softfinger.study.plan import describe
from softfinger.study.rows import read_study

HOME = Path(__file__).resolve().parents[2] / "cases" / "pinch"
RECORD = HOME.parents[1] / "docs" / "record"
G = 9.81  # m/s²
DIAMETER = 0.005  # m, of the sphere: a quarter of the finger's width
SETTLED = 0.03  # s after contact, as in the findings


def acceleration(time: np.ndarray, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vertical acceleration (time, y), m/s², of the water on a line from its `v` (m/s) there.

    By symmetry the water stays on the line: Dv/Dt = ∂v/∂t + v ∂v/∂y.
    """
    return np.gradient(v, time, axis=0) + v * np.gradient(v, y, axis=1)


def held_excess(v: np.ndarray, a: np.ndarray, diameter: float, viscosity: float) -> np.ndarray:
    """Density excess over the water's, as a part of it, that a held sphere's lift would carry.

    F = (1 + 1/2) ρ V Dv/Dt + drag, over ρ V g. The inertial terms of a sphere at rest: Maxey and
    Riley, Phys. Fluids 26, 883 (1983), and Auton, Hunt and Prud'homme, J. Fluid Mech. 197, 241
    (1988); the drag: Schiller and Naumann 1935, for Re up to 1000.
    """
    re = np.abs(v) * diameter / viscosity
    drag = 18 * viscosity / diameter**2 * (1 + 0.15 * re**0.687) * v
    return (1.5 * a + drag) / G


def carried(time: np.ndarray, y: np.ndarray, v: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Heights (m) at the last instant of neutrally buoyant spheres at rest in the water at first.

    Without density difference they move as the water does. NaN where one leaves what is known.
    """
    at = start.astype(float)
    for k in range(len(time) - 1):
        h = time[k + 1] - time[k]
        middle = at + 0.5 * h * np.interp(at, y, v[k])
        at = at + h * np.interp(middle, y, 0.5 * (v[k] + v[k + 1]))
    return at


def lift(
    evidence: Evidence, met: float, width: float, density: float, viscosity: float
) -> dict[str, float]:
    """What the flow between fingers lifts that meet at `met` (s); `width` across the sheet (m).

    `flux_*` (N): ρ ∫ v |v| over the level surface between the fingers, a tip width above the tips,
    means over the approach and after contact. `excess_*`: the same means of `held_excess` on x = 0,
    at the best height above the tips where the fingers are two diameters apart. `rise` (m): of a
    free sphere from such a height, from the beginning of the approach until LATE.
    """
    plane, clock = evidence.planes["cfd"], evidence.clock
    x, y, times = (plane[name].values for name in ("x", "y", "time"))
    size = float(plane.attrs["tip_width"])
    begin, near = (gap_reached(clock, gap) for gap in APPROACH)
    used = np.flatnonzero((times >= begin) & (times <= met + LATE))
    tips = plane["tip"].values[used, :, 1].mean(axis=1)
    columns, share = beside_middle(x)
    rows, flux, there = [], [], []
    for k, tip in zip(used, tips, strict=True):
        (_, v), valid = frame(plane, int(k))
        rows.append(on_middle(np.where(valid, v, np.nan)[:, columns], share))
        left = plane["outline"].values[k, 0]
        inner = np.array([np.abs(crossings(left, height)).min(initial=np.inf) for height in y])
        row = int(np.argmin(np.abs(y - tip - size)))
        across = valid[row] & (np.abs(x) < inner[row])
        flux.append(density * width * (x[1] - x[0]) * (v * np.abs(v))[row, across].sum())
        there.append((inner > DIAMETER) & (y > tip) & (y < tip + 3 * size))
    time, middle = times[used], np.array(rows)
    excess = held_excess(middle, acceleration(time, y, middle), DIAMETER, viscosity)
    out = {}
    for name, span in {"approach": time <= near, "after": time >= met + SETTLED}.items():
        out[f"flux_{name}"] = float(np.mean(np.array(flux)[span]))
        heights = np.all(np.array(there)[span], axis=0)
        out[f"excess_{name}"] = float(excess[span][:, heights].mean(axis=0).max())
    rise = carried(time, y, np.nan_to_num(middle), y[there[0]]) - y[there[0]]
    return out | {"rise": float(rise.max())}


def head_of(name: str, run: Run) -> dict[str, Any]:
    """What a row is of."""
    record = RUN.read(run.out / "run" / "run.json")
    return {
        "run": name,
        "change": "; ".join(f"{k} = {v}" for k, v in run.overrides.items()) or "as it is",
        **{key: record[key] for key in ("model", "cells", "steps")},
        "made_with": run.digest("solve")[:16],
        "measured_on": datetime.now(UTC).date().isoformat(),
        "openfoam": record["versions"]["OpenFOAM"],
    }


def rows_of(name: str, run: Run, evidence: Evidence) -> pd.DataFrame:
    """A run's findings of the CFD and its numbers, a row each."""
    head = head_of(name, run)
    findings = read_findings(HOME / "reference" / "findings.toml", frozenset(QUANTITIES))
    checks = [judge(f, evidence) for f in findings if f.kind == "paper" and "cfd" in f.of]
    rows = [
        {"kind": "finding", "quantity": c["id"], "value": c["measured"]["cfd"], "unit": c["unit"],
         "met": c["met_by"].get("cfd"), "note": " ".join(c["notes"])}
        for c in checks
    ]  # fmt: skip
    numbers = pinch_summary(evidence)
    numbers |= numbers.pop("cfd")
    rows += [{"kind": "number", "quantity": k, "value": v} for k, v in numbers.items()]
    return pd.DataFrame([head | row for row in rows])


def main() -> None:
    """Both tables."""
    tables: dict[str, list[pd.DataFrame]] = {"variations": [], "lift": []}
    for row in read_study(HOME / "studies" / "variations.csv"):
        run = run_of(describe(HOME, "variations", row))
        if run.stale("vortices_cfd"):
            continue
        evidence = load_evidence(StageFiles(run.scene))
        tables["variations"].append(rows_of(row.run, run, evidence))
        met, fluid = evidence.clock.met(), run.scene.fluid
        if met is not None:
            water = fluid.density, fluid.kinematic_viscosity
            lifted = lift(evidence, met, run.scene.finger.width, *water)
            tables["lift"].append(pd.DataFrame([head_of(row.run, run) | lifted]))
        print(row.run, flush=True)
    for name, parts in tables.items():
        path = RECORD / f"pinch_{name}.csv"
        if path.exists():
            old = pd.read_csv(path)
            made = {run for part in parts for run in part["run"]}
            parts = [old[~old["run"].isin(made)], *parts]
        write_table(path, pd.concat(parts))


if __name__ == "__main__":
    main()
