"""Write the tables of docs/formats.md: python -m fileio.formats."""

from __future__ import annotations

from pathlib import Path

from fileio.atomic import write_text
from fileio.formats import (
    bending_states,
    elastic_motion,
    finger_loads,
    kinematics,
    lab_fields,
    mesh_intervals,
    plane_series,
    recorded_motion,
    recording,
)
from fileio.schema import markdown

PAGE = Path(__file__).resolve().parents[2] / "docs" / "formats.md"
_MODULES = (
    plane_series, recording, bending_states, kinematics, recorded_motion, mesh_intervals,
    finger_loads, lab_fields, elastic_motion,
)  # fmt: skip
SCHEMAS = (*(module.SCHEMA for module in _MODULES), mesh_intervals.SWEEP)


def with_tables(page: str) -> str:
    """The page with the lines from `<!-- schema: NAME -->` to `<!-- end -->` written anew."""
    for schema in SCHEMAS:
        before, begin, rest = page.partition(f"<!-- schema: {schema.format} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(
                f"{PAGE}: no place for {schema.format!r}; add '<!-- schema: {schema.format} -->'"
            )
        page = before + begin + markdown(schema) + end + after
    return page


if __name__ == "__main__":
    write_text(PAGE, with_tables(PAGE.read_text(encoding="utf-8")))
