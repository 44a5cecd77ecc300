"""The bending states of a finger and their files: `states.h5` as analysed, or a CSV of digitised profiles."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fileio.errors import StageError
from fileio.schema import Schema, Variable

FloatArray = NDArray[np.float64]
SCHEMA = Schema(
    "bending-states",
    2,
    "write it again with make fea SCENE=…",
    (
        Variable("pressure", "state", "Pa", "gauge pressure in the chambers, ascending"),
        Variable("profile_x", "state, point", "m", "lower (ventral) surface from root to tip, equal material points in every state"),
        Variable("profile_y", "state, point", "m", "of the same points"),
        Variable("thickness", "state, point", "m", "from the profile to the dorsal envelope, along the normal; > 0, gap-free"),
        Variable("bend_angle", "state", "rad", "γ: length of the profile / R"),
        Variable("radius", "state", "m", "R of the least-squares circle, positive towards the ventral side; infinite where straight", finite=False),
        Variable("fit_residual", "state", "m", "rms distance of the profile from its circle"),
        Variable("converged", "state", "1", "0: of no use"),
        Variable("wall_gap", "state", "m", "least distance between neighbouring chambers, 0 = touching; not of imported states", True),
        Variable("radius_std", "state", "m", "standard uncertainty of R (docs/fea.md); infinite at rest", True, finite=False),
        Variable("bending_stiffness", "state", "N m2", "EI at the moment 0; this and the next are those of the unit cell", True),
        Variable("bending_stiffness_std", "state", "N m2", "standard uncertainty of EI, from the same sources as that of R", True),
        Variable("neutral_axis", "state", "m", "height above the ventral surface at which a moment changes no length", True),
        Variable("moment", "moment", "N m", "on the finger, positive towards the ventral side, ascending", True),
        Variable("curvature", "state, moment", "1/m", "per length at rest under each moment: no line where chamber walls touch", True),
        Variable("air_section", "state", "m2", "volume of the chambers per length at rest", True),
        Variable("air_height", "state", "m", "of its centre above the ventral surface", True),
        Variable("rubber_mass", "-", "kg/m", "per length at rest", True),
        Variable("rubber_section", "-", "m2", "volume of the rubber per length at rest", True),
        Variable("rubber_height", "-", "m", "of its centre of mass above the ventral surface", True),
        Variable("clamped_length", "-", "m", "from the root: does not bend", True),
        Variable("width", "-", "m", "extent of the finger along z"),
        Variable("frame", "-", "", "`actuator`"),
        *(
            Variable(name, "-", "", meaning, True)
            for name, meaning in (
                ("geometry", "JSON: [actuator] without materials"), ("material", "JSON: as given"), ("solver", "name and version"),
                ("versions", "JSON: of the libraries"), ("settings", "JSON: [fea]"),
                ("uncertainty", "JSON: `pressures_kpa`, and by source `curvature_std`, 1/m, and `bending_stiffness_std`, N m2"),
            )
        ),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class States:
    """Lower-layer profiles of a finger at ascending pressures, in the actuator's frame (docs/formats.md), SI."""

    pressure: FloatArray  # (state)
    profile: (
        FloatArray  # (state, point, 2); the same material points from root to tip in each state
    )
    thickness: FloatArray  # (state, point)
    curvature_std: FloatArray | None = None  # (state), 1/m: what is not known of the actuator


@dataclass(frozen=True)
class BendingLaw:
    """How the finger bends under a moment in each state, and what it weighs and displaces; lengths are those at rest, SI."""

    stiffness: FloatArray  # (state), EI at the moment 0
    neutral_axis: FloatArray  # (state), above the ventral surface
    moment: FloatArray  # (moment), ascending, positive towards the ventral side
    curvature: FloatArray  # (state, moment)
    air_section: FloatArray  # (state)
    air_height: FloatArray  # (state)
    rubber_mass: float
    rubber_section: float
    rubber_height: float
    clamped_length: float
    stiffness_std: FloatArray | None = None  # (state)


