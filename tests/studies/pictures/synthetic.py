"""Picture of docs/synthetic.md: python -m tests.studies.pictures.synthetic docs/synthetic.png (repository root)."""

import sys

import matplotlib.pyplot as plt
import numpy as np

from fileio.formats.plane_series import make_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.virtual_camera import Recorder
from piv.vortices.lamb_oseen_fit import lamb_oseen


def main(path: str) -> None:
    """A frame with body and shadow, and streaks of 15 frames added up."""
    x, y = np.arange(0, 0.0601, 1e-3), np.arange(0, 0.0501, 1e-3)
    xx, yy = np.meshgrid(x, y)
    u, v = lamb_oseen(xx, yy, 0.038, 0.022, -0.015, 6e-3)
    body = (xx > 0.014) & (xx < 0.026) & (yy > 0.02)
    n = 16
    u, v = (np.tile(np.where(body, np.nan, f), (n, 1, 1)) for f in (u, v))
    corners = np.array([[0.014, 0.02], [0.026, 0.02], [0.026, 0.036], [0.014, 0.036]])
    series = make_plane(x, y, u, v, time=np.arange(n) / 500, outline=np.tile(corners, (n, 1, 1, 1)))
    camera = Camera(width_px=448, height_px=352)
    recorder = Recorder(series, camera, Seeding(shadow=0.9), seed=1)
    frames = [frame.image.astype(float) for frame in recorder.frames()]
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for axis, image, title in (
        (axes[0], frames[0], "one frame: black body, shadow above it"),
        (axes[1], np.max(frames, axis=0), "brightest of 16 frames: the same particles move on"),
    ):
        axis.imshow(image, cmap="gray", vmin=0, vmax=200)
        axis.set(title=title, xlabel="column, px", ylabel="row, px")
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main(sys.argv[1])
