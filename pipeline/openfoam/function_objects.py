"""Tables of the solver's function objects: one for each start, a row for each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fileio.errors import StageError

_BRACKETS = str.maketrans("()", "  ")


def table_rows(path: Path) -> np.ndarray:
    """Rows (time, …) of one table, without those that a killed run has not finished."""
    lines = path.read_text(errors="replace").translate(_BRACKETS).splitlines(keepends=True)
    rows = [
        line.split() for line in lines if line.endswith("\n") and line.strip() and line[0] != "#"
    ]
    rows = [row for row in rows if len(row) == len(rows[0])]
    return np.array(rows, float) if rows else np.empty((0, 1))


def read_function_object(folder: Path, name: str) -> np.ndarray:
    """Rows (time, …) of all `<folder>/<start>/<name>`; a later start replaces repeated rows."""
    parts = sorted(folder.glob(f"*/{name}"), key=lambda path: float(path.parent.name))
    tables = [table for path in parts if len(table := table_rows(path))]
    if not tables:
        raise StageError(
            f"{folder}: the solver wrote no {name}; delete the case folder and run make again"
        )
    joined = tables[0]
    for table in tables[1:]:
        joined = np.vstack([joined[joined[:, 0] < table[0, 0] - 1e-12], table])
    return joined
