"""The bending states of a finger: `states.h5` as analysed, or a CSV of digitised profiles."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from piv.files.errors import StageError
from piv.files.schema import Schema, variables
from piv.formats.user_tables import read_columns

FloatArray = NDArray[np.float64]
SCHEMA = Schema(
    "bending-states",
    variables("""
pressure  state  Pa  gauge pressure in the chambers, ascending
profile_x  state, point  m  lower (ventral) surface, root to tip, the same material points in all
profile_y  state, point  m  of the same points
thickness  state, point  m  from the profile to the dorsal envelope, along the normal; > 0, gap-free
bend_angle  state  rad  γ: length of the profile / R
radius~  state  m  R of the least-squares circle, positive: ventral side; infinite: straight
fit_residual  state  m  rms distance of the profile from its circle
converged  state  1  0: of no use
wall_gap?  state  m  least distance of neighbouring chambers, 0: touching; not of imported states
radius_std?~  state  m  standard uncertainty of R (docs/fea.md); infinite at rest
bending_stiffness?  state  N m2  EI at the moment 0; this and the next are those of the unit cell
bending_stiffness_std?  state  N m2  standard uncertainty of EI, from the same sources as that of R
neutral_axis?  state  m  height above the ventral surface at which a moment changes no length
moment?  moment  N m  on the finger, positive towards the ventral side, ascending
curvature?  state, moment  1/m  per length at rest; no line where chamber walls touch
air_section?  state  m2  volume of the chambers per length at rest
air_height?  state  m  of its centre above the ventral surface
rubber_mass?  -  kg/m  per length at rest
rubber_section?  -  m2  volume of the rubber per length at rest
rubber_height?  -  m  of its centre of mass above the ventral surface
clamped_length?  -  m  from the root: does not bend
width  -  m  extent of the finger along z
frame  -  -  `actuator`
geometry?  -  -  JSON: [actuator] without materials
material?  -  -  JSON: as in the scene
solver?  -  -  name and version
versions?  -  -  JSON: of the libraries
settings?  -  -  JSON: [fea]
uncertainty?  -  -  JSON: `pressures_kpa`, and by source `curvature_std`, 1/m, and
  `bending_stiffness_std`, N m2
"""),
    remedy="write it again with make fea SCENE=…",
)


@dataclass(frozen=True)
class States:
    """Lower-layer profiles at ascending pressures, in the actuator's frame, SI."""

    pressure: FloatArray  # (state)
    profile: FloatArray  # (state, point, 2); the same material points, root to tip, in each state
    thickness: FloatArray  # (state, point)
    curvature_std: FloatArray | None = None  # (state), 1/m: by what is not known of the actuator


@dataclass(frozen=True)
class BendingLaw:
    """Bending under a moment in each state, weight and buoyancy; per length at rest, SI."""

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


# names in SCHEMA by the fields of BendingLaw
_LAW = {
    name: f"bending_{name}" if name.startswith("stiffness") else name
    for name in BendingLaw.__dataclass_fields__
}


@dataclass(frozen=True, kw_only=True)
class BendingStates(States):
    """States as a bending analysis gives them; None: not known of imported states."""

    bend_angle: FloatArray  # (state), rad
    radius: FloatArray  # (state); infinite where straight
    fit_residual: FloatArray  # (state), rms distance of the profile from its circle
    converged: NDArray[np.uint8]  # (state)
    width: float
    wall_gap: FloatArray | None = None  # (state)
    radius_std: FloatArray | None = None  # (state)
    law: BendingLaw | None = None
    about: dict[str, Any] = field(default_factory=dict)  # SCHEMA's attributes that are text


_OWN = ("pressure", "thickness", "bend_angle", "radius", "fit_residual", "converged")
_ABOUT = {v.name for v in SCHEMA.root if v.dims == "-" and not v.units} - {"frame"}


def write(path: Path, states: BendingStates) -> None:
    """Write `states.h5`, whole or not at all."""
    values = {name: getattr(states, name) for name in (*_OWN, "wall_gap", "radius_std", "width")}
    values |= {
        "profile_x": states.profile[..., 0],
        "profile_y": states.profile[..., 1],
        "frame": "actuator",
    }
    values |= {name: getattr(states.law, field) for field, name in _LAW.items() if states.law}
    values |= {
        k: v if isinstance(v, str) else json.dumps(v, sort_keys=True)
        for k, v in states.about.items()
    }
    SCHEMA.write(path, {name: value for name, value in values.items() if value is not None})


def read(path: Path) -> BendingStates:
    """Read `states.h5`; StageError where it is damaged, incomplete or of another format."""
    file = SCHEMA.read(path)
    optional: dict[str, Any] = {n: file[n].values for n in ("wall_gap", "radius_std") if n in file}
    about = {name: value for name, value in file.attrs.items() if name in _ABOUT}
    try:
        about = {name: json.loads(v) if v[:1] in "{[" else v for name, v in about.items()}
    except ValueError as error:
        raise StageError(
            f"{path}: an attribute is not valid JSON ({error}); {SCHEMA.remedy}"
        ) from None
    return BendingStates(
        **{name: file[name].values for name in _OWN},
        **optional,
        profile=np.stack([file["profile_x"].values, file["profile_y"].values], -1),
        curvature_std=_curvature_std(file),
        width=float(file.attrs["width"]),
        law=_law(file),
        about=about,
    )


