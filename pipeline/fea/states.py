"""The bending states of a finger and their file, `states.h5` (docs/formats.md)."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from piv.hdf5_disk import whole_hdf5

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
