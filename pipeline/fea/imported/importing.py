"""The user's own FEA: from displacements of nodes, or from digitised profiles, to bending states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fileio.formats.bending_states import BendingStates
from pipeline.fea.envelope import crosses_itself, outline
from pipeline.fea.finger import arc_length, fit_circle, smoothed
from pipeline.fea.settings import Import

FloatArray = NDArray[np.float64]
LENGTHS = (0.005, 1.0)  # m; a finger outside of these is in another unit
POINTS = 101


@dataclass(frozen=True)
class Fields:
    """Nodes and their displacements in the user's frame and unit; `sets` are named node numbers from 0."""

    points: FloatArray  # (node, 3)
    displacements: FloatArray  # (state, node, 3)
    progress: FloatArray  # (state): pressure in kPa, or the time of the analysis
    sets: dict[str, NDArray[np.intp]]


@dataclass(frozen=True)
class Profile:
    """One state as imported: lower surface from root to tip in the actuator's frame, m."""

    pressure: float  # Pa
    s: FloatArray  # (point), ascending: length along the profile at rest
    line: FloatArray  # (point, 2)
    thickness: FloatArray  # (point)


def profiles_of(path: Path, fields: Fields, given: Import) -> list[Profile]:
    """Profiles of the lower layer of displacement fields; raises ValueError where the fields do not suffice."""
    if not np.isfinite(fields.displacements).all():
        bad = int(np.flatnonzero(~np.isfinite(fields.displacements).all((1, 2)))[0])
        raise ValueError(
            f"{path}: state {bad + 1} has displacements that are not numbers: it did not converge, leave it out"
        )
    pressures = _pressures(path, fields, given)
    rest = _actuator_frame(fields.points, given)
    ventral, dorsal = _lines(path, rest, fields, given)
    origin = rest[ventral[0]]
    result = []
    for pressure, moved in zip(pressures, fields.displacements, strict=True):
        place = _actuator_frame(fields.points + moved, given) - origin
        line = place[ventral, :2]
        result.append(
            Profile(pressure, rest[ventral, 0], line, height_along(line, place[dorsal, :2]))
        )
    return result


def _pressures(path: Path, fields: Fields, given: Import) -> FloatArray:
    count = len(fields.progress)
    if given.pressures_kpa is not None:
        if len(given.pressures_kpa) != count:
            raise ValueError(
                f"{path}: {count} states but pressures_kpa has {len(given.pressures_kpa)} values: give one for each state"
            )
        return 1e3 * np.asarray(given.pressures_kpa, dtype=float)
    return 1e3 * fields.progress * given.kpa_per_time


def _actuator_frame(points: FloatArray, given: Import) -> FloatArray:
    """Points in m along the finger, towards the ventral side, and across, by the user's names of the axes."""
    columns = []
    for name in (given.along, given.ventral):
        sign = -1.0 if name.startswith("-") else 1.0
        columns.append(sign * points[:, "xyz".index(name[-1])])
    across = (set("xyz") - {given.along[-1], given.ventral[-1]}).pop()
    columns.append(points[:, "xyz".index(across)])
    return np.stack(columns, -1) * given.metres_per_unit


