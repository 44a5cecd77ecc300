"""Registration of a laboratory's data, and their comparison with the simulation: registration.json, comparison.json, tables."""

from __future__ import annotations

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from piv.plane import read_plane
from piv.vortices import VortexSettings
from postprocess.lab import budget
from postprocess.lab.budget import FieldComparison, Quantity, Source
from postprocess.lab.dpiv import NAME, Dpiv, Start, read_dpiv
from postprocess.lab.errors import (
    Case,
    Effect,
    common_rows,
    effect_of,
    field_comparison,
    flow_quantities,
    motion_quantities,
    tables,
)
from postprocess.lab.family import Family, read_family
from postprocess.lab.files import LabFiles, read_registration, write_registration
from postprocess.lab.inputs import Inputs, read_inputs, run_folder
from postprocess.lab.measures import measure
from postprocess.lab.pictures import LabRecording, stated_pose
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.registration import Law, Registration, register
from postprocess.lab.sides import Sides, lab_vectors, simulation_sides
from postprocess.stagefiles import StageFiles, read_json, sha256, write_text
from postprocess.strokes import stroke_window

VIEW_MARGIN = 0.008  # m of the sheet beyond the picture
MIDDLE = (0.25, 0.75)  # of the change of bend: as for the comparison with the virtual PIV


def lab_files(case: Path, level: str, dpiv: Path) -> tuple[LabFiles, Dpiv]:
    """Paths of a comparison and what the laboratory states."""
    stated = read_dpiv(dpiv)
    return LabFiles(StageFiles(case, level), stated.name), stated


def run_registration(files: LabFiles, dpiv: Dpiv, seed: int = 1) -> Registration:
    """Register the data and write registration.json and view.txt."""
    family = read_family(files.stage.required("kinematics.h5", "kinematics"))
    stated_delay = -dpiv.start.at_s if isinstance(dpiv.start, Start) else None
    if dpiv.kind == "vectors":
        registration, size = _stated_registration(dpiv, family), _size_of_vectors(dpiv)
    else:
        recording = LabRecording(dpiv)
        try:
            stated, scale_std = stated_pose(dpiv, recording, family.root)
            assert recording.times is not None
            registration = register(
                recording,
                recording.times,
                family,
                stated,
                stated_delay,
                scale_std=scale_std,
                paired=dpiv.piv.pairing == "1-2,3-4",
                seed=seed,
            )
            size = (float(recording.shape[1]), float(recording.shape[0]))
        finally:
            recording.close()
    view = registration.pose.view(size, VIEW_MARGIN)
    write_registration(
        registration, files.registration, dpiv_sha256=sha256(dpiv.folder / NAME), seed=seed, view=view
    )
    text = " ".join(f"{v:.3f}" for v in view) + "\n"
    if not files.view.exists() or files.view.read_text(encoding="utf-8") != text:
        write_text(files.view, text)  # the sheets depend on it
    return registration


def _stated_registration(dpiv: Dpiv, family: Family) -> Registration:
    """Of vectors: what dpiv.toml states, with the uncertainties that it states. The picture's unit is the stated metre."""
    axes, start = dpiv.axes, dpiv.start
    assert isinstance(start, Start)
    assert axes.root_mm
    assert axes.root_std_mm
    assert dpiv.scale.std_percent
    x, y = np.array(axes.root_mm) * 1e-3
    if axes.y == "down":  # counted from the top of the picture where the vectors are in px
        rows = dpiv.vectors.image_rows if dpiv.vectors else None
        y = -y if rows is None else (rows - 1) * (dpiv.scale.mm_per_px or 0.0) * 1e-3 - y
    at = (-x if axes.x == "left" else x, y)
    scale = dpiv.scale.std_percent / 100
    turn = axes.root_std_mm * 1e-3 / family.length  # a root so uncertain over the finger's length
    covariance = np.diag([axes.root_std_mm * 1e-3, axes.root_std_mm * 1e-3, turn, scale]) ** 2
    pose = Pose(1.0, float(np.radians(axes.turn_deg)), family.root, (float(at[0]), float(at[1])))
    law = Law(np.array([1.0, -start.at_s, 1.0]), np.diag([0.0, start.std_s**2, 0.0]), 0.0)
    return Registration(pose, covariance, 0.0, law, np.empty(0), np.empty(0), np.empty(0), pose)


