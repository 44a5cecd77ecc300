"""What a current carries through the tank's ends, from the solver's tables."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy import ndarray

from pipeline.openfoam.function_objects import read_function_object, table_rows, tables

ENDS = ("upstream", "downstream")  # patches where the current enters and leaves
WALLS = ("tank", "top", "back", "front")  # patches on which it may rub
_TABLE = "surfaceFieldValue.dat"


def newest_rows(folder: Path, name: str) -> ndarray:
    """Rows (time, …) since the solver's last start of a table `name` of a function object."""
    parts = tables(folder, name.replace(".", "*."))
    return table_rows(parts[-1][1]) if parts else np.empty((0, 1))


def power_through(
    samples: Path, density: float, read: Callable[[Path, str], ndarray] = newest_rows
) -> ndarray:
    """Rows (time in s, power in W) that the water takes through the tank's ends.

    It is the work of the pressure there, and the kinetic energy that is carried in less that which
    is carried out. `samples`: postProcessing of a case; rows end where one of its tables does.
    """
    up, down = (read(samples / f"{end}Carried", _TABLE) for end in ENDS)
    count = min(len(up), len(down))
    if not count:
        return np.empty((0, 2))
    carried = up[:count, 1:3] + down[:count, 1:3]
    return np.column_stack([up[:count, 0], -density * carried @ [1.0, 0.5]])


def through_rows(samples: Path, density: float, sign: float, copies: int) -> ndarray:
    """Rows THROUGH_FLOW of the whole tank, which holds `copies` of the computed part.

    `sign`: of the current's direction along x.
    """

    def rows(name: str, file: str = _TABLE) -> ndarray:
        return read_function_object(samples / name, file)

    power = power_through(samples, density, read_function_object)
    flux = [rows(f"{end}Flux")[:, 1] for end in ENDS]
    pressed = [rows(f"{end}Pressure")[:, 1] for end in ENDS]
    carried = [rows(f"{end}Carried")[:, 3] for end in ENDS]
    push = density * (sign * (pressed[0] - pressed[1]) - carried[0] - carried[1])
    inside = density * rows("momentum", "volFieldValue.dat")[:, 1]
    walls = rows("wallForces", "force.dat")[:, 1]
    columns = [-flux[0], flux[1], power[:, 1], push, inside, walls]
    return np.column_stack([power[:, 0], *(copies * column for column in columns)])
