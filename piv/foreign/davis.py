"""Vector buffers of DaVis through lvpyio, whose library ends its process on damaged files."""

from pathlib import Path
from typing import Any

import numpy as np

from piv.files.child_process import read_in_child
from piv.files.errors import one_line


def read_buffer(path: Path) -> dict[str, Any]:
    """Vectors of the first frame of a .vc7.

    `u`, `v` (rows, columns), `absent` (bool), `grid` (x, y); axes `x`, `y`, `i`, each
    (slope, offset, unit).

    ValueError where lvpyio is not installed or cannot read it.
    """
    try:
        import lvpyio  # noqa: F401  # here, and not in every child: loading it takes a second
    except ImportError:
        raise ValueError(
            f"{path}: DaVis files need the package lvpyio, which may be used but is not free "
            "software: pip install lvpyio"
        ) from None
    try:
        return read_in_child(_read, str(path.resolve()))
    except Exception as error:  # the library raises its own kinds
        raise ValueError(
            f"{path}: not a readable DaVis vector buffer ({one_line(error, 200)})"
        ) from error


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