def _size_of_vectors(dpiv: Dpiv) -> tuple[float, float]:
    plane = lab_vectors(dpiv)
    return float(plane["x"][-1] + plane["x"][0]), float(plane["y"][-1] + plane["y"][0])


def effects_of_runs(files: LabFiles, inputs: Inputs, case: Case) -> list[Effect]:
    """What each run beside the nominal one changes; runs that were not made are left out."""
    pose = case.registration.pose
    x, y, times = (case.direct[name].values for name in ("x", "y", "time"))
    nominal = measure(case.direct, pose, case.vortices, case.window, "direct")
    found = []
    for one in inputs.all:
        sheet_path = files.run_sheet(one.name)
        if not sheet_path.exists():
            continue
        with read_plane(sheet_path) as sheet:
            plane = camera_series(sheet.load(), pose, x, y, times)
        run = read_family(run_folder(files.stage, one.name) / "out" / files.stage.level / "kinematics.h5")
        found.append(effect_of(one, plane, run, case, nominal))
    return found


def run_comparison(
    files: LabFiles, dpiv: Dpiv, *, seed: int = 1, threads: int = 1, quiet: bool = True
) -> dict[str, Any]:
    """Evaluate both sides alike, compare, and write comparison.json, comparison.csv, series.csv and fields.h5."""
    family = read_family(files.stage.required("kinematics.h5", "kinematics"))
    inputs = read_inputs(files.stage.case / "reference" / "inputs.toml")
    registration = read_registration(files.registration)
    sides = simulation_sides(files, dpiv, family, registration, seed=seed, threads=threads, quiet=quiet)
    case = make_case(files, dpiv, family, registration, sides, inputs)
    result, series, field = compare(case, inputs)
    result |= {
        "scene": files.stage.scene,
        "level": files.stage.level,
        "data": dpiv.title,
        "name": dpiv.name,
        "kind": dpiv.kind,
        "finger_geometry": dpiv.finger_geometry,
        "missing_runs": [n for n in inputs.names if n not in {e.name for e in case.effects}],
        "appearance": sides.appearance,
        "provenance": _provenance(files, dpiv, seed),
    }
    write_text(files.comparison, json.dumps(result, indent=1, default=_plain) + "\n")
    write_text(files.folder / "comparison.csv", quantity_table(result).to_csv(index=False))
    write_text(files.folder / "series.csv", series.to_csv(index=False))
    _write_fields(files.folder / "fields.h5", case, field, result["rows"], sides.picture)
    return result


def make_case(
    files: LabFiles, dpiv: Dpiv, family: Family, registration: Registration, sides: Sides, inputs: Inputs
) -> Case:
    """The case that budgets are made of, with the effects of the runs."""
    settings = read_json(files.stage.required("settings/vortices.json", "settings"))
    times = sides.direct["time"].values
    window = stroke_window(times, sides.direct["bend"].values[:, 0].astype(float), MIDDLE)
    with h5py.File(files.stage.out / "kinematics.h5", "r") as file:
        source = str(np.ravel(file.attrs["source"])[0])
        bend_std = float(file["bend_std"][-1]) if "bend_std" in file else 0.0
    geometry = dpiv.finger_geometry == "nominal" and source != "recording"  # a measured motion holds both
    if geometry and bend_std == 0:
        raise ValueError(
            f"{files.stage.out / 'kinematics.h5'}: carries no bend_std, so the bands of the FEA are not known; run make fea, or state"
            ' finger_geometry = "measured" in dpiv.toml'
        )
    px = 1 / registration.pose.px_per_m  # m; of vectors the picture's unit is the stated metre
    if dpiv.kind == "vectors":
        px *= (dpiv.scale.mm_per_px or 0.0) * 1e-3
    window_m = dpiv.piv.window * px
    case = Case(
        family,
        registration,
        sides.data,
        sides.virtual,
        sides.direct,
        window,
        VortexSettings(**settings),
        window_m,
        geometry,
        bend_std,
    )
    case.effects.extend(effects_of_runs(files, inputs, case))
    return case


