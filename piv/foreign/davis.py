"""Vector buffers of DaVis, .vc7."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piv.foreign.vectors import Vectors, on_grid, spelled
from piv.images.recordings.davis import read_with_lvpyio, scale_of


def read_davis(path: Path) -> Iterator[Vectors]:
    """Vectors of the first frame of a buffer, scaled; disabled and masked ones are absent.

    Positions are grid index x grid x slope + offset (DaVis) and v is positive in the direction of
    the axis that DaVis scaled; rows run from the top, so y is "up" where that scale's slope is
    negative, as after a calibration, else "down".
    """
    buffer = read_with_lvpyio(path, _read)
    absent = buffer["absent"]
    (slope_x, offset_x, unit_x), (slope_y, offset_y, _) = buffer["x"], buffer["y"]
    rows, columns = absent.shape
    x = (np.arange(columns) + 0.5) * buffer["grid"][0] * slope_x + offset_x
    y = (np.arange(rows) + 0.5) * buffer["grid"][1] * slope_y + offset_y
    u, v = (np.where(absent, np.nan, buffer[n]) for n in ("u", "v"))
    # DaVis counts from the edge of the first pixel, we from its centre
    if spelled(unit_x) == "px":
        x, y = x - 0.5, y - 0.5
    grid = on_grid(path, [*np.meshgrid(x, y), u, v], np.where(absent, 2, 0))
    velocity = spelled(buffer["i"][2])
    velocity = "px/frame" if velocity == "px" else velocity
    yield Vectors(*grid, spelled(unit_x) or None, velocity or None, "down" if slope_y > 0 else "up")


def _read(path: str) -> dict[str, Any]:
    import lvpyio

    frame = lvpyio.read_buffer(path)[0]
    values = frame.as_masked_array(0)
    if values.dtype.names is None or "u" not in values.dtype.names:
        raise ValueError("the DaVis buffer holds an image, not vectors")
    return {
        "u": values["u"].data,
        "v": values["v"].data,
        "absent": np.ma.getmaskarray(values)["u"],
        "grid": (frame.grid.x, frame.grid.y),
        **{axis: scale_of(getattr(frame.scales, axis)) for axis in ("x", "y", "i")},
    }
