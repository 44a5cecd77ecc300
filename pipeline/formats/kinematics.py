"""The motion of one finger or rigid body, `kinematics.h5`: pressure over time, shapes over it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.errors import StageError, one_line
from piv.files.schema import Schema, variables

if TYPE_CHECKING:  # slow to import: who reads no motion needs none
    from scipy.interpolate import CubicSpline

_SHAPES = ("outline", "tip", "tip_direction", "dorsal_direction", "bend")
SHAPE = "shape_parameter"
SHAPE_OF_TIME = "shape_parameter_of_time"

SCHEMA = Schema(
    "kinematics",
    variables("""
time  time  s  instants of the law
pressure  time  Pa  of the shape; of a rigid body the distance travelled (m, or rad)
shape_parameter_of_time?  time  s  of each instant; absent: the pressure, else the time itself
free_pressure?  time  Pa  pinch: in the chambers; goes on when the fingers are stopped
gap?  time  m  pinch: least distance of the outline to x = 0 or to the object
shape_parameter  shape_parameter  Pa  of each shape, ascending: its pressure, or the time
shape_outline  shape_parameter, point, axis  m  closed outline
shape_tip  shape_parameter, axis  m  middle of the tip; of a rigid body its centre
shape_tip_direction  shape_parameter, axis  1  unit vector out of the tip, along the finger
shape_dorsal_direction  shape_parameter, axis  1  unit vector to the dorsal side at the tip
shape_bend  shape_parameter  rad  bend angle; of a rigid body its turn
shape_gap?  shape_parameter  m  pinch: `gap` of each shape
shape_edges?  shape_parameter, edge, axis  m  rigid body: where the mesh is fine
state_pressure?  state  Pa  finger: pressure of each bending state
state_bend?  state  rad  finger: bend angle of each state
paper_bend?  state  rad  the paper's finger: bend angle by its equations (1)–(6)
state_bend_std?  state  rad  standard uncertainty of `state_bend`, where known
source  -  -  `motion.source` of the scene
root  -  m  middle of the root, x and y; of a rigid body its centre
length  -  m  of the finger with its passive tip; of a rigid body its size
tip_thickness  -  m  of the finger's end at rest; of a rigid body its size
peak_tip_speed?  -  m/s  finger: largest speed of the tip
mirror?  -  1  pinch: 1, a second finger is the mirror image in x = 0
residual_gap?  -  m  pinch: gap at which a finger is stopped
least_gap?  -  m  pinch: smallest value of `gap`
peak_closing_speed?  -  m/s  pinch: largest rate at which one finger's gap falls
contact_time?  -  s  pinch: first instant within 0.1 mm of the residual gap, if any
"""),
)
write_kinematics = SCHEMA.write


@dataclass(frozen=True)
class Kinematics:
    """A motion in the tank frame: the `law` of the shape parameter over time (s), SHAPES over it.

    The parameter is the pressure (Pa), or the time where the motion does not follow from the
    pressure alone. `data`: the file's variables; `mirror`: there
    is a second finger, the image in x = 0.
    """

    data: xr.Dataset
    law: "CubicSpline"
    splines: dict[str, "CubicSpline"]
    mirror: bool

    @property
    def time(self) -> tuple[float, float]:
        """First and last instant of the law, s."""
        return float(self.law.x[0]), float(self.law.x[-1])

    @property
    def low(self) -> float:
        """Pressure (Pa) of the first shape."""
        return float(self.data[SHAPE][0])

    @property
    def high(self) -> float:
        """Pressure (Pa) of the last shape."""
        return float(self.data[SHAPE][-1])

    @property
    def tip_width(self) -> float:
        """Thickness of the finger's end at rest, m: the unit of lengths around the tip."""
        return float(self.data.attrs["tip_thickness"])

    @property
    def root(self) -> tuple[float, float]:
        """Middle of the finger's root, m."""
        x, y = self.data.attrs["root"]
        return float(x), float(y)

    @property
    def length(self) -> float:
        """Length of the finger with its passive tip, m."""
        return float(self.data.attrs["length"])

    def values(self, name: str) -> ndarray | None:
        """A variable of SCHEMA; None where the file has none."""
        return self.data[name].values if name in self.data.variables else None

    def shape(self, name: str, pressure: float | ndarray) -> ndarray:
        """One of SHAPES at pressures (…): `outline` (…, point, 2), `bend` (…), else (…, 2).

        Outside the range of the shapes it goes on linearly: a recording may bend further than the
        simulation.
        """
        at = np.asarray(pressure, float)
        inside, spline = np.clip(at, self.low, self.high), self.splines[name]
        slope = spline(inside, 1)
        beyond = (at - inside).reshape(at.shape + (1,) * (slope.ndim - at.ndim))
        return np.asarray(spline(inside) + beyond * slope)

    def fingers(self, name: str, pressure: float) -> ndarray:
        """`shape` of every finger, (finger, …)."""
        return self._of_fingers(name, np.asarray(self.shape(name, pressure)))

    def _of_fingers(self, name: str, own: ndarray) -> ndarray:
        return np.stack([own, mirrored_finger(name, own)]) if self.mirror else own[None]

    def at(self, time: float) -> dict[str, ndarray]:
        """Per finger, at `time` s: each of SHAPES, and the outline's velocity."""
        p = float(self.law(time))
        shapes = {name: spline(p) for name, spline in self.splines.items()}
        shapes["outline_velocity"] = self.splines["outline"](p, 1) * float(self.law(time, 1))
        for name in ("tip_direction", "dorsal_direction"):
            shapes[name] = shapes[name] / np.hypot(*shapes[name])
        return {name: self._of_fingers(name, own) for name, own in shapes.items()}

    def bend(self, pressure: ndarray) -> ndarray:
        """Bend angles (rad) at pressures (n,)."""
        return np.ravel(self.shape("bend", pressure))

    def bend_std(self, pressure: float) -> float | None:
        """Standard uncertainty of the bend angle (rad) at a pressure; None where unknown."""
        std = self.values("state_bend_std")
        return None if std is None else float(np.interp(pressure, self.data["state_pressure"], std))


def read_kinematics(path: Path) -> Kinematics:
    """The motion in a kinematics.h5. StageError where it is damaged or of another format."""
    from scipy.interpolate import CubicSpline

    data = SCHEMA.read(path)
    try:
        parameter = data[SHAPE_OF_TIME if SHAPE_OF_TIME in data else "pressure"].values
        law = CubicSpline(data["time"].values, parameter)
        if not np.ptp(data["shape_outline"].values, axis=1).all():
            raise ValueError("a body of no size")
        splines = {
            name: CubicSpline(data[SHAPE].values, data[f"shape_{name}"].values) for name in _SHAPES
        }
    except ValueError as error:
        raise StageError(f"{path}: damaged ({one_line(error)}); {SCHEMA.remedy}") from None
    return Kinematics(data, law, splines, bool(data.attrs.get("mirror", 0)))


def mirrored_finger(name: str, values: ndarray) -> ndarray:
    """The right finger's vectors and points, mirrored in x = 0; its bend angle is the same."""
    return values if name == "bend" else values * np.array([-1.0, 1.0])


def counter_clockwise(outline: ndarray) -> ndarray:
    """The outline (point, 2) in the sense that `inside_sum` takes."""
    x, y = outline[:, 0], outline[:, 1]
    return outline if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0 else outline[::-1]