def compare(case: Case, inputs: Inputs) -> tuple[dict[str, Any], pd.DataFrame, FieldComparison]:
    """Verdicts, series over time, and the field."""
    found = tables(case)
    rows = common_rows(found, case.window)
    quantities = motion_quantities(case, inputs) if case.registration.times.size else []
    quantities += flow_quantities(case, found, rows)
    field = field_comparison(case, rows)
    joint = budget.joint_level(len(quantities) + 1)
    judged = [_judged(q, inputs.too_uncertain, joint) for q in quantities]
    judged.append(_judged_field(field, case, rows, inputs.too_uncertain, joint))
    wrong = [q["name"] for q in judged if q["joint_verdict"] == budget.ERROR]
    unsaid = [q["name"] for q in judged if q["verdict"] == budget.UNCERTAIN]
    verdict = budget.ERROR if wrong else budget.AGREES if len(unsaid) < len(judged) / 2 else budget.UNCERTAIN
    registration = case.registration
    result = {
        "format": "lab-comparison",
        "format_version": 1,
        "verdict": verdict,
        "wrong": wrong,
        "window_s": case.window,
        "instants": int(rows.sum()),
        "rows": np.flatnonzero(rows),
        "quantities": judged,
        "registration": registration_summary(registration, case.family),
    }
    return result, series_table(case, found), field


def _judged(q: Quantity, too_uncertain: float, joint: float) -> dict[str, Any]:
    return {
        "name": q.name,
        "label": q.label,
        "unit": q.unit,
        "simulation": q.simulation,
        "direct": q.direct,
        "data": q.data,
        "error": q.error,
        "measurement_part": q.measurement_part,
        "explained_by_motion": q.explained,
        "scale": q.scale,
        "u_val": q.u_val,
        "k": budget.coverage_factor(q.error.size),
        **{symbol: q.u_kind(kind) for kind, symbol in budget.KINDS.items()},
        "significance": q.significance(),
        "verdict": q.verdict(too_uncertain),
        "joint_verdict": q.verdict(too_uncertain, joint),
        "dominant": q.dominant.name,
        "sources": [_told(s) for s in q.sources],
    }


def _told(source: Source) -> dict[str, Any]:
    return {"name": source.name, "kind": source.kind, "std": source.std, "how": source.how}


def _judged_field(
    field: FieldComparison, case: Case, rows: np.ndarray, too_uncertain: float, joint: float
) -> dict[str, Any]:
    parts = field.parts()
    rms = field.rms()

    def size(plane):
        return float(np.sqrt(np.nanmean(plane["u"].values[rows] ** 2 + plane["v"].values[rows] ** 2)))

    sides = {"data": case.data, "direct": case.direct, "simulation": case.virtual or case.direct} if case.virtual is None else {
        "data": case.data, "direct": case.direct, "simulation": case.virtual}  # fmt: skip
    values = {name: np.array([size(plane)]) for name, plane in sides.items()}
    kinds = {
        kind: np.array([np.sqrt(sum(v**2 for k, v in parts.values() if k == kind))]) for kind in budget.KINDS
    }
    direct = np.stack([case.direct["u"].values, case.direct["v"].values], 1)[rows]
    measured = np.stack([case.data["u"].values, case.data["v"].values], 1)[rows]
    allowed = {level: field.allowed_rms(level) for level in (budget.LEVEL, joint)}
    word = lambda level: (  # noqa: E731
        budget.ERROR
        if rms > allowed[level]
        else budget.UNCERTAIN
        if allowed[level] > too_uncertain * values["data"][0]
        else budget.AGREES
    )
    u_val = np.array([np.sqrt(sum(v**2 for _, v in parts.values()))])
    return {
        "name": "velocity_field",
        "label": "velocity field (RMS of the difference)",
        "unit": "m/s",
        **values,
        "error": np.array([rms]),
        "direct_error": float(np.sqrt(np.nanmean(np.sum((direct - measured) ** 2, axis=1)))),
        "measurement_part": None,
        "explained_by_motion": None,
        "scale": values["data"][0],
        "u_val": u_val,
        "k": allowed[budget.LEVEL] / float(u_val[0]),
        **{symbol: kinds[kind] for kind, symbol in budget.KINDS.items()},
        "significance": rms / float(u_val[0]),
        "verdict": word(budget.LEVEL),
        "joint_verdict": word(joint),
        "dominant": max(parts, key=lambda n: parts[n][1]),
        "sources": [
            {"name": n, "kind": k, "std": np.array([v]), "how": "RMS over the field"}
            for n, (k, v) in parts.items()
        ],
        "model_error_rms": float(np.sqrt(max(rms**2 - float(u_val[0]) ** 2, 0.0))),
    }


