"""One run of the study, from its scene to its end, in a process of its own: how it ended, and by what numbers."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import time
import traceback
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline import case, kinematics, mesh
from pipeline import run as run_stage
from pipeline.errors import StageError
from pipeline.openfoam import foam_version as openfoam
from pipeline.scene import Scene, digest, load_scene
from pipeline.stage import read_dataset, versions
from tests.stability.table import Row, scene_text

HANG = 7200.0  # s; the longest run takes minutes on an idle machine
LEAST_CLOSURE = -0.02  # of the work: below it energy has come from nothing
FORCE_RANGE = (
    0.005,
    2.0,
)  # of the added mass and drag of a plate as long as the finger: beyond it a force is no finger's
STAGES = {"kinematics": kinematics.run, "mesh": mesh.run, "case": case.run, "run": run_stage.run}


def attempt(row: Row) -> dict[str, Any]:
    """Run a row, or take what it ended with before, where neither scene nor libraries have changed."""
    row.folder.mkdir(parents=True, exist_ok=True)
    path, text = row.folder / "scene.toml", scene_text(row)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
    key = digest([text, _resolved(row), versions(), openfoam()])
    kept = row.folder / "result.json"
    if kept.exists() and (found := json.loads(kept.read_text())).get("key") == key:
        return found
    shutil.rmtree(row.folder / "out", ignore_errors=True)
    result = {"run": row.run, "scene": row.scene.name, "axis": row.axis, "value": row.value, "level": row.level,
              "ranks": row.ranks, "key": key} | _in_child(row)  # fmt: skip
    part = kept.with_name("result.json.part")
    part.write_text(json.dumps(result, indent=1) + "\n")
    os.replace(part, kept)
    shutil.rmtree(row.folder / "out" / row.level / "case", ignore_errors=True)
    return result


def _resolved(row: Row) -> str:
    """The scene with all that it inherits, or why there is none."""
    try:
        return load_scene(row.folder, row.level).digest()
    except StageError as error:
        return str(error)


def _in_child(row: Row) -> dict[str, Any]:
    """Fork, run the stages there, and read how they ended; a crash or a hang is an ending as well."""
    answer = row.folder / "answer.json"
    answer.unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        os.setsid()
        try:
            answer.write_text(json.dumps(_stages(row)))
        finally:
            os._exit(0)
    deadline = time.monotonic() + HANG
    while not (done := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return {"ended": "HANG", "reason": f"not over after {HANG / 60:g} minutes"}
        time.sleep(0.05)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if not answer.exists():
        return {
            "ended": "CRASH",
            "reason": f"the process ended with status {done[1]}",
            "cpu_s": round(spent, 1),
        }
    result = json.loads(answer.read_text())
    answer.unlink()
    return result | {"cpu_s": round(spent, 1)}


def _stages(row: Row) -> dict[str, Any]:
    """Run the stages; how they ended."""
    stage = "scene"
    try:
        scene = load_scene(row.folder, row.level)
        scene.out.mkdir(parents=True, exist_ok=True)
        for stage, action in STAGES.items():
            if stage == "run":
                action(scene, quiet=True, ranks=row.ranks)
            else:
                action(scene, quiet=True)
    except StageError as error:
        text = " ".join(str(error).split())
        stopped = re.search(r"stopped at ([-+\d.e]+) s", text)
        ended = "stopped" if stopped else "FAILED" if "failed at" in text else "refused"
        found: dict[str, Any] = {"ended": ended, "stage": stage, "reason": _without_paths(text, row)}
        return found | ({"stopped_at_s": float(stopped.group(1))} if stopped else {}) | _motion(row)
    except (Exception, SystemExit):
        return {"ended": "CRASH", "stage": stage, "reason": traceback.format_exc().splitlines()[-1][:300]}
    return _judged(scene)


def _without_paths(text: str, row: Row) -> str:
    for folder in (row.folder.resolve(), row.folder):
        text = text.replace(f"{folder}/", "")
    return text[:400]


def _motion(row: Row) -> dict[str, Any]:
    try:
        return motion_numbers(load_scene(row.folder, row.level))
    except StageError:
        return {}


def motion_numbers(scene: Scene) -> dict[str, Any]:
    """Bend (deg) and the tip's largest speed and acceleration of a scene whose kinematics are there."""
    with read_dataset(scene.out / "kinematics.h5", "kinematics") as file:
        times, pressure = file["time"].values, file["pressure"].values
        tip = CubicSpline(file["shape_parameter"].values, file["shape_tip"].values)
        bend = np.degrees(file["shape_bend"].values)
    path = CubicSpline(times, tip(CubicSpline(times, pressure)(times)))
    largest = [float(np.hypot(*path(times, order).T).max()) for order in (1, 2)]
    return {
        "bend_deg": round(float(bend[np.abs(bend).argmax()]), 1),
        "tip_speed": round(largest[0], 4),
        "tip_acceleration": round(largest[1], 3),
    }


def _judged(scene: Scene) -> dict[str, Any]:
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
    if not (np.isfinite(force).all() and np.isfinite(power).all()):
        wrong.append("numbers that are none")
    if len(force) != record["steps"]:
        wrong.append(f"{len(force)} rows of forces for {record['steps']} steps")
    if balance["closure_fraction"] < LEAST_CLOSURE:
        wrong.append("energy from nothing")
    if not FORCE_RANGE[0] < peak / plate < FORCE_RANGE[1]:
        wrong.append(f"a force of {peak / plate:.2g} of a plate's")
    return (
        {"ended": "WRONG" if wrong else "completed", "stage": "run", "reason": "; ".join(wrong)}
        | motion
        | numbers
    )
