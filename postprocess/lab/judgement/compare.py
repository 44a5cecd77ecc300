"""The step `compare`: evaluate both sides alike, judge every quantity, write the tables."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fileio.atomic import sha256, write_text
from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.plane_series import read_plane
from fileio.formats.records import LAB_COMPARISON, RUN
from fileio.provenance import versions
from piv.vortices.find import VortexSettings
from postprocess.lab.data.dpiv_toml import NAME, Dpiv
from postprocess.lab.data.files import LabFiles, Registration, read_registration
from postprocess.lab.data.inputs_toml import Inputs, read_inputs
from postprocess.lab.data.pose import camera_series
from postprocess.lab.judgement import validation as budget
from postprocess.lab.judgement.case import Case
from postprocess.lab.judgement.clock import check_clock
from postprocess.lab.judgement.flow import effect_of, flow_quantities, tables
from postprocess.lab.judgement.measures import measure
from postprocess.lab.judgement.motion import at_recorded_motion, motion_quantities
from postprocess.lab.judgement.validation import ValidatedQuantity
from postprocess.lab.registration.step import fea_band, registration_summary
from postprocess.lab.virtual.common_grid import CommonGrid, on_common_grid

MOTION = ("final_bend", "duration")  # what the silhouette shows
# Of the tip's width: smoothing length, of which the circle of the circulation has three. Wider than
# where a vortex is found in one flow, since meshes and windows then change less of it.
WIDE = 2 / 9
LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "opencv-python-headless", "numba")
COPIED = (
    "name",
    "label",
    "unit",
    "simulation",
    "data",
    "error",
    "finer",
    "scale",
    "u_val",
    "window",
)
UNCERTAINTIES = ("u_num", "u_input", "u_D", "u_val")
COMPONENTS = ("simulation", "data", "finer", "explained_by_motion", "error", *UNCERTAINTIES)


def run_comparison(
    files: LabFiles, dpiv: Dpiv, *, seed: int = 1, threads: int = 1, quiet: bool = True
) -> dict[str, Any]:
    """Evaluate both sides alike, compare, and write comparison.json and tables."""
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    inputs = read_inputs(files.stage.scene_folder)
    registration = read_registration(files.registration)
    planes = on_common_grid(
        files, dpiv, kinematics, registration, seed=seed, threads=threads, quiet=quiet
    )
    case = _make_case(files, dpiv, kinematics, registration, planes, inputs)
    check_clock(case)
    result, series = compare(case, inputs)
    made = {e.name for e in case.effects}
    run = RUN.read(files.stage.required("run/run.json", "run"))
    result |= {
        "scene": files.stage.scene,
        "level": files.stage.level,
        "data": dpiv.title,
        "missing_runs": [one.name for one in inputs.all if one.name not in made],
        "appearance": planes.appearance,
        "provenance": {
            "versions": versions(*LIBRARIES) | run.get("versions", {}),
            "dpiv_sha256": sha256(dpiv.folder / NAME),
            "seed": seed,
            "settings": {"dpiv": dpiv.model_dump(mode="json", exclude={"folder"})},
        },
    }
    LAB_COMPARISON.write(files.comparison, result)
    write_text(files.folder / "comparison.csv", quantity_table(result).to_csv(index=False))
    write_text(files.folder / "series.csv", series.to_csv(index=False))
    return result


def _make_case(
    files: LabFiles,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    planes: CommonGrid,
    inputs: Inputs,
) -> Case:
    """What is compared, with the effects of the runs seen through this recording's pose."""
    settings = files.stage.numbers.vortices.model_dump(mode="json")
    pose = registration.pose
    px = pose.pixel  # m; of vectors the picture's unit is the stated metre
    window = dpiv.piv.window * (px * dpiv.scale.pixel if dpiv.kind == "vectors" else px)
    # one scale for all sides, although their windows differ
    scale = settings["scale"] or max(WIDE * kinematics.tip_width, 0.5 * window)
    vortices = VortexSettings(**settings | {"scale": scale, "correlation_length": window})
    fresh = dpiv.kind == "vectors" or dpiv.piv.pairing == "1-2,3-4"
    sides = planes.data, planes.virtual, planes.direct, vortices
    case = Case(kinematics, registration, *sides, window, *fea_band(files, dpiv), fresh)
    x, y = (case.direct[name].values for name in ("x", "y"))

    def seen(path: Path, times: np.ndarray | None = None) -> xr.Dataset:
        with read_plane(path) as sheet:
            whole = sheet.load()
        return camera_series(whole, pose, x, y, whole["time"].values if times is None else times)

    made = [one for one in inputs.all if files.run_sheet(one.name).exists()]
    for k, one in enumerate(made):
        plane = seen(files.run_sheet(one.name))
        if k == 0:
            nominal = measure(case, seen(files.sheet, plane["time"].values), "direct")
        run = read_kinematics(files.stage.out / "inputs" / one.name / "kinematics.h5")
        case.effects.append(effect_of(one, plane, nominal, run, case))
    return case