def _law(file: xr.Dataset) -> BendingLaw | None:
    if "bending_stiffness" not in file:
        return None
    values: dict[str, Any] = {
        f: float(file.attrs[name]) for f, name in _LAW.items() if name in file.attrs
    }
    return BendingLaw(**values | {f: file[name].values for f, name in _LAW.items() if name in file})


def _curvature_std(file: xr.Dataset) -> FloatArray | None:
    """Standard uncertainty of 1/R (1/m); at rest, where R is infinite, between its neighbours'."""
    if "radius_std" not in file:
        return None
    pressure, radius, std = (file[n].values for n in ("pressure", "radius", "radius_std"))
    bent = np.isfinite(radius) & np.isfinite(std)
    return np.interp(pressure, pressure[bent], std[bent] / radius[bent] ** 2)


def read_states(path: Path, thickness: float) -> States:
    """States to move by, from `states.h5` or a CSV; `thickness` (m) where a CSV has none."""
    if not path.exists():
        raise StageError(
            f"{path}: motion.states names no file; give the path of a states.h5 or a profile CSV,"
            " or analyse the scene's actuator with make fea SCENE=.."
        )
    if path.suffix.lower() == ".csv":
        states = _read_csv(path, thickness)
    else:
        states = analysed = read(path)
        if not analysed.converged.all():
            bad = ", ".join(f"{p:g}" for p in analysed.pressure[analysed.converged == 0] / 1000)
            raise StageError(f"{path}: the states at {bad} kPa did not converge; remove them")
    _check(states, path)
    return states


_COLUMNS = ("pressure_kpa", "s", "x", "y", "thickness", "converged")  # of a CSV


def profile_rows(path: Path, thickness: float | None) -> dict[float, FloatArray]:
    """Points (point, 4) of the profiles in a CSV by pressure (kPa): ascending s, x, y, thickness.

    `thickness`: where the file has none. StageError with file, line and remedy.
    """
    needed = _COLUMNS[:4] if thickness else _COLUMNS[:5]
    table = read_columns(path, needed, _COLUMNS)
    if "converged" in table.names:
        stopped = np.flatnonzero(table.numbers(["converged"]) == 0)
        for k in stopped[:1]:
            raise StageError(
                f"{path}, line {table.lines[k]}: the state at {table.text('pressure_kpa')[k]} kPa"
                " did not converge; leave it out"
            )
    points = table.numbers([name for name in _COLUMNS[:5] if name in table.names])
    if points.shape[1] == 4:
        points = np.column_stack([points, np.full(len(points), thickness)])
    rows: dict[float, list[list[float]]] = {}
    for pressure, *point in points.tolist():
        rows.setdefault(pressure, []).append(point)
    profiles = {pressure: np.array(sorted(points)) for pressure, points in rows.items()}
    for pressure, points in profiles.items():
        if len(points) < 4 or not np.all(np.diff(points[:, 0]) > 0):
            raise StageError(
                f"{path}: the state at {pressure:g} kPa needs four points or more with distinct s"
            )
    return profiles


def _read_csv(path: Path, thickness: float) -> States:
    from scipy.interpolate import CubicSpline  # slow to import; states.h5 needs none

    rows = sorted(profile_rows(path, thickness).items())
    fraction = np.linspace(0, 1, 141)
    profile, height = [], []
    for _, points in rows:
        s = (points[:, 0] - points[0, 0]) / np.ptp(points[:, 0])
        # straight pieces would lose the ends' tangents
        profile.append(CubicSpline(s, points[:, 1:3])(fraction))
        height.append(np.interp(fraction, s, points[:, 3]))
    return States(1e3 * np.array([p for p, _ in rows]), np.array(profile), np.array(height))


def shapes_of(motion: xr.Dataset, over: str, path: Path) -> States:
    """The shapes of a motion's file, with its variable `over` in the pressure's place.

    StageError where they cannot be a finger's.
    """
    profile = np.stack([motion["profile_x"].values, motion["profile_y"].values], axis=-1)
    states = States(motion[over].values, profile, motion["thickness"].values)
    _check(states, path)
    return states


def _check(states: States, path: Path) -> None:
    """StageError where states cannot be a finger's: too few, unsorted, NaN, or in mm."""
    count, size = len(states.pressure), np.abs(states.profile).max(initial=0.0)
    edges = np.diff(states.profile, axis=1)
    faults = [
        (count < 3, f"{count} states; at least three are needed to interpolate"),
        (
            not np.all(np.diff(states.pressure) > 0),
            "pressures must increase from state to state; sort them",
        ),
        *(
            (
                not np.isfinite(getattr(states, name)).all(),
                f"{name} holds NaN; remove the unfinished states",
            )
            for name in ("pressure", "profile", "thickness")
        ),
        (size > 1.0, f"the profile reaches {size:.3g} m, which looks like mm; give metres"),
        ((states.thickness <= 0).any(), "thickness must be > 0 everywhere; mend the envelope"),
        (
            (np.hypot(edges[..., 0], edges[..., 1]) <= 0).any(),
            "two neighbouring points of a profile coincide; remove one in every state",
        ),
    ]
    for wrong, message in faults:
        if wrong:
            raise StageError(f"{path}: {message}")