LAW = {  # fields of BendingLaw by the names of SCHEMA
    "bending_stiffness": "stiffness",
    "bending_stiffness_std": "stiffness_std",
    **{
        name: name
        for name in (
            "neutral_axis", "moment", "curvature", "air_section", "air_height", "rubber_mass", "rubber_section",
            "rubber_height", "clamped_length",
        )
    },
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class BendingStates(States):
    """States as a bending analysis gives them."""

    bend_angle: FloatArray  # (state), rad
    radius: FloatArray  # (state); infinite where straight
    fit_residual: FloatArray  # (state), rms distance of the profile from its circle
    converged: NDArray[np.uint8]  # (state)
    width: float
    wall_gap: FloatArray | None = None  # (state); not known of imported states
    radius_std: FloatArray | None = None  # (state)
    law: BendingLaw | None = None  # not known of imported states
    about: dict[str, Any] = field(
        default_factory=dict
    )  # geometry, material, solver, versions, settings


OWN = ("pressure", "thickness", "bend_angle", "radius", "fit_residual", "converged")
ABOUT = {v.name for v in SCHEMA.root if v.dims == "-" and not v.units} - {"frame"}


def write(path: Path, states: BendingStates) -> None:
    """Write `states.h5`, whole or not at all."""
    values = {name: getattr(states, name) for name in (*OWN, "wall_gap", "radius_std", "width")}
    values |= {
        "profile_x": states.profile[..., 0],
        "profile_y": states.profile[..., 1],
        "frame": "actuator",
    }
    values |= {name: getattr(states.law, field) for name, field in LAW.items() if states.law}
    values |= {
        k: v if isinstance(v, str) else json.dumps(v, sort_keys=True)
        for k, v in states.about.items()
    }
    SCHEMA.write(path, {name: value for name, value in values.items() if value is not None})


def read(path: Path) -> BendingStates:
    """Read `states.h5`; StageError in one sentence where it is damaged, of another format or version, or incomplete."""
    file = SCHEMA.read(path)
    radius_std = file["radius_std"].values if "radius_std" in file else None
    about = {name: value for name, value in file.attrs.items() if name in ABOUT}
    try:
        about = {name: json.loads(v) if v[:1] in "{[" else v for name, v in about.items()}
    except ValueError as error:
        raise StageError(
            f"{path}: an attribute is not valid JSON ({error}); {SCHEMA.remedy}"
        ) from None
    return BendingStates(
        **{name: file[name].values for name in OWN},
        profile=np.stack([file["profile_x"].values, file["profile_y"].values], -1),
        curvature_std=None
        if radius_std is None
        else _curvature_std(file["pressure"].values, file["radius"].values, radius_std),
        width=float(file.attrs["width"]),
        wall_gap=file["wall_gap"].values if "wall_gap" in file else None,
        radius_std=radius_std,
        law=_law(file),
        about=about,
    )


def _law(file: xr.Dataset) -> BendingLaw | None:
    if "bending_stiffness" not in file:
        return None
    values: dict[str, Any] = {
        f: float(file.attrs[name]) for name, f in LAW.items() if name in file.attrs
    }
    return BendingLaw(**values | {f: file[name].values for name, f in LAW.items() if name in file})


def _curvature_std(pressure: FloatArray, radius: FloatArray, std: FloatArray) -> FloatArray:
    """Standard uncertainty of 1/R (1/m) from that of R; at rest, where R is infinite, between its neighbours'."""
    bent = np.isfinite(radius) & np.isfinite(std)
    return np.interp(pressure, pressure[bent], std[bent] / radius[bent] ** 2)


def read_states(path: Path, thickness: float) -> States:
    """States to move by, from `states.h5` or a CSV (docs/formats.md); `thickness` (m) where a CSV gives none."""
    if not path.exists():
        raise StageError(
            f"{path}: motion.states names no file; give the path of a states.h5 or a profile CSV, or analyse the"
            " scene's actuator with make fea SCENE=.."
        )
    if path.suffix.lower() == ".csv":
        states = _read_csv(path, thickness)
    else:
        states = analysed = read(path)
        if not analysed.converged.all():
            bad = ", ".join(f"{p:g}" for p in analysed.pressure[analysed.converged == 0] / 1000)
            raise StageError(f"{path}: the states at {bad} kPa did not converge; remove them")
    check_states(states, path)
    return states


def _read_csv(path: Path, thickness: float) -> States:
    try:
        lines = [
            line
            for line in path.read_text(encoding="utf-8").splitlines()
            if line.strip() and line[0] != "#"
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
    from scipy.interpolate import CubicSpline  # slow to import; states.h5 needs none

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
        height.append(
            np.interp(fraction, s, rows[:, 4]) if len(header) == 5 else np.full(141, thickness)
        )
    return States(pressures * 1000.0, np.array(profile), np.array(height))


def shapes_of(motion: xr.Dataset, over: str, path: Path) -> States:
    """The shapes that a motion's file holds, with its variable `over` in the pressure's place; StageError as of `check_states`."""
    profile = np.stack([motion["profile_x"].values, motion["profile_y"].values], axis=-1)
    states = States(motion[over].values, profile, motion["thickness"].values)
    check_states(states, path)
    return states


def check_states(states: States, path: Path) -> None:
    """StageError where a table of states cannot be a finger: too few, unsorted, NaN, or in mm."""
    if len(states.pressure) < 3:
        raise StageError(
            f"{path}: {len(states.pressure)} states; at least three are needed to interpolate"
        )
    if not np.all(np.diff(states.pressure) > 0):
        raise StageError(f"{path}: pressures must increase from state to state; sort them")
    for name in ("pressure", "profile", "thickness"):
        if not np.isfinite(getattr(states, name)).all():
            raise StageError(f"{path}: {name} holds NaN; remove the unfinished states")
    size = np.abs(states.profile).max()
    if size > 1.0:
        raise StageError(
            f"{path}: the profile reaches {size:.3g} m, which looks like mm; give metres"
        )
    if (states.thickness <= 0).any():
        raise StageError(f"{path}: thickness must be > 0 everywhere; mend the envelope")
    if (np.hypot(*np.moveaxis(np.diff(states.profile, axis=1), -1, 0)) <= 0).any():
        raise StageError(
            f"{path}: two neighbouring points of a profile coincide; remove one in every state"
        )
