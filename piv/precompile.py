"""python -m piv.precompile: compile what Numba would in the first run, and keep it beside the modules (make setup).

A vortex in a plane is rendered, correlated and found, by the commands and the kinds of arrays that a scene's stages use.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fileio.formats.plane_series import make_plane, write_plane
from piv.__main__ import main
from piv.vortices.lamb_oseen_fit import lamb_oseen

SPACING = 1e-3  # m
TIMES = 0.002 * np.arange(1, 5)  # s
CIRCULATION, CORE = 4e-3, 4e-3  # m²/s, m
BODY = np.array([[-0.02, -0.02], [-0.01, -0.02], [-0.01, -0.01], [-0.02, -0.01]])  # m
CAMERA = ("--width-px", "256", "--height-px", "256", "--scale-m-per-px", "1.25e-4")


def precompile(folder: Path) -> None:
    """Run the three commands on a plane series of a Lamb-Oseen vortex and a square at rest in water that passes the sheet, all within `folder`."""
    axis = SPACING * np.arange(-25, 26)
    x, y = np.meshgrid(axis, axis)
    plane = [
        np.stack([a] * len(TIMES)).astype(np.float32)
        for a in lamb_oseen(x, y, 0.0, 0.0, CIRCULATION, CORE)
    ]
    outline = np.stack([BODY[None]] * len(TIMES))
    sheet, images, vectors = (folder / f"{name}.h5" for name in ("sheet", "images", "vectors"))
    through, rest = np.full_like(plane[0], 0.01), np.zeros_like(plane[0])
    (left, low), (right, high) = BODY.min(axis=0), BODY.max(axis=0)
    water = ~((x > left) & (x < right) & (y > low) & (y < high))
    valid = np.stack([water] * len(TIMES))
    write_plane(
        make_plane(
            axis,
            axis,
            *plane,
            time=TIMES,
            valid=valid,
            w=through,
            dwdz=rest,
            outline=outline,
            outline_velocity=0 * outline,
        ),
        sheet,
    )
    for words in (
        ["render", sheet, "-o", images, "--no-truth", *CAMERA],
        ["correlate", images, "-o", vectors],
        ["vortices", sheet, "-o", folder / "sheet.csv"],
        ["vortices", vectors, "-o", folder / "vectors.csv"],
    ):
        if code := main([*map(str, words), "--quiet"]):
            raise SystemExit(code)


if __name__ == "__main__":
    with TemporaryDirectory() as place:
        precompile(Path(place))
