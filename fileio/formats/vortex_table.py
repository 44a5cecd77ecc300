"""The table of vortices over time, `vortices.csv` (docs/formats.md)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from fileio.atomic import write_text
from fileio.formats.plane_series import provenance

COLUMNS = [
    "time",
    "track",
    "x",
    "y",
    "circulation",
    "core_radius",
    "peak_swirl_velocity",
    "x_std",
    "y_std",
    "circulation_std",
    "core_radius_std",
    "circulation_area",
    "circulation_contour",
    "finger",
    "side",
    "tip_distance",
    "along_tip",
    "across_tip",
    "peak_swirl_velocity_std",
    "contour_radius",
    "drift_u",
    "drift_v",
    "shear",
    "explained",
    "n_vectors",
    "lifetime",
]


def write_vortices(table: pd.DataFrame, path: str | Path, **settings: Any) -> None:
    """Write a table to CSV, whole or not at all, with provenance in its `#` lines."""
    head = json.dumps({"format": "vortices", "format_version": 1} | provenance(**settings))
    rows = table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
    write_text(path, f"# {head}\n{rows}")


def read_vortices(path: str | Path) -> pd.DataFrame:
    """Read a table of vortices; ValueError where columns are missing."""
    table = pd.read_csv(path, comment="#", dtype={"side": "string", "finger": "Int64"})
    for name in ("time", "track", "x", "y", "circulation", "core_radius"):
        if name not in table:
            raise ValueError(f"{path}: a table of vortices needs the column {name!r}")
    return table
