"""Tables of the solver's function objects: one for each start, a row for each time."""

from pathlib import Path

import numpy as np

from piv.files.errors import StageError

_BRACKETS = str.maketrans("()", "  ")


def tables(folder: Path, pattern: str) -> list[tuple[float, Path]]:
    """Starts (s) and paths of a function object's tables, `<start>/<pattern>`, ascending."""
    return sorted((float(path.parent.name), path) for path in folder.glob(f"*/{pattern}"))


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
    parts = [rows for _, path in tables(folder, name) if len(rows := table_rows(path))]
    if not parts:
        raise StageError(
            f"{folder}: the solver wrote no {name}; delete the case folder and run make again"
        )
    joined = parts[0]
    for table in parts[1:]:
        joined = np.vstack([joined[joined[:, 0] < table[0, 0] - 1e-12], table])
    return joined