def registration_summary(registration: Registration, family: Family) -> dict[str, Any]:
    """What was found, beside what was stated, in the units of a laboratory."""
    pose, law, stated = registration.pose, registration.law, registration.stated
    std = np.sqrt(np.diag(registration.covariance))
    mm = 1e3 / pose.px_per_m
    found = {
        "scale_mm_per_px": mm,
        "scale_std_percent": 100 * float(std[3]),
        "turn_deg": float(np.degrees(pose.angle)),
        "turn_std_deg": float(np.degrees(std[2])),
        "root_px": pose.at_px,
        "root_std_mm": [float(s) * mm for s in std[:2]],
        "delay_ms": law.delay * 1e3,
        "delay_std_ms": law.std("delay") * 1e3,
        "pressure_factor": float(law.values[0]),
        "pressure_factor_std": law.std("factor"),
        "stretch": float(law.values[2]),
        "stretch_std": law.std("stretch"),
        "misfit_deg": float(np.degrees(abs(family.splines["bend"](family.high, 1)) * law.misfit)),
    }
    if stated is not None:
        off = (np.asarray(pose.at_px) - stated.at_px) * mm
        found |= {
            "scale_against_stated_percent": 100 * (stated.px_per_m / pose.px_per_m - 1),
            "turn_against_stated_deg": float(np.degrees(pose.angle - stated.angle)),
            "root_against_stated_mm": [float(v) for v in off],
        }
    return found


def series_table(case: Case, found: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Every quantity of every side over time (s of the simulation), with the bend angles."""
    out = pd.DataFrame({"time": case.direct["time"].values})
    out["bend_deg_direct"] = np.degrees(case.direct["bend"].values[:, 0])
    out["bend_deg_data"] = np.degrees(case.data["bend"].values[:, 0])
    for name, table in found.items():
        for column in table.columns.drop("time"):
            out[f"{column}_{name}"] = table[column].to_numpy()
    return out


def quantity_table(result: dict[str, Any]) -> pd.DataFrame:
    """One row per quantity and component, for a paper's table: S, D, E, u's and the verdict, SI."""
    rows = []
    for q in result["quantities"]:
        for k, axis in enumerate(("x", "y") if len(q["error"]) == 2 else ("",)):
            rows.append(
                {
                    "quantity": q["name"],
                    "component": axis,
                    "unit": q["unit"],
                    **{
                        name: q[name][k]
                        for name in (
                            "simulation",
                            "direct",
                            "data",
                            "error",
                            "u_num",
                            "u_input",
                            "u_D",
                            "u_val",
                        )
                    },
                    "k": q["k"],
                    "verdict": q["verdict"],
                    "dominant_source": q["dominant"],
                }
            )
    return pd.DataFrame(rows)


def _write_fields(
    path: Path, case: Case, field: FieldComparison, rows: np.ndarray, picture: np.ndarray | None
) -> None:
    part = path.with_name(path.name + ".part")
    with h5py.File(part, "w") as file:
        file.attrs.update(format="lab-fields", format_version=1)
        for name in ("x", "y"):
            file[name] = case.direct[name].values
        file["time"] = case.direct["time"].values[rows]
        file["error"] = field.error.astype(np.float32)
        file["significance"] = field.significance().astype(np.float32)
        file["u_val"] = field.u_val().astype(np.float32)
        if picture is not None:
            file.create_dataset("picture", data=picture, compression="gzip")
            file["picture"].attrs["time"] = float(case.direct["time"].values[case.direct.sizes["time"] // 2])
    part.replace(path)


def _provenance(files: LabFiles, dpiv: Dpiv, seed: int) -> dict[str, Any]:
    run = read_json(files.stage.required("run/run.json", "run"))
    names = ("numpy", "scipy", "xarray", "h5py", "opencv-python-headless", "numba")
    return {
        "versions": {"python": platform.python_version()}
        | {n: version(n) for n in names}
        | run.get("versions", {}),
        "scene_hash": str(run.get("scene_hash", "")),
        "dpiv_sha256": sha256(dpiv.folder / NAME),
        "seed": seed,
        "settings": {"dpiv": dpiv.model_dump(mode="json", exclude={"folder"})},
    }


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)
