"""What the project's own stages wrote of a scene of cases/validation; the studies there make the runs (make validate)."""

from __future__ import annotations

import json
import resource
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fileio.errors import StageError
from fileio.provenance import read_settings
from fileio.stages import until
from pipeline.scene.scene import Scene, load_scene
from pipeline.stage_settings import settings_of

CASES = Path(__file__).resolve().parents[3] / "cases" / "validation"
STAGES = [stage.name for stage in until("sheet")]


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


def solved(name: str, level: str = "coarse", folder: Path = CASES) -> Scene:
    """The scene, whose run is there. StageError where it is not, or is of other numbers."""
    scene = load_scene(folder / name, level)
    record = scene.out / "run" / "run.json"
    if not record.exists() or not (scene.out / "sheet.h5").exists():
        raise StageError(
            f"{scene.out}: {name} was not run at level {level}; run make validate, which makes the runs first"
        )
    templates = read_settings(scene.out / "sweep.h5") == settings_of(scene, "case")
    if not templates or json.loads(record.read_text())["scene_hash"] != scene.digest():
        raise StageError(
            f"{record}: of other numbers than {name} has now; run make validate, which makes the run again"
        )
    return scene


def spent(scene: Scene) -> dict[str, float]:
    """CPU seconds of all stages of a run; empty where one of them kept no account."""
    paths = [scene.out / "costs" / f"{stage}.json" for stage in STAGES]
    if not all(path.exists() for path in paths):
        return {}
    return {
        "cpu_seconds": round(sum(json.loads(path.read_text())["cpu_time"] for path in paths), 1)
    }


def provenance(scene: Scene) -> dict[str, Any]:
    """What a result must say of the run behind it."""
    record = json.loads((scene.out / "run" / "run.json").read_text())
    kept = (
        "scene_hash",
        "cells",
        "time_step",
        "steps",
        "end_time",
        "courant_max",
        "continuity_max",
    )
    settings = scene.model_dump(mode="json", include={"mesh", "numerics", "fluid", "body"})
    return {
        "versions": {"OpenFOAM": record["versions"]["OpenFOAM"]},
        "level": scene.level,
        **{k: record[k] for k in kept},
        "power_balance_closure": record["power_balance"]["closure_fraction"],
        **spent(scene),
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
