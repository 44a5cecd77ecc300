"""Frames of docs/tutorials/piv.md: python -m tests.studies.pictures.tutorial_frames docs/tutorials/frames (repository root)."""

import sys
from pathlib import Path

import cv2
import numpy as np

from fileio.formats.plane_series import make_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.virtual_camera import Recorder
from piv.vortices.lamb_oseen_fit import lamb_oseen

FRAMES, RATE_HZ = 6, 500.0
FINGER = np.array([[6.0, 12.0], [10.0, 12.0], [10.0, 24.0], [6.0, 24.0]]) * 1e-3  # m


def main(folder: str) -> None:
    """A vortex below the end of a dark finger, as a camera of 0.1 mm/px at 500 Hz sees it."""
    x, y = np.arange(0, 0.0231, 5e-4), np.arange(0, 0.0201, 5e-4)
    xx, yy = np.meshgrid(x, y)
    u, v = lamb_oseen(xx, yy, 0.0150, 0.0085, 6e-3, 2e-3)
    body = (xx > FINGER[0, 0]) & (xx < FINGER[1, 0]) & (yy > FINGER[0, 1])
    u, v = (np.tile(np.where(body, np.nan, field), (FRAMES, 1, 1)) for field in (u, v))
    outline = np.tile(FINGER, (FRAMES, 1, 1, 1))
    series = make_plane(x, y, u, v, time=np.arange(FRAMES) / RATE_HZ, outline=outline)
    camera = Camera(width_px=224, height_px=192, scale_m_per_px=1e-4)
    frames = Recorder(series, camera, Seeding(density_ppp=0.05), seed=5).frames()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for k, frame in enumerate(frames):
        cv2.imwrite(str(Path(folder) / f"frame_{k}.png"), frame.image)


if __name__ == "__main__":
    main(sys.argv[1])
