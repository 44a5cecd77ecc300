"""How a run of the study ended, and by what numbers; a completed run whose numbers cannot be true is WRONG."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fileio.errors import StageError
from fileio.formats.kinematics import read_kinematics
from pipeline.scene.scene import Scene, load_scene

LEAST_CLOSURE = -0.02  # of the work: below it energy has come from nothing
FORCE_RANGE = (
    0.005,
    2.0,
)  # of the added mass and drag of a plate as long as the finger: beyond it a force is no finger's
# Endings that are no result but a fault, as the tables and maps write them.
FAULTS = {"failed": "FAILED", "crashed": "CRASH", "hung": "HANG"}


def read_plans(paths: tuple[Path, ...]) -> list[dict[str, Any]]:
    """The runs of the studies' plans, each with its `axis` and `value`; StageError where a study was not run."""
    runs = []
    for path in paths:
        if not path.exists():
            raise StageError(f"{path}: no plan; run make stability, which makes the runs first")
        for run in json.loads(path.read_text(encoding="utf-8"))["runs"]:
            axis, _, value = run["run"].partition("_")
            runs.append(run | {"axis": axis, "value": value})
    return runs


def result(run: dict[str, Any]) -> dict[str, Any]:
    """The row of a run for the tables. StageError where it has not ended yet."""
    folder = Path(run["folder"])
    path = folder / "out" / run["level"] / "outcome.json"
    if not path.exists():
        raise StageError(f"{path}: the run has not ended; run make stability again")
    outcome = json.loads(path.read_text(encoding="utf-8"))
    row = {key: run[key] for key in ("run", "axis", "value", "level", "ranks")}
    row |= {"scene": Path(run["scene"]).name}
    row |= {key: value for key, value in outcome.items() if key not in ("format", "format_version")}
    row["ended"] = FAULTS.get(row["ended"], row["ended"])
    if row["ended"] == "completed":
        return row | judged(load_scene(folder, run["level"]))
    try:
        return row | motion_numbers(load_scene(folder, run["level"]))
    except StageError:  # refused before there was a motion
        return row


def motion_numbers(scene: Scene) -> dict[str, Any]:
    """Bend (deg) and the tip's largest speed and acceleration of a scene whose kinematics are there."""
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    times, bend = kinematics.law.x, np.degrees(kinematics.data["shape_bend"].values)
    path = CubicSpline(times, kinematics.splines["tip"](kinematics.law(times)))
    largest = [float(np.hypot(*path(times, order).T).max()) for order in (1, 2)]
    return {
        "bend_deg": round(float(bend[np.abs(bend).argmax()]), 1),
        "tip_speed": round(largest[0], 4),
        "tip_acceleration": round(largest[1], 3),
    }


def judged(scene: Scene) -> dict[str, Any]:
    """A completed run's numbers, and whether they can be true."""
    record = json.loads((scene.out / "run" / "run.json").read_text())
    force = np.loadtxt(scene.out / "run" / "forces.csv", delimiter=",", skiprows=1, ndmin=2)
    power = np.loadtxt(scene.out / "run" / "power.csv", delimiter=",", skiprows=1, ndmin=2)
    balance, motion = record["power_balance"], motion_numbers(scene)
    peak = float(np.hypot(force[:, 1], force[:, 2]).max())
    finger, fluid = scene.finger, scene.fluid
    length = finger.length + finger.tip.length
    plate = fluid.density * finger.width * (
        np.pi / 4 * length**2 * motion["tip_acceleration"] + length * motion["tip_speed"] ** 2
    )  # fmt: skip
    numbers = {
        "cells": record["cells"],
        "steps": record["steps"],
        "courant_max": round(record["courant_max"], 3),
        "continuity_max": record["continuity_max"],
        "non_orthogonality_deg": round(record["mesh_quality"]["max_non_orthogonality_deg"], 1),
        "work_J": balance["work"],
        "kinetic_J": float(power[:, 2].max()),
        "closure_fraction": round(balance["closure_fraction"], 4),
        "from_nothing_fraction": round(balance["from_nothing_fraction"], 6),
        "peak_force_N": round(peak, 5),
        "force_of_plate": round(peak / plate, 4),
    }
    wrong = []
    if record["scene_hash"] != scene.digest():
        wrong.append("the results are of other numbers")
    if not (np.isfinite(force).all() and np.isfinite(power).all()):
        wrong.append("numbers that are none")
    if len(force) != record["steps"]:
        wrong.append(f"{len(force)} rows of forces for {record['steps']} steps")
    if balance["closure_fraction"] < LEAST_CLOSURE:
        wrong.append("energy from nothing")
    if not FORCE_RANGE[0] < peak / plate < FORCE_RANGE[1]:
        wrong.append(f"a force of {peak / plate:.2g} of a plate's")
    return (
        {"ended": "WRONG" if wrong else "completed", "reason": "; ".join(wrong)} | motion | numbers
    )
