"""Write docs/reference/formats.csv: python -m fileio.formats."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from fileio.atomic import write_text
from fileio.formats import (
    bending_states,
    elastic_motion,
    finger_loads,
    kinematics,
    mesh_intervals,
    plane_series,
    recorded_motion,
    recording,
    records,
    vortex_table,
)
from fileio.schema import rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "formats.csv"
_MODULES = (
    plane_series, recording, bending_states, kinematics, recorded_motion, mesh_intervals,
    finger_loads, elastic_motion,
)  # fmt: skip
SCHEMAS = (*(module.SCHEMA for module in _MODULES), mesh_intervals.SWEEP)

_TABLES = {
    "vortices_*.csv": ", ".join(vortex_table.COLUMNS),
    "run/forces.csv": records.FORCES.header,
    "run/power.csv": records.POWER.header,
    "run/power_terms.csv": records.POWER_TERMS.header,
    "run/history.csv": records.HISTORY.header,
    "mesh_quality.csv": records.MESH_QUALITY.header,
}


def table() -> str:
    """The variables and attributes of every format, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("format", "name", "dimensions", "unit", "meaning"))
    writer.writerows(row for schema in SCHEMAS for row in rows(schema))
    writer.writerows((file, names, "columns", "SI", "") for file, names in _TABLES.items())
    return text.getvalue()


if __name__ == "__main__":
    write_text(PAGE, table())
