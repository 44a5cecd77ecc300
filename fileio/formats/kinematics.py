"""The finger's shapes as kinematics.h5 gives them: outline, tip and bend over the pressure, and the pressure over time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from fileio.errors import StageError, one_line
from fileio.hdf5 import read_dataset
from fileio.provenance import settings_in

NAMES = ("outline", "tip", "tip_direction", "dorsal_direction", "bend")


@dataclass(frozen=True)
class Family:
    """Shapes over the pressure (Pa), tank frame; `law` is the simulation's pressure over time, `root` the root's middle (m)."""

    low: float
    high: float
    splines: dict[str, CubicSpline]
    law: CubicSpline
    root: tuple[float, float]
    length: float
    finger_width: float
    tip_width: float
    time: tuple[float, float]
    mirror: bool = False  # a second finger, the mirror image in x = 0

    def fingers(self, name: str, pressure: float) -> np.ndarray:
        """`shape` of every finger, (finger, …): the family's own, and its mirror image where there is one."""
        own = np.asarray(self.shape(name, pressure))
        if not self.mirror:
            return own[None]
        return np.stack([own, own if name == "bend" else own * np.array([-1.0, 1.0])])

    def shape(self, name: str, pressure: float) -> np.ndarray:
        """`outline` (point, 2), `tip`, `tip_direction`, `dorsal_direction` (2,) or `bend` at a pressure.

        Outside the family's range it goes on linearly: a recording may bend further than the simulation.
        """
        inside = float(np.clip(pressure, self.low, self.high))
        spline = self.splines[name]
        return spline(inside) + (pressure - inside) * spline(inside, 1)

    def bend(self, pressure: np.ndarray) -> np.ndarray:
        """Bend angles (rad) at pressures (n,)."""
        return np.array([float(self.shape("bend", p)) for p in np.ravel(pressure)])

    def pressure_of_bend(self, bend: np.ndarray) -> np.ndarray:
        """Pressures (Pa) at which the finger has these bend angles (rad); inverse of `bend`."""
        reach = 0.25 * (self.high - self.low)
        fine = np.linspace(self.low - reach, self.high + reach, 601)
        angle = self.bend(fine)
        order = np.argsort(angle)
        return PchipInterpolator(angle[order], fine[order], extrapolate=True)(bend)


def read_family(path: Path) -> Family:
    """The family of a kinematics.h5. ValueError in one sentence where it is another file."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != "kinematics":
                raise ValueError(f"{path}: format is {file.attrs.get('format')!r}, expected 'kinematics'")
            knots = file["shape_parameter"][...]
            arrays = {name: file[f"shape_{name}"][...] for name in NAMES}
            time, pressure = file["time"][...], file["pressure"][...]
            finger = settings_in(file, path)["finger"]
            mirror = bool(np.ravel(file.attrs.get("mirror", 0))[0])
            width, tip_width = (float(np.ravel(file.attrs[n])[0]) for n in ("finger_width", "tip_thickness"))
    except (OSError, KeyError) as error:
        raise ValueError(
            f"{path}: not a readable kinematics file ({error}); run the stage 'kinematics'"
        ) from None
    if not np.array_equal(counter_clockwise(arrays["outline"][0]), arrays["outline"][0]):
        arrays["outline"] = arrays["outline"][:, ::-1]
    splines = {name: CubicSpline(knots, values) for name, values in arrays.items()}
    root, length = finger["root"], float(finger["length"]) + float(finger.get("tip", {}).get("length", 0.0))
    return Family(
        float(knots[0]),
        float(knots[-1]),
        splines,
        CubicSpline(time, pressure),
        (float(root[0]), float(root[1])),
        length,
        width,
        tip_width,
        (float(time[0]), float(time[-1])),
        mirror,
    )


@dataclass(frozen=True)
class FingerTrack:
    """The left (or only) finger's outline and tip over time, from the kinematics; `mirror` where there is a right one."""

    pressure: CubicSpline
    splines: dict[str, CubicSpline]
    tip_width: float
    mirror: bool

    def at(self, time: float) -> dict[str, np.ndarray]:
        """Per finger, at `time` s: outline and its velocity, tip, tip_direction, dorsal_direction and bend."""
        p = float(self.pressure(time))
        found = {name: spline(p) for name, spline in self.splines.items()}
        found["outline_velocity"] = self.splines["outline"](p, 1) * float(self.pressure(time, 1))
        for name in ("tip_direction", "dorsal_direction"):
            found[name] = found[name] / np.hypot(*found[name])
        if not self.mirror:
            return {name: values[None] for name, values in found.items()}
        return {name: np.stack([values, mirrored_finger(name, values)]) for name, values in found.items()}


def mirrored_finger(name: str, values: np.ndarray) -> np.ndarray:
    """What belongs to the right finger: vectors and points mirrored in x = 0, the bend towards the ventral side as it is."""
    return values if name == "bend" else values * np.array([-1.0, 1.0])


def read_track(out: Path) -> FingerTrack:
    """The finger's track from kinematics.h5. Raises StageError where its numbers make none."""
    path = out / "kinematics.h5"
    names = {
        "outline": "shape_outline",
        "tip": "shape_tip",
        "tip_direction": "shape_tip_direction",
        "dorsal_direction": "shape_dorsal_direction",
        "bend": "shape_bend",
    }
    with read_dataset(path, "kinematics") as file:
        try:
            parameter = file["shape_parameter"].values
            splines = {name: CubicSpline(parameter, file[stored].values) for name, stored in names.items()}
            pressure = CubicSpline(file["time"].values, file["pressure"].values)
            width, mirror = float(file.attrs["tip_thickness"]), bool(file.attrs.get("mirror", 0))
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise StageError(f"{path}: damaged ({one_line(error)}); delete it and run make again") from None
    return FingerTrack(pressure, splines, width, mirror)


def counter_clockwise(outline: np.ndarray) -> np.ndarray:
    """The outline (point, 2) in the sense that `inside_sum` takes."""
    x, y = outline[:, 0], outline[:, 1]
    return outline if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0 else outline[::-1]
