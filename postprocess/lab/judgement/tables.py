"""Tables of a comparison: comparison.csv (a paper's table), series.csv, fields.h5."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from postprocess.lab.judgement.inputs_of_budget import Case
from postprocess.lab.judgement.validation import FieldComparison


def series_table(case: Case, measured: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Every quantity of every side over time (s of the simulation), with the bend angles."""
    out = pd.DataFrame({"time": case.direct["time"].values})
    out["bend_deg_direct"] = np.degrees(case.direct["bend"].values[:, 0])
    out["bend_deg_data"] = np.degrees(case.data["bend"].values[:, 0])
    for name, table in measured.items():
        for column in table.columns.drop("time"):
            out[f"{column}_{name}"] = table[column].to_numpy()
    return out


COMPONENTS = ["simulation", "direct", "data", "finer", "explained_by_motion", "error"]
COMPONENTS += ["u_num", "u_input", "u_D", "u_val"]


def quantity_table(result: dict[str, Any]) -> pd.DataFrame:
    """One row per quantity and component, SI.

    The part that the motion explains is empty where it is not known; it is then not taken out.
    """
    rows = []
    for q in result["quantities"]:
        for k, axis in enumerate(("x", "y") if len(q["error"]) == 2 else ("",)):
            known = {"quantity": q["name"], "component": axis, "unit": q["unit"]}
            verdict = {"k": q["k"], "verdict": q["verdict"], "dominant_source": q["dominant"]}
            rows.append(known | {name: _component(q[name], k) for name in COMPONENTS} | verdict)
    return pd.DataFrame(rows)


def _component(values: np.ndarray | None, k: int) -> float | None:
    return None if values is None else float(values[k])


def field_values(
    case: Case, field: FieldComparison, rows: np.ndarray, picture: np.ndarray | None
) -> dict[str, Any]:
    """Variables of fields.h5."""
    times = case.direct["time"].values
    values = {
        "time": times[rows],
        "y": case.direct["y"].values,
        "x": case.direct["x"].values,
        "error": field.error.astype(np.float32),
        "u_val": field.u_val().astype(np.float32),
        "significance": field.significance().astype(np.float32),
    }
    if picture is None:
        return values
    return values | {"picture": picture, "picture_time": float(times[times.size // 2])}
