"""Running a scene of cases/validation through the project's own stages, and reading what they wrote."""

from __future__ import annotations

import json
import resource
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import case, kinematics, mesh, run, sheets
from pipeline.scene import Scene, load_scene

CASES = Path(__file__).resolve().parents[2] / "cases" / "validation"
Prepare = Callable[[Scene], None]


@dataclass(frozen=True)
class Forces:
    """Force of the water on the body, N: total and viscous, over `time` s."""

    time: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    fx_viscous: np.ndarray
    fy_viscous: np.ndarray


def cpu_seconds() -> float:
    """CPU time of this process and the children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def solved(
    name: str, level: str = "coarse", quiet: bool = True, folder: Path = CASES, again: bool = False
) -> Scene:
    """The scene, taken through kinematics, mesh, case, run and sheet unless that was done for these very numbers."""
    scene = load_scene(folder / name, level)
    record = scene.out / "run" / "run.json"
    if not again and record.exists() and json.loads(record.read_text())["scene_hash"] == scene.digest():
        return scene
    scene.out.mkdir(parents=True, exist_ok=True)
    before = cpu_seconds()
    for stage in (kinematics, mesh, case, run, sheets):
        stage.run(scene, quiet)
    (scene.out / "run" / "cpu.json").write_text(json.dumps({"cpu_seconds": round(cpu_seconds() - before, 1)}))
    return scene


def provenance(scene: Scene) -> dict[str, Any]:
    """What a result must say of the run behind it."""
    record = json.loads((scene.out / "run" / "run.json").read_text())
    cpu = scene.out / "run" / "cpu.json"
    kept = ("scene_hash", "cells", "time_step", "steps", "end_time", "courant_max", "continuity_max")
    spent = json.loads(cpu.read_text()) if cpu.exists() else {}
    settings = scene.model_dump(mode="json", include={"mesh", "numerics", "fluid", "body"})
    return {
        "versions": {"OpenFOAM": record["versions"]["OpenFOAM"]},
        "level": scene.level,
        **{k: record[k] for k in kept},
        "power_balance_closure": record["power_balance"]["closure_fraction"],
        **spent,
        "settings": settings,
    }


def reference(name: str, folder: Path = CASES) -> dict[str, Any]:
    """The reference data beside a scene, cases/validation/<name>/reference.toml."""
    return tomllib.loads((folder / name / "reference.toml").read_text(encoding="utf-8"))


def forces(scene: Scene) -> Forces:
    """run/forces.csv per metre of the body's depth, N/m."""
    assert scene.body is not None
    path = scene.out / "run" / "forces.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    columns = (table[n] / scene.body.depth for n in ("fx", "fy", "fx_viscous", "fy_viscous"))
    return Forces(table["time"], *columns)
