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
)
from fileio.schema import rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "formats.csv"
_MODULES = (
    plane_series, recording, bending_states, kinematics, recorded_motion, mesh_intervals,
    finger_loads, elastic_motion,
)  # fmt: skip
SCHEMAS = (*(module.SCHEMA for module in _MODULES), mesh_intervals.SWEEP)


def table() -> str:
    """The variables and attributes of every format, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("format", "name", "dimensions", "unit", "meaning"))
    writer.writerows(row for schema in SCHEMAS for row in rows(schema))
    return text.getvalue()


if __name__ == "__main__":
    write_text(PAGE, table())