def compare(case: Case, inputs: Inputs) -> tuple[dict[str, Any], pd.DataFrame]:
    """Verdicts, and series over time.

    The flow is judged at the recording's own motion, where its effect is known.
    """
    case = at_recorded_motion(case)
    measured = tables(case)
    quantities = [*motion_quantities(case), *flow_quantities(case, measured)]
    level = budget.joint_level(len(quantities))
    judged = [_judged(q, inputs.too_uncertain, level) for q in quantities]
    moves, flows = motion_verdict(judged), flow_verdict(judged)
    result = {
        "verdict": overall_verdict(moves, flows),
        "motion": moves,
        "flow": flows,
        "too_uncertain": inputs.too_uncertain,
        "wrong": [q["name"] for q in judged if q["verdict"] == budget.ERROR],
        "window_s": next(q.window for q in quantities if q.name == "circulation"),
        "quantities": judged,
        "registration": registration_summary(case.registration),
    }
    return result, _series_table(case, measured)


def motion_verdict(judged: list[dict[str, Any]]) -> str | None:
    """Whether the finger moves as simulated; None where that was not tested."""
    motion = [q for q in judged if q["name"] in MOTION]
    words = {q["verdict"] for q in motion}
    if not motion:
        return None
    if budget.ERROR not in words and any(q["differs"] for q in motion):
        return budget.DIFFERS
    return next(word for word in (budget.ERROR, budget.UNCERTAIN, budget.AGREES) if word in words)


def flow_verdict(judged: list[dict[str, Any]]) -> str:
    """Whether the flow is as simulated; it agrees only where its circulation is decided."""
    words = {q["name"]: q["verdict"] for q in judged if q["name"] not in MOTION}
    return budget.ERROR if budget.ERROR in words.values() else words["circulation"]


def overall_verdict(motion: str | None, flow: str) -> str:
    """The page's colour: the worse of the two answers."""
    order = (budget.ERROR, budget.DIFFERS, budget.UNCERTAIN, budget.AGREES)
    return next(word for word in order if word in (motion, flow))


def _judged(q: ValidatedQuantity, too_uncertain: float, level: float) -> dict[str, Any]:
    return {
        **{name: getattr(q, name) for name in COPIED},
        "explained_by_motion": q.explained,
        "u_instant": q.instant,
        "k": budget.coverage_factor(q.error.size, level),
        **{symbol: q.u_kind(kind) for kind, symbol in budget.KINDS.items()},
        "significance": q.significance(),
        "verdict": q.verdict(too_uncertain, level),
        "detectable": q.detectable(level),
        "differs": q.name in MOTION and q.differs(level),
        "dominant": q.dominant.name,
        "sources": [asdict(s) for s in q.sources],
    }


def _series_table(case: Case, measured: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Every quantity of every side over time (s of the simulation), with the bend angles."""
    out = pd.DataFrame({"time": case.direct["time"].values})
    out["bend_deg_direct"] = np.degrees(case.direct["bend"].values[:, 0])
    out["bend_deg_data"] = np.degrees(case.data["bend"].values[:, 0])
    for name, table in measured.items():
        for column in table.columns.drop("time"):
            out[f"{column}_{name}"] = table[column].to_numpy()
    return out


def quantity_table(result: dict[str, Any]) -> pd.DataFrame:
    """One row per quantity and component, SI.

    The part that the motion explains is empty where it is not known; it is then not taken out.
    """
    rows = []
    for q in result["quantities"]:
        for k, axis in enumerate(("x", "y") if len(q["error"]) == 2 else ("",)):
            row = {"quantity": q["name"], "component": axis, "unit": q["unit"]}
            row |= {name: None if q[name] is None else float(q[name][k]) for name in COMPONENTS}
            row |= {"k": q["k"], "verdict": q["verdict"], "dominant_source": q["dominant"]}
            rows.append(row)
    return pd.DataFrame(rows)
