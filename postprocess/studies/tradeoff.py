"""What accuracy costs: errors of a study's runs against its best, the front of those that nothing beats, figure and page.

Command: python -m postprocess tradeoff cases/single_finger/out/studies/tradeoff/plan.json (make tradeoff)
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import brentq

from fileio.formats.plane_series import read_plane
from fileio.formats.records import FORCES, RUN
from fileio.stages import until
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.dorsal_circulation import dorsal_circulation
from postprocess.evidence.load import FILES
from postprocess.evidence.stage_files import StageFiles, read_json
from postprocess.evidence.strokes import peak_tip_speed
from postprocess.evidence.vortex_integral import CIRCLE, vortex_integrals
from postprocess.studies.state import files_of, missing_runs, missing_sentence
from postprocess.studies.table import middle_of_stroke, read_plan, stage_costs, study_table

INSTANTS = 12  # of the middle of the stroke at which velocity fields are compared
OF_THE_REPORT = [stage.name for stage in until("report") if stage not in until("vortices")]
ERRORS = ("error_dorsal", "error_centre", "error_velocity", "error_force")
OF_PIV = ("error_circulation", "error_centre", "error_velocity")
PART_OF_STROKE = (
    "motion.end_time"  # a run that overrides it shows how grids converge: nobody chooses it
)
ORDERS = (
    1.0,
    2.0,
)  # that an extrapolation takes: schemes are of second order, walls and time of first


def velocity_error(reference: xr.Dataset, other: xr.Dataset, window: tuple[float, float]) -> float:
    """RMS of the vector difference on the common valid points at about INSTANTS instants of a window, m/s."""
    inside = np.flatnonzero(
        (other["time"].values >= window[0]) & (other["time"].values <= window[1])
    )
    thinned = inside[:: max(1, len(inside) // INSTANTS)]
    return fields.rms_difference(fields.field_sums(reference, other.isel(time=thinned)))


def vortex_errors(
    reference: pd.DataFrame, other: pd.DataFrame, window: tuple[float, float], width: float
) -> dict[str, float]:
    """A vortex's rows against another's: RMS of circulation (part of the reference's) and of centre (tip widths).

    Empty where the two have no instant in common.
    """
    if reference.empty or other.empty:
        return {}
    pair = tracks.pair_tracks(reference, other)
    pair = pair[pair["time"].between(*window)]
    if pair.empty:
        return {}
    distance = tracks.centre_distance(pair)
    return {
        "error_circulation": tracks.circulation_difference(pair),
        "error_centre": distance / width,
        "error_centre_mm": distance * 1e3,
    }


def dorsal_error(reference: pd.DataFrame, other: pd.DataFrame) -> float:
    """RMS of the difference of two dorsal circulations over the RMS of the reference's part that is not prescribed."""
    wanted = np.interp(other["time"], reference["time"], reference["circulation"])
    of_water = np.interp(other["time"], reference["time"], reference["of_water"])
    return float(np.sqrt(((other["circulation"] - wanted) ** 2).mean() / (of_water**2).mean()))


def force_error(reference: pd.DataFrame, other: pd.DataFrame, end: float) -> float:
    """RMS of the difference of the force's vector until `end` (s) over the RMS of the reference's."""
    rows = other[other["time"] <= end + 1e-9]
    difference = reference2 = 0.0
    for name in ("fx", "fy"):
        wanted = np.interp(rows["time"], reference["time"], reference[name])
        difference += float(((rows[name] - wanted) ** 2).mean())
        reference2 += float((wanted**2).mean())
    return float(np.sqrt(difference / reference2))


def errors_against(
    best: StageFiles, files: StageFiles, source: str, window: tuple[float, float]
) -> dict[str, float]:
    """Errors of a run's flow ("cfd") or PIV ("piv") against the flow of `best` over a window (s), as far as both go: ERRORS
    as parts of the scale of each, and `error`, the largest. The force's error is from the beginning.

    A flow's circulation and centre of the vortex are integrals over CIRCLE, beside them those of the fit, `…_fit`, and
    `error_dorsal`, of all water on the tip's dorsal side; PIV's are those of the fit, as the comparison takes them.
    """
    with (
        read_plane(best.required(FILES["cfd"], "sheet")) as wanted,
        read_plane(files.required(FILES[source], "piv" if source == "piv" else "sheet")) as got,
    ):
        window = window[0], min(window[1], float(wanted["time"][-1]), float(got["time"][-1]))
        scale, _ = peak_tip_speed(wanted["time"].values, wanted["tip"].values)
        width = float(wanted.attrs["tip_width"])
        errors = {"error_velocity": velocity_error(wanted, got, window) / scale}
        if source == "piv":
            errors |= {"vectors": got.sizes["x"] * got.sizes["y"], "fields": got.sizes["time"]}
        else:
            errors["tip_width_mm"] = width * 1e3
        tables = {
            name: tracks.read_vortices(of.required(f"vortices_{seen}.csv", "vortices"))
            for name, of, seen in (("best", best, "cfd"), ("other", files, source))
        }
        fits = list(tracks.dominant_tracks(tables, 0, window).values())
        if len(fits) == 2:
            of_fit = vortex_errors(fits[0], fits[1], window, width)
            if source == "piv":
                errors |= of_fit
            else:
                a, b = (
                    vortex_integrals(plane, fit, CIRCLE * width, window)
                    for plane, fit in zip((wanted, got), fits, strict=True)
                )
                if of_circle := vortex_errors(a, b, window, width):
                    sides = (dorsal_circulation(plane, window) for plane in (wanted, got))
                    errors |= of_circle | {"error_dorsal": dorsal_error(*sides)}
                errors |= {f"{name}_fit": value for name, value in of_fit.items()}
    if source == "cfd":
        wanted_force, force = [
            FORCES.read(of.required("run/forces.csv", "run")) for of in (best, files)
        ]
        errors["error_force"] = force_error(
            wanted_force, force, float(wanted_force["time"].iloc[-1])
        )
    return errors | worst(errors)


def worst(errors: dict[str, float]) -> dict[str, float]:
    """`error`: the largest of ERRORS, or OF_PIV, that were measured; absent where the vortex was not found."""
    judged = ERRORS if "error_dorsal" in errors else OF_PIV
    if judged[0] not in errors:
        return {}
    return {"error": max(errors[name] for name in judged if name in errors)}


def own_errors(table: pd.DataFrame, runs: list[dict[str, Any]], best: str) -> dict[str, float]:
    """ERRORS of the best run itself, extrapolated from the next two levels with the same overrides: at the order in the
    cell's size at which their errors fall, held within ORDERS; at second order from one. Empty where the study has none.

    table: by run, with `cells` and the errors against the best run; runs: of the plan.
    """
    of_best = next(r["overrides"] for r in runs if r["run"] == best)
    alike = [r["run"] for r in runs if r["until"] != "vortices" and r["overrides"] == of_best]
    known = [r for r in alike if r != best and np.isfinite(table["error"].get(r, np.nan))]
    next_two = table.loc[sorted(known, key=lambda r: -table.loc[r, "cells"])[:2]]
    dimensions = 2 if table.loc[best, "model"] == "2d" else 3
    size = (table.loc[best, "cells"] / next_two["cells"].to_numpy(float)) ** (1 / dimensions)
    if not known or size[0] <= 1:
        return {}
    own = {}
    for name in table.columns.intersection([*ERRORS, "error_circulation", "error_centre_mm"]):
        order = falling_order(size, next_two[name].to_numpy(float)) if len(size) == 2 else ORDERS[1]
        own[name] = float(next_two[name].iloc[0]) / (size[0] ** order - 1)
    return own | worst(own)


def falling_order(size: np.ndarray, error: np.ndarray) -> float:
    """Order within ORDERS at which the `error` (2,) against a best run falls with cells of `size` (2,), those of the best 1."""

    def excess(order: float) -> float:
        return float((size[1] ** order - 1) * error[0] - (size[0] ** order - 1) * error[1])

    if excess(ORDERS[0]) >= 0:
        return ORDERS[0]
    return ORDERS[1] if excess(ORDERS[1]) <= 0 else float(brentq(excess, *ORDERS))


def front(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Whether nothing is both cheaper and more accurate (n,), of runs with cost (n,) and error (n,); NaN is on no front."""
    beaten = (cost[None] <= cost[:, None]) & (error[None] <= error[:, None])
    strictly = (cost[None] < cost[:, None]) | (error[None] < error[:, None])
    return ~(beaten & strictly).any(1) & np.isfinite(error)


def predictions(table: pd.DataFrame, planes: pd.Series, whole: pd.Series) -> pd.DataFrame:
    """CPU seconds of every stage of a whole run to the report, `predict_<stage>_s`, for each flow run.

    Stages of the sheet go with their planes (the study may have sampled fewer); those of images, PIV and report are taken
    from the run `whole` that went to its report, with the picture's size.
    """
    out = pd.DataFrame(index=table.index)
    for stage in (stage.name for stage in until("run")):
        out[f"predict_{stage}_s"] = table[f"cpu_{stage}_s"]
    for stage in ("sheet", "vortices_cfd"):
        out[f"predict_{stage}_s"] = table[f"cpu_{stage}_s"] * planes
    pixels = table["pixels"] / whole["pixels"]
    fields_ = table["piv_fields"] / whole["piv_fields"]
    out["predict_images_s"] = whole["cpu_images_s"] * pixels
    out["predict_piv_s"] = whole["cpu_piv_s"] * pixels * fields_
    out["predict_vortices_piv_s"] = whole["cpu_vortices_piv_s"] * pixels * fields_
    for stage in OF_THE_REPORT:
        out[f"predict_{stage}_s"] = whole[f"cpu_{stage}_s"]
    return out


def picture(files: StageFiles) -> dict[str, float]:
    """Pixels of a run's picture, its rate, and each how-many-th pair PIV takes."""
    camera = read_json(files.out / "settings" / "images.json")
    piv = read_json(files.out / "settings" / "piv.json")
    return {
        "pixels": camera["width_px"] * camera["height_px"],
        "rate_hz": camera["frame_rate_hz"],
        "every": piv["every"] * camera.get("pairs_every", 1),
    }


def finest(plan: dict[str, Any], missing: dict[str, str]) -> str:
    """The flow run of most cells that is not `missing`, of those with as many the one of most steps."""
    done = [row for row in plan["runs"] if row["until"] != "vortices" and row["run"] not in missing]
    if not done:
        raise ValueError("the study has no finished run to judge the others by")

    def size(row: dict[str, Any]) -> tuple[int, int]:
        record = RUN.read(files_of(row).out / "run" / "run.json")
        return record["cells"], record["steps"]

    return str(max(done, key=size)["run"])


def evaluate(plan: dict[str, Any], best: str, missing: dict[str, str]) -> pd.DataFrame:
    """The study's table with errors, the front, and the predicted cost of each setting to the report; without the runs that
    are `missing`."""
    plan = plan | {"runs": [row for row in plan["runs"] if row["run"] not in missing]}
    rows = {row["run"]: files_of(row) for row in plan["runs"]}
    if best not in rows:
        why = missing.get(best, "the table has none of that name")
        raise ValueError(
            f"the study has no finished run {best!r} to judge the others by ({why}); name one with --best"
        )
    table = study_table(plan, {}).set_index("run", drop=False)
    is_piv = table["until"].eq("vortices")
    is_part = pd.Series({row["run"]: PART_OF_STROKE in row["overrides"] for row in plan["runs"]})
    table["kind"] = np.where(is_piv, "piv", np.where(is_part, "grid", "flow"))
    window = middle_of_stroke(rows[str(table["end_time_s"].idxmax())])
    for run, files in rows.items():
        source, reference = ("piv", files) if is_piv[run] else ("cfd", rows[best])
        numbers = {} if run == best else errors_against(reference, files, source, window)
        if table.loc[run, "until"] == "report":
            numbers |= stage_costs(files, OF_THE_REPORT)[0]
        for name, value in (numbers | picture(files)).items():
            table.loc[run, name] = value
    if "error" in table:
        for name, value in own_errors(table, plan["runs"], best).items():
            table.loc[best, name] = value
    flow = table["kind"].eq("flow")
    # the level's own rate: the study only ever samples less
    native = table.groupby("level")["rate_hz"].transform("max")
    table["piv_fields"] = native * table["end_time_s"] / table["every"]
    whole = table[flow & table.get("cpu_report_s", pd.Series(np.nan, table.index)).notna()]
    if len(whole):
        table = table.join(
            predictions(table[flow], (native / table["rate_hz"])[flow], whole.iloc[0])
        )
    table["cpu_flow_s"] = table[["cpu_kinematics_s", "cpu_mesh_s", "cpu_case_s", "cpu_run_s"]].sum(
        axis=1
    )
    if is_piv.any():
        table.loc[is_piv, "cpu_piv_per_field_s"] = table["cpu_piv_s"] / table["fields"]
    cost = np.where(is_piv, table.get("cpu_piv_per_field_s", np.nan), table["cpu_flow_s"]).astype(
        float
    )
    error = table.get("error", pd.Series(np.nan, table.index)).to_numpy(float)
    table["front"] = False
    for kind in (flow, is_piv):
        chosen = kind.to_numpy()
        table.loc[chosen, "front"] = front(cost[chosen], error[chosen])
    return table.reset_index(drop=True)


def with_earlier_piv(table: pd.DataFrame, results: Path, missing: dict[str, str]) -> pd.DataFrame:
    """The table and, of the earlier `results`, the PIV runs that are `missing`: each is judged by the flow that it was made of."""
    if not (missing and results.exists()):
        return table
    earlier = pd.read_csv(results, comment="#")
    kept = earlier[earlier["run"].isin(missing) & earlier["kind"].eq("piv")]
    return pd.concat(
        [
            table,
            kept[
                kept.columns.intersection(
                    table.columns.union(["vectors", "fields", "cpu_piv_per_field_s"])
                )
            ],
        ],
        ignore_index=True,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `tradeoff`."""
    parser.add_argument("plan", type=Path, help="plan.json of the study")
    parser.add_argument("--best", help="run that the others are judged by (default: the finest)")
    parser.add_argument(
        "--docs", type=Path, default=Path("docs"), help="of the page (default: %(default)s)"
    )
    parser.add_argument(
        "--partial", action="store_true", help="though runs are missing, which it then names"
    )


def run(args: argparse.Namespace) -> None:
    """Command `tradeoff`."""
    from postprocess.studies.tradeoff_page import results_path, write_results

    plan = read_plan(args.plan)
    missing = missing_runs(plan)
    if missing:
        said = missing_sentence(missing, len(plan["runs"]), f"make tradeoff SCENE={plan['scene']}")
        if not args.partial:
            raise ValueError(f"{said}, or give --partial for a page without them")
        print(f"tradeoff: {said}", file=sys.stderr)
    probe = read_json(args.plan.with_name("probe.json"))
    best = args.best or finest(plan, missing)
    folder = Path(plan["folder"])
    table = with_earlier_piv(evaluate(plan, best, missing), results_path(folder), missing)
    write_results(folder, table, best, probe, args.docs, missing)
