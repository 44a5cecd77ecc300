"""How a run of the study ended. It is WRONG where its numbers are impossible without a warning."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import STUDY_PLAN
from pipeline.runs.run import run_of
from pipeline.scene.scene import Scene
from piv.files.errors import StageError
from piv.files.record import read_record
from softfinger.study.outcome import OUTCOME, outcome_is_there

LEAST_CLOSURE = -0.02  # of the work: below it energy has come from nothing
# Possible peak forces, over added mass and drag of a plate as long as the finger.
FORCE_RANGE = (0.005, 2.0)
ENERGY = "energy from nothing"
FAULTS = {"failed": "FAILED", "crashed": "CRASH", "hung": "HANG"}  # names in tables and maps


def read_plans(paths: list[Path]) -> list[dict[str, Any]]:
    """Runs of the plans, with `axis` and `value`; StageError where a study was not run."""
    runs = []
    for path in paths:
        if not path.exists():
            raise StageError(f"{path}: no plan; make the runs first: softfinger study")
        for run in STUDY_PLAN.read(path)["runs"]:
            axis, _, value = run["run"].partition("_")
            runs.append(run | {"axis": axis, "value": value})
    return runs


def result(run: dict[str, Any]) -> dict[str, Any]:
    """The row of a run for the tables; StageError where it has not ended yet."""
    outcome = read_record(Path(run["out"]), OUTCOME)
    if outcome is None or not outcome_is_there(run):
        raise StageError(f"{run['out']}: no outcome of these numbers; run softfinger study again")
    row = {key: run[key] for key in ("run", "axis", "value", "level", "ranks")}
    row |= {"scene": Path(run["folder"]).name, "reason": outcome["reason"]}
    row |= {"stage": outcome["ended_at"], "stopped_at_s": outcome.get("stopped_at_s", "")}
    row |= {"ended": FAULTS.get(outcome["ended"], outcome["ended"]), "cpu_s": outcome["cpu_time"]}
    try:
        scene = run_of(run).scene
        return row | (judged(scene) if row["ended"] == "completed" else motion_numbers(scene))
    except StageError:  # refused before there was a motion
        if row["ended"] == "completed":
            raise
        return row


def motion_numbers(scene: Scene) -> dict[str, Any]:
    """Bend (deg) and largest speed and acceleration of the tip, from the kinematics."""
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    times, bend = kinematics.law.x, np.degrees(kinematics.data["shape_bend"].values)
    path = CubicSpline(times, kinematics.splines["tip"](kinematics.law(times)))
    speed, acceleration = (float(np.hypot(*path(times, order).T).max()) for order in (1, 2))
    numbers = {"tip_speed": round(speed, 4), "tip_acceleration": round(acceleration, 3)}
    return {"bend_deg": round(float(bend[np.abs(bend).argmax()]), 1)} | numbers


def judged(scene: Scene) -> dict[str, Any]:
    """Numbers of a completed run, and whether they are possible."""
    folder = scene.out / "run"
    record = json.loads((folder / "run.json").read_text())
    files = (folder / name for name in ("forces.csv", "power.csv"))
    force, power = (np.loadtxt(f, delimiter=",", skiprows=1, ndmin=2) for f in files)
    balance, motion = record["power_balance"], motion_numbers(scene)
    peak = float(np.hypot(force[:, 1], force[:, 2]).max())
    finger, fluid = scene.finger, scene.fluid
    length = finger.length + finger.tip.length
    added_mass = np.pi / 4 * length**2 * motion["tip_acceleration"]
    drag = length * motion["tip_speed"] ** 2
    share = peak / (fluid.density * finger.width * (added_mass + drag))
    faults = {
        "numbers that are none": not (np.isfinite(force).all() and np.isfinite(power).all()),
        f"{len(force)} rows of forces for {record['steps']} steps": len(force) != record["steps"],
        ENERGY: balance["closure_fraction"] < LEAST_CLOSURE,
        f"a force of {share:.2g} of a plate's": not FORCE_RANGE[0] < share < FORCE_RANGE[1],
    }
    wrong = [fault for fault, found in faults.items() if found]
    return {
        "ended": ending(wrong, balance["warning"]),
        "reason": "; ".join(filter(None, [*wrong, balance["warning"]])),
        **motion,
        **{key: record[key] for key in ("cells", "steps", "continuity_max")},
        "courant_max": round(record["courant_max"], 3),
        "non_orthogonality_deg": round(record["mesh_quality"]["max_non_orthogonality_deg"], 1),
        "work_J": balance["work"],
        "kinetic_J": float(power[:, 2].max()),
        "closure_fraction": round(balance["closure_fraction"], 4),
        "from_nothing_fraction": round(balance["from_nothing_fraction"], 6),
        "peak_force_N": round(peak, 5),
        "force_of_plate": round(share, 4),
    }


def ending(faults: list[str], warning: str) -> str:
    """Name how a completed run ended; a warning covers energy from nothing alone."""
    if set(faults) - ({ENERGY} if warning else set()):
        return "WRONG"
    return "wrong" if faults else "completed"
