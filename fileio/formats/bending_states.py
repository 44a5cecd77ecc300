"""The bending states of a finger and their file, `states.h5` (docs/formats.md)."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fileio.errors import StageError, one_line
from fileio.hdf5 import open_netcdf
from fileio.hdf5_disk import whole_hdf5

FORMAT, VERSION = "bending-states", 1
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class BendingStates:
    """Bending states of one finger by ascending pressure, in the actuator's frame (SI)."""

    pressure: FloatArray  # (state)
    profile: FloatArray  # (state, point, 2); lower surface from root to tip
    thickness: FloatArray  # (state, point)
    bend_angle: FloatArray  # (state), rad
    radius: FloatArray  # (state); infinite where straight
    fit_residual: FloatArray  # (state), rms distance of the profile from its circle
    converged: NDArray[np.uint8]  # (state)
    width: float
    wall_gap: FloatArray | None = None  # (state); not known of imported states
    radius_std: FloatArray | None = None  # (state)
    about: dict[str, Any] = field(default_factory=dict)  # geometry, material, solver, versions, settings


def write(path: Path, states: BendingStates) -> None:
    """Write `states.h5`, whole or not at all."""
    columns: dict[str, tuple[NDArray[Any], str, tuple[str, ...]]] = {
        "pressure": (states.pressure, "Pa", ("state",)),
        "profile_x": (states.profile[..., 0], "m", ("state", "point")),
        "profile_y": (states.profile[..., 1], "m", ("state", "point")),
        "thickness": (states.thickness, "m", ("state", "point")),
        "bend_angle": (states.bend_angle, "rad", ("state",)),
        "radius": (states.radius, "m", ("state",)),
        "fit_residual": (states.fit_residual, "m", ("state",)),
        "converged": (states.converged, "1", ("state",)),
    }
    for name in ("wall_gap", "radius_std"):
        optional = getattr(states, name)
        if optional is not None:
            columns[name] = (optional, "m", ("state",))
    with whole_hdf5(path, track_order=True) as file:
        file.attrs["format"], file.attrs["format_version"] = FORMAT, VERSION
        file.attrs["width"], file.attrs["frame"] = states.width, "actuator"
        for key, value in states.about.items():
            file.attrs[key] = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
        for dimension, size in (("state", len(states.pressure)), ("point", states.profile.shape[1])):
            file.create_dataset(dimension, data=np.arange(size)).make_scale(dimension)
        for name, (values, units, dimensions) in columns.items():
            packed = {"compression": "gzip", "shuffle": True} if values.ndim == 2 else {}
            data = file.create_dataset(name, data=values, track_times=False, **packed)
            data.attrs["units"] = units
            for axis, dimension in enumerate(dimensions):
                data.dims[axis].attach_scale(file[dimension])


def read(path: Path) -> BendingStates:
    """Read `states.h5`; raises ValueError where it is of another format or version, or incomplete."""
    with h5py.File(path) as file:
        if file.attrs.get("format") != FORMAT:
            raise ValueError(
                f"{path}: format = {file.attrs.get('format')!r}, not {FORMAT!r}: run `make fea` or import your states"
            )
        if int(file.attrs["format_version"]) != VERSION:
            raise ValueError(
                f"{path}: format_version = {file.attrs['format_version']}, this code reads {VERSION}: run `make fea` again"
            )
        missing = {"pressure", "profile_x", "profile_y", "thickness"} - set(file)
        if missing:
            raise ValueError(
                f"{path}: {', '.join(sorted(missing))} missing: run `make fea` or import your states again"
            )
        about = {
            key: json.loads(value) if value[:1] in "{[" else value
            for key, value in file.attrs.items()
            if isinstance(value, str) and key not in ("format", "frame")
        }
        return BendingStates(
            pressure=file["pressure"][:],
            profile=np.stack([file["profile_x"][:], file["profile_y"][:]], -1),
            thickness=file["thickness"][:],
            bend_angle=file["bend_angle"][:],
            radius=file["radius"][:],
            fit_residual=file["fit_residual"][:],
            converged=file["converged"][:],
            width=float(file.attrs["width"]),
            wall_gap=file["wall_gap"][:] if "wall_gap" in file else None,
            radius_std=file["radius_std"][:] if "radius_std" in file else None,
            about=about,
        )


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
    remedy = "write it with python -m pipeline fea"
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


@dataclass(frozen=True)
class States:
    """Lower-layer profiles of a finger at ascending pressures, in the actuator frame (docs/formats.md).

    `pressure` (state,) Pa; `profile` (state, point, 2) m, the same material points in each state; `thickness`
    (state, point) m.
    """

    pressure: np.ndarray
    profile: np.ndarray
    thickness: np.ndarray
    curvature_std: np.ndarray | None = None  # (state,) 1/m: what is not known of the actuator
