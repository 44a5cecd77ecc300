"""What accuracy costs: errors of a study's runs against its best, and those that nothing beats."""

import platform
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.formats.records import RUN
from pipeline.runs.stages import until
from pipeline.scene.measurement import piv_settings, render_settings
from piv.files.json_text import read_json
from piv.files.provenance import versions
from piv.files.record import REMEDY, check_own
from postprocess.evidence.stage_files import StageFiles
from postprocess.tables import write_table
from softfinger.study.errors import errors_against, own_errors, stroke_windows
from softfinger.study.table import (
    files_of,
    middle_of_stroke,
    missing_runs,
    origin,
    read_plan,
    stage_costs,
    study_table,
)

# A run that overrides one shows how results respond: it judges no other, and nobody chooses it.
_TRIALS = {"motion.end_time", "fluid.kinematic_viscosity"}
_OF_THE_REPORT = [stage.name for stage in until("report") if stage not in until("vortices")]
_ROUNDING = 1e-9  # s
_LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "numba")


def front(cost: ndarray, error: ndarray) -> ndarray:
    """Whether no run (n,) is both cheaper and more accurate; a run without error never counts."""
    beaten = (cost[None] <= cost[:, None]) & (error[None] <= error[:, None])
    strictly = (cost[None] < cost[:, None]) | (error[None] < error[:, None])
    return ~(beaten & strictly).any(1) & np.isfinite(error)


def _predictions(table: pd.DataFrame, planes: pd.Series, whole: pd.Series) -> pd.DataFrame:
    """CPU seconds of each stage of a run to the report, `predict_<stage>_s`, for each flow run.

    Stages of the sheet go with their `planes`, as the study may have sampled fewer. Those of
    images, PIV and report are those of the run `whole`, with the picture's size.
    """
    out = pd.DataFrame(index=table.index)
    for stage in (stage.name for stage in until("solve")):
        out[f"predict_{stage}_s"] = table[f"cpu_{stage}_s"]
    for stage in ("sheet", "vortices_cfd"):
        out[f"predict_{stage}_s"] = table[f"cpu_{stage}_s"] * planes
    pixels = table["pixels"] / whole["pixels"]
    fields = table["piv_fields"] / whole["piv_fields"]
    out["predict_images_s"] = whole["cpu_images_s"] * pixels
    for stage in ("piv", "vortices_piv"):
        out[f"predict_{stage}_s"] = whole[f"cpu_{stage}_s"] * pixels * fields
    for stage in _OF_THE_REPORT:
        out[f"predict_{stage}_s"] = whole[f"cpu_{stage}_s"]
    return out


def _picture(files: StageFiles) -> dict[str, float]:
    """Pixels of a run's picture, its rate, and each how-many-th pair PIV takes."""
    scene = files.numbers
    camera, piv = render_settings(scene.camera, scene.sheet), piv_settings(scene.piv, scene.camera)
    return {
        "pixels": camera["width_px"] * camera["height_px"],
        "rate_hz": camera["frame_rate_hz"],
        "every": piv["every"] * camera.get("pairs_every", 1),
    }


def finest(plan: dict[str, Any]) -> str:
    """The flow run of a whole stroke with most cells; among equals, with most steps."""
    whole = [
        row
        for row in plan["runs"]
        if row["until"] != "vortices" and _TRIALS.isdisjoint(row["overrides"])
    ]
    if not whole:
        raise ValueError("the study has no run of a whole stroke to judge the others by")

    def size(row: dict[str, Any]) -> tuple[int, int]:
        record = RUN.read(Path(row["out"]) / "run" / "run.json")
        return record["cells"], record["steps"]

    return str(max(whole, key=size)["run"])


def _errors(
    rows: dict[str, StageFiles], table: pd.DataFrame, runs: list[dict[str, Any]], best: str
) -> pd.DataFrame:
    """Errors of each run in each window of the stroke that it reaches; `table`: by run."""
    middle = middle_of_stroke(rows[best])
    windows = stroke_windows(middle, float(table.loc[best, "end_time_s"]))
    out: list[dict[str, Any]] = []
    for window in windows:
        edges = {"start_s": round(window[0], 4), "end_s": round(window[1], 4)}
        errors = {}
        for run, files in rows.items():
            piv = table.loc[run, "kind"] == "piv"
            ends = table.loc[run, "end_time_s"] + _ROUNDING
            if run != best and window[1] <= ends and not (piv and window != windows[0]):
                against = (files, files, "piv") if piv else (rows[best], files, "cfd")
                errors[run] = errors_against(*against, window)
        known = table.join(pd.DataFrame.from_dict(errors, orient="index"))
        if "error" in known:
            errors[best] = own_errors(known, runs, best)
        for run, found in errors.items():
            judge = "" if run == best else best
            out.append({"run": run, **edges, "reference": judge, **found})
    return pd.DataFrame(out)


