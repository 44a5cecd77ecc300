"""Digitised profiles: CSV of pressure_kpa, s, x, y and, where known, thickness and converged."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from pipeline.fea.imported.importing import Profile
from pipeline.fea.settings import Import

NEEDED = ("pressure_kpa", "s", "x", "y")


def read_profiles(path: Path, results: Import) -> list[Profile]:
    """Profiles in the file's order; raises ValueError with file, line and remedy."""
    rows: dict[float, list[list[float]]] = {}
    text = path.read_text(encoding="utf-8").splitlines()
    lines = [(n, row) for n, row in enumerate(text, 1) if row.strip() and row[0] != "#"]
    header = [name.strip() for name in next(csv.reader([lines[0][1] if lines else ""]), [])]
    missing = [name for name in NEEDED if name not in header]
    if missing:
        raise ValueError(
            f"{path}: column {missing[0]} is missing: the header must name {', '.join(NEEDED)}"
        )
    thickness = (results.thickness or 0) / results.metres_per_unit
    if "thickness" not in header and not thickness:
        raise ValueError(
            f"{path}: no column thickness: add it or set thickness (m) in [fea.results]"
        )
    for number, line in lines[1:]:
        try:
            row = dict(zip(header, map(float, line.split(",")), strict=True))
        except ValueError as error:
            raise ValueError(
                f"{path}, line {number}: {line.strip()!r} is not {len(header)} numbers: correct it"
            ) from error
        pressure = row["pressure_kpa"]
        if row.get("converged", 1) == 0:
            raise ValueError(
                f"{path}, line {number}: the state at {pressure:g} kPa did not converge:"
                " leave it out"
            )
        values = [row["s"], row["x"], row["y"], row.get("thickness", thickness)]
        rows.setdefault(pressure, []).append(values)
    profiles = []
    for pressure, points in rows.items():
        if len(points) < 4:
            raise ValueError(
                f"{path}: only {len(points)} points at {pressure:g} kPa: give at least four"
            )
        s, x, y, height = results.metres_per_unit * np.array(points).T
        profiles.append(Profile(1e3 * pressure, s, np.stack([x, y], -1), height))
    return profiles
