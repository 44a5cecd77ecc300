"""The user's own FEA: from displacements of nodes, or digitised profiles, to bending states."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.fea.envelope import crosses_itself, outline
from pipeline.fea.finger import arc_length, fit_circle, smoothed
from pipeline.fea.settings import Import
from pipeline.formats.bending_states import BendingStates, FloatArray, profile_rows

LENGTHS = (0.005, 1.0)  # m; a finger outside of these is in another unit
POINTS = 101
_THINNEST = 0.02  # of the length: as finger.thickness
_LEAST_BEND = 0.05  # rad, from which on a direction is known
_OTHER_SIGN = "give the other sign of ventral in [fea.results], the axis from the chambers away"


@dataclass(frozen=True)
class Fields:
    """Nodes and their displacements in the user's frame and unit."""

    points: FloatArray  # (node, 3)
    displacements: FloatArray  # (state, node, 3)
    progress: FloatArray  # (state): pressure in kPa, or the time of the analysis
    profile: np.ndarray  # nodes of the ventral profile; empty where the file names none


@dataclass(frozen=True)
class Profile:
    """One imported state: the lower surface from root to tip in the actuator's frame, m."""

    pressure: float  # Pa
    s: FloatArray  # (point), ascending: length along the profile at rest
    line: FloatArray  # (point, 2)
    thickness: FloatArray  # (point)


def profiles_of(path: Path, fields: Fields, results: Import) -> list[Profile]:
    """Profiles of the lower layer; raises ValueError where the fields do not suffice."""
    finite = np.isfinite(fields.displacements).all((1, 2))
    if not finite.all():
        raise ValueError(
            f"{path}: state {finite.argmin() + 1} has displacements that are not numbers:"
            " it did not converge, leave it out"
        )
    kpa = fields.progress * results.kpa_per_time
    if results.pressures_kpa is not None:
        kpa = np.array(results.pressures_kpa)
        if len(kpa) != len(fields.progress):
            raise ValueError(
                f"{path}: {len(fields.progress)} states but pressures_kpa has {len(kpa)} values:"
                " give one for each state"
            )
    rest = _actuator_frame(fields.points, results)
    tolerance = 1e-4 * float(np.ptp(rest[:, 0]))
    sheet = np.abs(rest[:, 2] - results.sheet) < tolerance
    ventral = fields.profile
    if not len(ventral):
        lowest = rest[sheet, 1].max(initial=-np.inf)
        ventral = np.flatnonzero(sheet & (rest[:, 1] > lowest - tolerance))
    dorsal = np.flatnonzero(sheet & (rest[:, 1] < rest[sheet, 1].min(initial=np.inf) + tolerance))
    if len(ventral) < 4 or len(dorsal) < 2:
        raise ValueError(
            f"{path}: {len(ventral)} nodes of the lower surface lie in the plane"
            f" sheet = {results.sheet} m: set sheet, along and ventral to your model's frame"
        )
    if len(fields.profile) and rest[ventral, 1].mean() < 0.5 * (
        rest[sheet, 1].min() + rest[sheet, 1].max()
    ):
        raise ValueError(
            f"{path}: its profile lies on the side of the chambers, since ventral ="
            f" {results.ventral!r}: {_OTHER_SIGN}"
        )
    ventral, dorsal = (n[np.argsort(rest[n, 0], kind="stable")] for n in (ventral, dorsal))
    profiles = []
    for pressure, moved in zip(1e3 * kpa, fields.displacements, strict=True):
        place = (_actuator_frame(fields.points + moved, results) - rest[ventral[0]])[:, :2]
        height = _height_along(place[ventral], place[dorsal])
        profiles.append(Profile(pressure, rest[ventral, 0], place[ventral], height))
    return profiles


def digitised(path: Path, results: Import) -> list[Profile]:
    """Profiles of a CSV; raises StageError with file, line and remedy."""
    unit = results.metres_per_unit
    rows = profile_rows(path, results.thickness and results.thickness / unit)
    return [
        Profile(1e3 * kpa, s, np.stack([x, y], -1), height)
        for kpa, points in rows.items()
        for s, x, y, height in [unit * points.T]
    ]


def _actuator_frame(points: FloatArray, results: Import) -> FloatArray:
    """Points in m along the finger, towards the ventral side, and across."""
    across = (set("xyz") - {results.along[-1], results.ventral[-1]}).pop()
    columns = [
        (-1 if name[0] == "-" else 1) * points[:, "xyz".index(name[-1])]
        for name in (results.along, results.ventral, across)
    ]
    return np.stack(columns, -1) * results.metres_per_unit