def _lines(
    path: Path, rest: FloatArray, fields: Fields, given: Import
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Nodes of the lower layer's profile and of the dorsal side, in the sheet, from root to tip."""
    tolerance = 1e-4 * float(np.ptp(rest[:, 0]))
    sheet = np.abs(rest[:, 2] - given.sheet) < tolerance
    ventral = np.flatnonzero(sheet & (rest[:, 1] > rest[sheet, 1].max(initial=-np.inf) - tolerance))
    if given.node_set is not None:
        if given.node_set not in fields.sets:
            known = ", ".join(sorted(fields.sets)) or "none"
            raise ValueError(
                f"{path}: node_set = {given.node_set!r} is not there (there are: {known}): name one of these"
            )
        ventral = fields.sets[given.node_set]
    dorsal = np.flatnonzero(sheet & (rest[:, 1] < rest[sheet, 1].min(initial=np.inf) + tolerance))
    if len(ventral) < 4 or len(dorsal) < 2:
        raise ValueError(
            f"{path}: {len(ventral)} nodes of the lower surface lie in the plane sheet = {given.sheet} m: "
            "set sheet, along and ventral to your model's frame, or name a node_set"
        )
    return tuple(line[np.argsort(rest[line, 0], kind="stable")] for line in (ventral, dorsal))  # type: ignore[return-value]


def height_along(line: FloatArray, dorsal: FloatArray) -> FloatArray:
    """Height (point) of the dorsal nodes above a profile, as a parabola along it, which bridges gaps and dimples."""
    s = np.linspace(0, 1, len(line))
    fine = np.linspace(0, 1, 20 * len(line))
    dense = np.stack([np.interp(fine, s, line[:, axis]) for axis in (0, 1)], -1)
    distance = np.linalg.norm(dorsal[:, None] - dense[None], axis=-1)
    nearest = distance.argmin(1)
    return np.asarray(
        np.polyval(np.polyfit(fine[nearest], distance.min(1), min(2, len(dorsal) - 1)), s)
    )


def states_of(
    path: Path, profiles: list[Profile], width: float, pitch: float | None = None
) -> BendingStates:
    """Bending states from profiles, at equal material points; raises ValueError with file and remedy.

    Where the `pitch` (m) of chambers is given, their ripple is smoothed away (`finger.smoothed`).
    """
    profiles = sorted(profiles, key=lambda profile: profile.pressure)
    pressure = np.array([profile.pressure for profile in profiles])
    if len(profiles) < 3:
        raise ValueError(
            f"{path}: {len(profiles)} states: at least three pressures are needed to interpolate between"
        )
    if (np.diff(pressure) <= 0).any():
        twice = pressure[1:][np.diff(pressure) <= 0][0] / 1e3
        raise ValueError(f"{path}: the pressure {twice:g} kPa comes twice: give each state once")
    s = np.linspace(0, 1, POINTS)
    lines, thickness = [], []
    for profile in profiles:
        if not (np.isfinite(profile.line).all() and np.isfinite(profile.thickness).all()):
            raise ValueError(
                f"{path}: the profile at {profile.pressure / 1e3:g} kPa has values that are not numbers: leave that state out"
            )
        length = arc_length(profile.line)
        if not LENGTHS[0] < length[-1] < LENGTHS[1]:
            raise ValueError(
                f"{path}: the profile at {profile.pressure / 1e3:g} kPa is {length[-1]:.3g} m long: "
                'is the unit right? Set unit = "mm" or "m"'
            )
        if (np.diff(profile.s) <= 0).any():
            raise ValueError(
                f"{path}: s does not rise along the profile at {profile.pressure / 1e3:g} kPa: order the points from root to tip"
            )
        fraction = (profile.s - profile.s[0]) / (profile.s[-1] - profile.s[0])
        lines.append([np.interp(s, fraction, profile.line[:, axis]) for axis in (0, 1)])
        thickness.append(np.interp(s, fraction, profile.thickness))
    bare = np.array(lines).transpose(0, 2, 1)
    circles = np.array([fit_circle(profile.line) for profile in profiles])
    arc = np.array([arc_length(profile.line)[-1] for profile in profiles])
    even = bare
    if pitch is not None:
        even = smoothed(bare, s, max(1, int(arc.mean() / (1.25 * pitch))))
    for line, high, at in zip(even, thickness, pressure, strict=True):
        if (high <= 0).any() or crosses_itself(outline(line, high)):
            raise ValueError(
                f"{path}: at {at / 1e3:g} kPa the outline of profile and thickness crosses itself: "
                "check thickness, and give pitch to smooth the chambers' ripple"
            )
    return BendingStates(
        pressure=pressure,
        profile=even,
        thickness=np.array(thickness),
        bend_angle=arc / circles[:, 0],
        radius=circles[:, 0],
        fit_residual=circles[:, 1],
        wall_gap=None,
        converged=np.ones(len(pressure), dtype=np.uint8),
        width=width,
    )
