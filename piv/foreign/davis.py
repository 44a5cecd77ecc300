"""Vector buffers of DaVis through lvpyio, whose library ends its process on damaged files."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.atomic import whole
from fileio.child_process import read_in_child
from fileio.errors import one_line


def read_buffer(path: Path) -> dict[str, Any]:
    """Vectors of the first frame of a .vc7.

    `u`, `v` (rows, columns), `absent` (bool), `grid` (x, y); axes `x`, `y`, `i`, each
    (slope, offset, unit).

    ValueError where lvpyio is not installed or cannot read it.
    """
    _check_installed(path)
    try:
        return read_in_child(_read, str(path.resolve()))
    except Exception as error:  # the library raises its own kinds
        raise ValueError(
            f"{path}: not a readable DaVis vector buffer ({one_line(error, 200)})"
        ) from error


def _check_installed(path: Path) -> None:
    try:
        import lvpyio  # noqa: F401  # here, and not in every child: loading it takes a second
    except ImportError:
        raise ValueError(
            f"{path}: DaVis files need the package lvpyio, which may be used but is not free "
            "software: pip install lvpyio"
        ) from None


def write_buffer(plane: xr.Dataset, path: Path) -> None:
    """Write one instant as .vc7, in mm and m/s or in px, atomically; absent vectors are masked.

    Rows run from the top and the scale of y falls, as after a calibration in DaVis, which then
    turns the sign of v.
    """
    _check_installed(path)
    import lvpyio

    in_px = plane["x"].attrs.get("units") == "px"
    factor, edge, unit = (1.0, 0.5, "px") if in_px else (1e3, 0.0, "mm")
    absent = plane["valid"].values[::-1] == 0
    values = np.zeros(absent.shape, lvpyio.vec2c)
    values["u"] = np.where(absent, 0, plane["u"].values[::-1])
    values["v"] = np.where(absent, 0, -plane["v"].values[::-1])
    buffer = lvpyio.arrays_to_buffer([np.ma.array(values, mask=absent)])
    x, y = (plane[n].values * factor + edge for n in ("x", "y"))
    step_x, step_y = x[1] - x[0], y[1] - y[0]
    scales = buffer[0].scales
    scales.x = lvpyio.Scale(step_x, x[0] - step_x / 2, unit, "x")
    scales.y = lvpyio.Scale(-step_y, y[-1] + step_y / 2, unit, "y")
    scales.i = lvpyio.Scale(
        1.0, 0.0, "px" if in_px else "m/s", "displacement" if in_px else "velocity"
    )
    buffer[0].grid = lvpyio.Grid(1, 1, 1)
    with whole(path, suffix=True) as part:
        lvpyio.write_buffer(buffer, str(part))


def _read(path: str) -> dict[str, Any]:
    import lvpyio

    frame = lvpyio.read_buffer(path)[0]
    values = frame.as_masked_array(0)
    if values.dtype.names is None or "u" not in values.dtype.names:
        raise ValueError("the DaVis buffer holds an image, not vectors")
    scales = {a: getattr(frame.scales, a) for a in ("x", "y", "i")}
    return {
        "u": values["u"].data,
        "v": values["v"].data,
        "absent": np.ma.getmaskarray(values)["u"],
        "grid": (frame.grid.x, frame.grid.y),
        **{a: (float(s.slope), float(s.offset), str(s.unit)) for a, s in scales.items()},
    }
