"""python -m piv.precompile: compile what Numba would in the first run, and cache it.

A vortex in a plane is rendered, correlated and found, by the commands and the kinds of arrays that
a scene's stages use.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from piv.commands import correlate, render, vortices
from piv.formats.plane_series import make_plane, write_plane
from piv.vortices.lamb_oseen_fit import lamb_oseen

TIMES = 0.002 * np.arange(1, 5)  # s
BODY = np.array([[-0.02, -0.02], [-0.01, -0.02], [-0.01, -0.01], [-0.02, -0.01]])  # m
CAMERA = {"width_px": 256, "height_px": 256, "truth": False}


def _precompile(folder: Path) -> None:
    """Run the three commands on a plane series of a vortex and a square, within `folder`."""
    axis = 1e-3 * np.arange(-25, 26)  # m
    x, y = np.meshgrid(axis, axis)
    u, v = (
        np.stack([a] * len(TIMES)).astype(np.float32) for a in lamb_oseen(x, y, 0, 0, 4e-3, 4e-3)
    )
    outline = np.stack([BODY[None]] * len(TIMES))
    (left, low), (right, high) = BODY.min(axis=0), BODY.max(axis=0)
    free = ~((x > left) & (x < right) & (y > low) & (y < high))
    fields = {"w": np.full_like(u, 0.01), "dwdz": np.zeros_like(u), "outline": outline}
    fields |= {"valid": np.stack([free] * len(TIMES)), "outline_velocity": 0 * outline}
    sheet, images, vectors = (folder / f"{name}.h5" for name in ("sheet", "images", "vectors"))
    write_plane(make_plane(axis, axis, u, v, time=TIMES, **fields), sheet)
    render.make(sheet, images, CAMERA, quiet=True)
    correlate.make(images, vectors, {}, quiet=True)
    for plane in (sheet, vectors):
        vortices.make(plane, plane.with_suffix(".csv"), {}, quiet=True)


if __name__ == "__main__":
    with TemporaryDirectory() as place:
        _precompile(Path(place))
