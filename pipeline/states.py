"""Readers of bending states: states.h5 of the FEA stage, or digitised profiles as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from pipeline.errors import StageError
from pipeline.shapes import States
from piv.errors import one_line
from piv.netcdf import open_netcdf


def read_states(path: Path, thickness: float) -> States:
    """States from `states.h5` or a CSV (docs/formats.md); `thickness` (m) where a CSV gives none."""
    if not path.exists():
        raise StageError(
            f"{path}: motion.states names no file; give the path of a states.h5 or a profile CSV"
        )
    states = _read_csv(path, thickness) if path.suffix.lower() == ".csv" else _read_hdf5(path)
    check_states(states, path)
    return states


def _read_hdf5(path: Path) -> States:
    remedy = "write it with python -m pipeline.fea"
    try:
        file = open_netcdf(path, "states file", load=True)
    except ValueError as error:
        raise StageError(f"{error}; {remedy}") from None
    try:
        with file:
            if file.attrs.get("format") != "bending-states":
                raise StageError(f"{path}: format is {file.attrs.get('format')!r}, expected 'bending-states'")
            converged = file["converged"].values.astype(bool) if "converged" in file else None
            states = States(
                file["pressure"].values.astype(float),
                np.stack([file["profile_x"].values, file["profile_y"].values], axis=-1).astype(float),
                file["thickness"].values.astype(float),
                _curvature_std(file),
            )
    except StageError:
        raise
    except Exception as error:  # a variable is missing, or of another shape or kind
        raise StageError(f"{path}: not a readable states file ({one_line(error)}); {remedy}") from None
    if converged is not None and not converged.all():
        bad = states.pressure[~converged] / 1000
        raise StageError(
            f"{path}: the states at {', '.join(f'{p:g}' for p in bad)} kPa did not converge; remove them"
        )
    return states


def _curvature_std(file: xr.Dataset) -> np.ndarray | None:
    """Standard uncertainty of 1/R (1/m) from that of R; at rest, where R is infinite, between its neighbours'."""
    if "radius_std" not in file:
        return None
    pressure, radius, std = (file[name].values.astype(float) for name in ("pressure", "radius", "radius_std"))
    bent = np.isfinite(radius) & np.isfinite(std)
    return np.interp(pressure, pressure[bent], std[bent] / radius[bent] ** 2)


def _read_csv(path: Path, thickness: float) -> States:
    try:
        lines = [
            line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and line[0] != "#"
        ]
    except (OSError, UnicodeDecodeError) as error:
        raise StageError(f"{path}: not a readable text file ({error})") from None
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    if header[:4] != ["pressure_kpa", "s", "x", "y"] or header[4:] not in ([], ["thickness"]):
        raise StageError(
            f"{path}: the header must read pressure_kpa,s,x,y[,thickness], found {','.join(header)!r}"
        )
    rows_of_cells = [line.split(",") for line in lines[1:]]
    if any(len(row) != len(header) for row in rows_of_cells) or not rows_of_cells:
        raise StageError(f"{path}: rows of different lengths; give {len(header)} columns in each")
    try:
        table = np.array(rows_of_cells, float)
    except ValueError as error:
        raise StageError(f"{path}: a cell is not a number ({error}); correct it") from None
    if not np.isfinite(table).all():
        raise StageError(
            f"{path}: row {int(np.argmin(np.isfinite(table).all(1))) + 2} holds NaN; remove or mend it"
        )
    pressures = np.unique(table[:, 0])
    fraction = np.linspace(0, 1, 141)
    profile, height = [], []
    for pressure in pressures:
        rows = table[table[:, 0] == pressure]
        rows = rows[np.argsort(rows[:, 1], kind="stable")]
        if len(rows) < 3 or not np.all(np.diff(rows[:, 1]) > 0):
            raise StageError(
                f"{path}: the state at {pressure:g} kPa needs three points or more with distinct s"
            )
        s = (rows[:, 1] - rows[0, 1]) / np.ptp(rows[:, 1])
        profile.append(
            CubicSpline(s, rows[:, 2:4])(fraction)
        )  # straight pieces would lose the ends' tangents
        height.append(np.interp(fraction, s, rows[:, 4]) if len(header) == 5 else np.full(141, thickness))
    return States(pressures * 1000.0, np.array(profile), np.array(height))


def check_states(states: States, path: Path) -> None:
    """StageError where a table of states cannot be a finger: too few, unsorted, NaN, or in mm."""
    if len(states.pressure) < 3:
        raise StageError(f"{path}: {len(states.pressure)} states; at least three are needed to interpolate")
    if not np.all(np.diff(states.pressure) > 0):
        raise StageError(f"{path}: pressures must increase from state to state; sort them")
    for name in ("pressure", "profile", "thickness"):
        if not np.isfinite(getattr(states, name)).all():
            raise StageError(f"{path}: {name} holds NaN; remove the unfinished states")
    size = np.abs(states.profile).max()
    if size > 1.0:
        raise StageError(f"{path}: the profile reaches {size:.3g} m, which looks like mm; give metres")
    if (states.thickness <= 0).any():
        raise StageError(f"{path}: thickness must be > 0 everywhere; mend the envelope")
    if (np.hypot(*np.moveaxis(np.diff(states.profile, axis=1), -1, 0)) <= 0).any():
        raise StageError(f"{path}: two neighbouring points of a profile coincide; remove one in every state")