def _height_along(line: FloatArray, dorsal: FloatArray) -> FloatArray:
    """Height (point) of dorsal nodes above a profile, as a parabola, which bridges gaps."""
    s = np.linspace(0, 1, len(line))
    fine = np.linspace(0, 1, 20 * len(line))
    dense = np.stack([np.interp(fine, s, line[:, axis]) for axis in (0, 1)], -1)
    distance = np.linalg.norm(dorsal[:, None] - dense[None], axis=-1)
    fit = np.polyfit(fine[distance.argmin(1)], distance.min(1), min(2, len(dorsal) - 1))
    return np.asarray(np.polyval(fit, s))


def states_of(
    path: Path, profiles: list[Profile], width: float, pitch: float | None = None
) -> BendingStates:
    """Bending states at equal material points; raises ValueError with file and remedy.

    Where the `pitch` (m) of chambers is known, their ripple is smoothed away (`finger.smoothed`).
    """
    profiles = sorted(profiles, key=lambda profile: profile.pressure)
    pressure = np.array([profile.pressure for profile in profiles])
    if len(profiles) < 3:
        raise ValueError(f"{path}: {len(profiles)} states: give at least three pressures")
    if (np.diff(pressure) <= 0).any():
        twice = pressure[1:][np.diff(pressure) <= 0][0] / 1e3
        raise ValueError(f"{path}: the pressure {twice:g} kPa comes twice: give each state once")
    s = np.linspace(0, 1, POINTS)
    rows = []
    for profile in profiles:
        where = f"{path}: the profile at {profile.pressure / 1e3:g} kPa"
        if not (np.isfinite(profile.line).all() and np.isfinite(profile.thickness).all()):
            raise ValueError(f"{where} has values that are not numbers: leave that state out")
        length = arc_length(profile.line)[-1]
        if not LENGTHS[0] < length < LENGTHS[1]:
            raise ValueError(
                f'{where} is {length:.3g} m long: is the unit right? Set unit = "mm" or "m"'
            )
        if (np.diff(profile.s) <= 0).any():
            raise ValueError(f"{where} has an s that does not rise: order points from root to tip")
        fraction = (profile.s - profile.s[0]) / (profile.s[-1] - profile.s[0])
        values = (*profile.line.T, profile.thickness)
        rows.append((*(np.interp(s, fraction, v) for v in values), length))
    x, y, thickness, arc = (np.array(column) for column in zip(*rows, strict=True))
    even = np.stack([x, y], -1)
    thin = int(np.argmin(mean := thickness.mean(1)))
    if 0 < mean[thin] < _THINNEST * arc[thin]:
        raise ValueError(
            f"{path}: at {pressure[thin] / 1e3:g} kPa it is {1e3 * mean[thin]:.2g} mm"
            f" thick and {1e3 * arc[thin]:.3g} mm long, as no finger is: check thickness, or the"
            " signs of along and ventral, in [fea.results]"
        )
    circles = np.array([fit_circle(profile.line) for profile in profiles])
    most = int(np.argmax(np.abs(pressure)))
    bend = arc[most] / circles[most, 0]
    if bend * pressure[most] < 0 and abs(bend) > _LEAST_BEND:
        raise ValueError(
            f"{path}: at {pressure[most] / 1e3:g} kPa it bends by {np.degrees(bend):.0f}°, against"
            f" the ventral side under pressure: {_OTHER_SIGN}"
        )
    if pitch is not None:
        even = smoothed(even, s, max(1, int(arc.mean() / (1.25 * pitch))))
    for line, high, at in zip(even, thickness, pressure, strict=True):
        if (high <= 0).any() or crosses_itself(outline(line, high)):
            raise ValueError(
                f"{path}: at {at / 1e3:g} kPa the outline of profile and thickness crosses itself:"
                " check thickness, and give pitch to smooth the chambers' ripple"
            )
    return BendingStates(
        pressure=pressure,
        profile=even,
        thickness=thickness,
        bend_angle=arc / circles[:, 0],
        radius=circles[:, 0],
        fit_residual=circles[:, 1],
        wall_gap=None,
        converged=np.ones(len(pressure), dtype=np.uint8),
        width=width,
    )
