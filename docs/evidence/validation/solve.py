"""Runs of the scenes of cases/validation, which `make validate` makes by the project's stages."""

import json
import resource
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.runs.run import run_of
from pipeline.runs.stages import until
from pipeline.scene.scene import Scene
from piv.files.errors import StageError
from piv.files.record import read_record
from softfinger.study.plan import describe
from softfinger.study.rows import read_study

CASES = Path(__file__).resolve().parents[3] / "cases" / "validation"
RECORDED = ("cells", "time_step", "steps", "end_time", "courant_max", "continuity_max")


@dataclass(frozen=True)
class Forces:
    """Total and viscous force of the water on the body, N/m, over time in s."""

    time: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    fx_viscous: np.ndarray
    fy_viscous: np.ndarray


def cpu_seconds() -> float:
    """CPU time of this process and the children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def record_of(scene: Scene) -> dict[str, Any]:
    """run/run.json."""
    return json.loads((scene.out / "run" / "run.json").read_text())


def solved(row: str, study: str = "validation", stage: str = "sheet") -> Scene:
    """The scene of a row of a study, made up to a stage; StageError where one is stale."""
    table = CASES / "studies" / f"{study}.csv"
    rows = {one.run: one for one in read_study(table)}
    run = run_of(describe(CASES, study, rows[row]))
    for late, why in run.stale(stage).items():
        raise StageError(f"{run.out}: {late}: {why}; run softfinger study {table}")
    return run.scene


def stage_versions(last: str) -> dict[str, int]:
    """Versions of the stages of a prescribed run up to the last one."""
    return {stage.name: stage.version for stage in until(last)}


def _spent(scene: Scene) -> dict[str, float]:
    """CPU seconds of all stages of a run; empty where one has no record."""
    records = [read_record(scene.out, stage.name) for stage in until("sheet")]
    seconds = [record["cpu_time"] for record in records if record]
    return {"cpu_seconds": round(sum(seconds), 1)} if len(seconds) == len(records) else {}


def provenance(scene: Scene) -> dict[str, Any]:
    """Origin of a result: versions, size, limits, cost and settings of the run."""
    record = record_of(scene)
    return {
        "versions": {"OpenFOAM": record["versions"]["OpenFOAM"]},
        "level": scene.level,
        "stages": stage_versions("sheet"),
        **{key: record[key] for key in RECORDED},
        "power_balance_closure": record["power_balance"]["closure_fraction"],
        **_spent(scene),
        "settings": scene.model_dump(mode="json", include={"mesh", "numerics", "fluid", "body"}),
    }


def reference(name: str) -> dict[str, Any]:
    """The reference data of a scene, cases/validation/<name>/reference.toml."""
    return tomllib.loads((CASES / name / "reference.toml").read_text(encoding="utf-8"))


def law_and_body(scene: Scene) -> tuple[Any, Any]:
    """Law of motion and body of a scene with a rigid body."""
    return scene.motion.displacement or scene.motion.rotation, scene.body


def forces(scene: Scene) -> Forces:
    """run/forces.csv per metre of the body's depth."""
    _, body = law_and_body(scene)
    table = np.genfromtxt(scene.out / "run" / "forces.csv", delimiter=",", names=True)
    columns = (table[n] / body.depth for n in ("fx", "fy", "fx_viscous", "fy_viscous"))
    return Forces(table["time"], *columns)
