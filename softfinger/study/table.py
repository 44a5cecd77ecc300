"""A study's runs as one tidy table: a row per run, the unit at the end of each column's name."""

import json
import subprocess
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.formats import bending_states
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import FORCES, RUN, STUDY_PLAN
from pipeline.runs.run import Run, run_of
from pipeline.runs.stages import BY_NAME, COUPLED, until
from piv.files.errors import StageError
from piv.files.record import read_record, record_path
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import MIDDLE, stroke_window
from postprocess.tables import write_table as write_csv

_MB = 1e-6
_IMPACT = 0.05  # s
# not tables that runs write: cases/*/studies/results
_SOURCES = ("*.py", "*.toml", "*.lock", "Makefile", "piv", "pipeline", "postprocess", "softfinger",
            "cases/_base", "cases/*.h5", ":(glob)cases/*/*/*.csv", ":!tests/*.py")  # fmt: skip
_SHARED = ["fea", *(stage.name for stage in until("vortices"))]


def read_plan(path: Path) -> dict[str, Any]:
    """plan.json of a study (docs/formats.md)."""
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing; run the study with make study STUDY=… first")
    return STUDY_PLAN.read(path)


def origin(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """What a table of a plan's `runs` was made from: date, commit, and the stages' versions.

    The version of a coupled run's own stage is that of `<stage>_coupled`.
    """
    stages: dict[str, int] = {}
    for row in runs:
        with suppress(StageError):  # it was refused
            run = run_of(row)
            for name in (stage.name for stage in until(row["until"])):
                kind = "_coupled" if run.scene.coupled and name in COUPLED else ""
                stages[f"{name}{kind}"] = run.stage(name).version
    date = datetime.now(UTC).date().isoformat()
    return {"made": date, "commit": commit(), "stages": dict(sorted(stages.items()))}


def commit() -> str:
    """The last commit that changed code, scenes or tables of runs; "" without git.

    It ends with "-dirty" where these were changed since.
    """
    home = Path(__file__).parents[2]

    def git(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["git", *words], cwd=home, capture_output=True, text=True)

    with suppress(OSError):
        name = git("log", "-1", "--format=%h", "--", *_SOURCES).stdout.strip()
        changed = git("diff", "--quiet", "HEAD", "--", *_SOURCES).returncode == 1
        return f"{name}-dirty" if changed else name
    return ""


def files_of(row: dict[str, Any]) -> StageFiles:
    """The files of one run of a plan."""
    return StageFiles(run_of(row).scene)


def missing_runs(plan: dict[str, Any]) -> dict[str, str]:
    """By name the runs of a plan that are not finished as it asks for, and why."""
    reasons: dict[str, str] = {}
    for row in plan["runs"]:
        if not record_path(Path(row["out"]), "").parent.is_dir():
            reasons[row["run"]] = "not made yet"  # without reading its scene
            continue
        if row["may_fail"]:
            if read_record(Path(row["out"]), "outcome") is None:
                reasons[row["run"]] = "outcome: not made yet"
            continue
        stale = run_of(row).stale(row["until"])
        if stale:
            stage, why = next(iter(stale.items()))
            reasons[row["run"]] = f"{stage}: {why}"
    return reasons


def stage_costs(out: Path, stages: list[str]) -> tuple[dict[str, float], float]:
    """CPU seconds of the finished stages, `cpu_<stage>_s`, and their largest memory (MB)."""
    records = {stage: read_record(out, stage) for stage in stages}
    made = {stage: record for stage, record in records.items() if record}
    seconds = {f"cpu_{n}_s": float(r["cpu_time"]) for n, r in made.items()}
    return seconds, max((r["peak_memory"] * _MB for r in made.values()), default=0.0)


def _costs(files: StageFiles, fresh: list[str]) -> dict[str, float]:
    """`stage_costs` of the fresh stages up to the vortices, and their sum."""
    seconds, memory = stage_costs(files.out, [stage for stage in _SHARED if stage in fresh])
    return seconds | {"cpu_total_s": sum(seconds.values()), "peak_memory_MB": memory}


def _solver(files: StageFiles) -> dict[str, Any]:
    """Read size, steps, largest force, impulse and the parts of the work from a run/ folder."""
    path = files.optional("run/run.json")
    if path is None:
        return {}
    run = RUN.read(path)
    force = FORCES.read(files.required("run/forces.csv", "solve"))
    size = np.hypot(force["fx"], force["fy"])
    keys = ("model", "ranks", "cells", "steps", "courant_max")
    balance = run["power_balance"]
    parts = {"kinetic": balance["kinetic_energy"], "unexplained": balance["unexplained"]}
    parts |= {name: balance["taken"][name] for name in ("viscous", "convection", "coupling")}
    work = abs(balance["work"]) or 1.0  # a finger at rest does none
    coupled = {}
    if (path := files.optional(str(FILE))) is not None:
        motion = read_elastic_motion(path)
        coupled = {"tip_change_m": motion.attrs["tip_change"]}
        coupled |= {name: motion.attrs[name] for name in ("open_energy", "moment_share")}
        if motion["contact_force"].any():
            coupled |= _contact(files, motion["time"].values, motion["contact_force"].values)
    return (
        {key: run[key] for key in keys}
        | coupled
        | {
            "time_step_s": run["time_step"],
            "end_time_s": run["end_time"],
            "wall_run_s": run["wall_time"],
            "peak_force_N": float(size.max()),
            "impulse_x_Ns": float(np.trapezoid(force["fx"], force["time"])),
            "impulse_y_Ns": float(np.trapezoid(force["fy"], force["time"])),
            "work_J": balance["work"],
            **{f"{name}_part": value / work for name, value in parts.items()},
            "openfoam": run["versions"].get("OpenFOAM", ""),
        }
    )


def _contact(files: StageFiles, time: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Largest force (N), impulse (N s) of the first _IMPACT s, and rebound (m) of a contact."""
    path = files.numbers.motion_folder / "kinematics.h5"
    gap = read_kinematics(path).data["shape_gap"].values
    first = int(np.argmax(force > 0))
    of_impact = time <= time[first] + _IMPACT
    return {
        "contact_force_N": float(force.max()),
        "contact_impulse_Ns": float(force[of_impact].sum() * (time[1] - time[0])),
        "rebound_m": float((gap - np.minimum.accumulate(gap))[first:].max()),
    }


def middle_of_stroke(files: StageFiles) -> tuple[float, float]:
    """Instants (s) between which the finger does the middle half of its bend."""
    kinematics = read_kinematics(files.numbers.motion_folder / "kinematics.h5")
    times = np.linspace(*kinematics.time, 101)
    return stroke_window(times, kinematics.bend(kinematics.law(times)), MIDDLE)


def _vortex(files: StageFiles, fresh: list[str]) -> dict[str, Any]:
    """Means of the tip vortex in mid-stroke, by source."""
    tables = {
        source: tracks.read_vortices(files.out / f"vortices_{source}.csv")
        for source in ("cfd", "piv")
        if f"vortices_{source}" in fresh
    }
    if not tables:
        return {}
    window = middle_of_stroke(files)
    tips = tracks.dominant_tracks(tables, 0, window)  # without a vortex the cells stay empty
    units = {"circulation": "m2_per_s", "peak_vorticity": "per_s"}
    return {
        f"{column}_{source}_{units.get(column, 'm')}": means[column]
        for source, means in tracks.common_means(tips, window).items()
        for column in tracks.COMPARED
    }


def _outcome(out: Path) -> dict[str, Any]:
    """Say how a run that may fail ended."""
    record = read_record(out, "outcome") or {}
    return {key: record[key] for key in ("ended", "stopped_at_s", "reason") if key in record}


def _bending(out: Path) -> dict[str, Any]:
    """Range of pressure and bend that the bending analysis of another actuator gave, if any."""
    path = out / BY_NAME["fea"].done
    if not path.exists():
        return {}
    states = bending_states.read(path)
    pressure, bend = states.pressure, states.bend_angle
    return {
        "states": len(pressure),
        "pressure_min_Pa": float(pressure[0]),
        "pressure_max_Pa": float(pressure[-1]),
        "bend_min_rad": float(bend[0]),
        "bend_max_rad": float(bend[-1]),
    }


def _fresh(run: Run, last: str) -> list[str]:
    """The stages up to the last one whose record follows from this run."""
    chain = [*(["fea"] if run.analysed else []), *(stage.name for stage in until(last))]
    records = {stage: read_record(run.out, stage) for stage in chain}
    return [
        stage
        for stage, record in records.items()
        if record and record["digest"] == run.digest(stage)
    ]


def study_table(plan: dict[str, Any], missing: dict[str, str]) -> pd.DataFrame:
    """One row per run of the plan: overrides, costs and results, or why they are `missing`."""
    rows = []
    for row in plan["runs"]:
        out = Path(row["out"])
        varied = {
            key: json.dumps(v) if isinstance(v, list | dict) else v
            for key, v in row["overrides"].items()
        }
        head = {"run": row["run"], "level": row["level"], "until": row["until"]}
        cells = head | varied | _outcome(out) | _bending(out)
        if row["run"] in missing:
            rows.append(cells | {"missing": missing[row["run"]]})
            continue
        try:
            run = run_of(row)
        except StageError:
            rows.append(cells)  # refused, which is its result
            continue
        files, fresh = StageFiles(run.scene), _fresh(run, row["until"])
        cells |= _solver(files) if "solve" in fresh else {}
        cells |= _vortex(files, fresh)
        rows.append(cells | _costs(files, fresh))
    return pd.DataFrame(rows)


def write_table(path: Path) -> Path:
    """Write table.csv beside the plan of a study; returns its path."""
    plan = read_plan(path)
    target = path.with_name("table.csv")
    write_csv(target, study_table(plan, missing_runs(plan)))
    return target
