"""Profile curves as digitised: CSV with columns pressure_kpa, s, x, y and, where known, thickness and converged."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from pipeline.fea.imported.importing import Profile
from pipeline.fea.settings import Import

NEEDED = ("pressure_kpa", "s", "x", "y")


def read_profiles(path: Path, given: Import) -> list[Profile]:
    """Profiles by the order of the file; lengths in `given.unit`. Raises ValueError with file, line and remedy."""
    rows: dict[float, list[list[float]]] = {}
    with open(path, encoding="utf-8", newline="") as file:
        lines = (
            (number, line)
            for number, line in enumerate(file, 1)
            if line.strip() and not line.startswith("#")
        )
        header = [name.strip() for name in next(csv.reader([next(lines, (0, ""))[1]]), [])]
        missing = [name for name in NEEDED if name not in header]
        if missing:
            raise ValueError(
                f"{path}: column {missing[0]} is missing: the header must name {', '.join(NEEDED)}"
            )
        if "thickness" not in header and given.thickness is None:
            raise ValueError(
                f"{path}: no column thickness: add it or set thickness (m) in [fea.results]"
            )
        for number, line in lines:
            cells = next(csv.reader([line]))
            try:
                row = dict(zip(header, map(float, cells), strict=True))
            except ValueError as error:
                raise ValueError(
                    f"{path}, line {number}: {line.strip()!r} is not {len(header)} numbers: correct it"
                ) from error
            if row.get("converged", 1) == 0:
                raise ValueError(
                    f"{path}, line {number}: the state at {row['pressure_kpa']:g} kPa did not converge: leave it out"
                )
            thickness = (
                row["thickness"]
                if "thickness" in row
                else (given.thickness or 0) / given.metres_per_unit
            )
            rows.setdefault(row["pressure_kpa"], []).append(
                [row["s"], row["x"], row["y"], thickness]
            )
    result = []
    for pressure, points in rows.items():
        values = np.array(points) * given.metres_per_unit
        if len(values) < 4:
            raise ValueError(
                f"{path}: only {len(values)} points at {pressure:g} kPa: a profile needs at least four"
            )
        result.append(Profile(1e3 * pressure, values[:, 0], values[:, 1:3], values[:, 3]))
    return result
