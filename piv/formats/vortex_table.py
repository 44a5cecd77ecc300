"""The table of vortices over time, `vortices.csv` (docs/formats.md)."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from piv.files.atomic import write_text
from piv.files.errors import one_line
from piv.files.json_text import parse_json
from piv.files.provenance import check_version
from piv.files.record import check_whole
from piv.formats.plane_series import provenance

FORMAT, VERSION = "vortices", 3
REMEDY = "find the vortices again"
COLUMNS = [
    "time", "track", "bridged", "at_edge", "lifetime", "x", "y", "circulation",
    "circulation_radius", "radius", "peak_vorticity", "circulation_disc", "disc_radius",
    "x_std", "y_std", "circulation_std", "radius_std", "peak_vorticity_std",
    "circulation_disc_std", "x_random_std", "y_random_std", "circulation_disc_random_std",
    "finger", "side", "tip_distance", "along_tip", "across_tip",
    "x_fit", "y_fit", "circulation_fit", "core_radius",
    "x_fit_std", "y_fit_std", "circulation_fit_std", "core_radius_std", "explained",
]  # fmt: skip
NEEDED = ("time", "x", "y", "circulation", "radius")


def write_vortices(table: pd.DataFrame, path: str | Path, **settings: Any) -> None:
    """Write a table to CSV, whole or not at all, with provenance in its `#` lines."""
    head = json.dumps({"format": FORMAT, "format_version": VERSION} | provenance(**settings))
    rows = table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
    write_text(path, f"# {head}\n{rows}")


def read_vortices(path: str | Path, needed: tuple[str, ...] = NEEDED) -> pd.DataFrame:
    """Read a table of vortices of any program; ValueError where `needed` columns lack numbers."""
    check_whole(path)
    with open(path, encoding="utf-8") as file:
        head = file.readline()
    if head.startswith("# {") and "format" in (about := parse_json(head[1:], path, REMEDY)):
        check_version(about, path, FORMAT, VERSION, REMEDY)
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except ValueError as error:  # an empty file among them
        raise ValueError(f"{path}: not a table of vortices ({one_line(error)}); {REMEDY}") from None
    missing = [name for name in needed if name not in table]
    if missing:
        raise ValueError(
            f"{path}: not a table of vortices, it has no column {missing[0]!r}; {REMEDY}"
        )
    seen = ~table.get("at_edge", pd.Series(0, table.index)).astype(bool)
    for name in needed:
        # one plane may have no time, and what reaches beyond the plane is not measured
        lacks = table[name].isna() & seen
        if name != "time" and lacks.any():
            line = int(lacks.to_numpy().argmax()) + 1
            raise ValueError(f"{path}: row {line} has no number in {name!r}; {REMEDY}")
    return table