def _evaluate(plan: dict[str, Any], best: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The study's table with largest errors, the front and predicted costs, and `_errors`."""
    rows = {row["run"]: files_of(row) for row in plan["runs"]}
    table = study_table(plan, {}).set_index("run", drop=False)
    is_piv = table["until"].eq("vortices")
    trial = pd.Series({row["run"]: bool(_TRIALS & set(row["overrides"])) for row in plan["runs"]})
    table["kind"] = np.where(is_piv, "piv", np.where(trial, "trial", "flow"))
    for run, files in rows.items():
        costs = {}
        if table.loc[run, "until"] == "report":
            costs = stage_costs(files.out, _OF_THE_REPORT)[0]
        for name, value in (costs | _picture(files)).items():
            table.loc[run, name] = value
    errors = _errors(rows, table.drop(columns="run"), plan["runs"], best)
    # a vortex that was not found in a window leaves the run's error unknown
    largest = errors.groupby("run")["error"].agg(lambda error: error.max(skipna=False))
    table["error"] = largest.reindex(table.index)
    flow = table["kind"].eq("flow")
    # The study only ever samples less than the level's own rate.
    native = table.groupby("level")["rate_hz"].transform("max")
    table["piv_fields"] = native * table["end_time_s"] / table["every"]
    whole = table[flow & table.get("cpu_report_s", pd.Series(np.nan, table.index)).notna()]
    if len(whole):
        planes = (native / table["rate_hz"])[flow]
        table = table.join(_predictions(table[flow], planes, whole.iloc[0]))
    stages = ["cpu_kinematics_s", "cpu_mesh_s", "cpu_case_s", "cpu_solve_s"]
    table["cpu_flow_s"] = table[stages].sum(axis=1)
    if is_piv.any():
        table.loc[is_piv, "cpu_piv_per_field_s"] = table["cpu_piv_s"] / table["piv_fields"]
    cost = np.where(is_piv, table.get("cpu_piv_per_field_s", np.nan), table["cpu_flow_s"])
    error = table["error"].to_numpy(float)
    table["front"] = False
    for kind in (flow, is_piv):
        chosen = kind.to_numpy()
        table.loc[chosen, "front"] = front(cost[chosen].astype(float), error[chosen])
    return table.reset_index(drop=True), errors


def _judged(plan: dict[str, Any]) -> list[dict[str, Any]]:
    """The runs of a plan up to the last stage that its errors are of: reports give costs alone."""
    ends = {"report": "vortices_cfd"}
    return [row | {"until": ends.get(row["until"], row["until"])} for row in plan["runs"]]


def write_results(
    path: Path,
    table: pd.DataFrame,
    errors: pd.DataFrame,
    best: str,
    probe: dict[str, float],
    made_from: dict[str, Any],
) -> None:
    """Write the table, which ACCURACY= and BUDGET= choose from, as CSV below its provenance.

    `errors`: by run and window of the stroke, which become errors.csv beside it; `made_from`: as
    of `origin`.
    """
    head = {
        "format": "tradeoff",
        "format_version": 2,
        "best": best,
        **made_from,
        "probe": probe,
        "versions": {"python": platform.python_version()} | versions(*_LIBRARIES),
    }
    for target, numbers in ((path, table), (path.with_name("errors.csv"), errors)):
        rounded = numbers.copy()
        for name in rounded.select_dtypes("number"):
            rounded[name] = [float(f"{v:.5g}") if pd.notna(v) else v for v in rounded[name]]
        write_table(target, rounded, head)


def write_tradeoff(path: Path, only: list[str]) -> None:
    """Write results/tradeoff.csv and errors.csv of a scene's studies from the plan of its study.

    `only`: the runs to write; empty: all of the plan. ValueError where one is missing.
    """
    plan = read_plan(path)
    plan = plan | {"runs": [row for row in plan["runs"] if not only or row["run"] in only]}
    if missing := missing_runs(plan):
        listed = "; ".join(f"{run}: {why}" for run, why in missing.items())
        raise ValueError(
            f"{len(missing)} of {len(plan['runs'])} runs are not there as the study asks for them"
            f" ({listed}): run make tradeoff again"
        )
    folder = Path(plan["home"])
    check_own(folder / "studies")
    best = finest(plan)
    table, errors = _evaluate(plan, best)
    probe = read_json(path.with_name("probe.json"), REMEDY)
    target = folder / "studies" / "results" / "tradeoff.csv"
    write_results(target, table, errors, best, probe, origin(_judged(plan)))
