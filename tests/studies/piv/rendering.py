"""Speed of the renderer: a vortex that drifts through a plane series."""

import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.formats.plane_series import make_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.render_recording import render_recording
from tests.studies.piv.flows import CENTRE, lamb_oseen

SPACING_PX = 4  # of the plane series, that of the scenes: 0.5 mm
FRAMES = 24
SLOW, FAST = 1.0, 6.0  # px per frame: peak of the swirl; the vortex drifts at half of it


def drifting_vortex(peak: float, camera: Camera) -> xr.Dataset:
    """Plane series (SI) of a Lamb-Oseen vortex of 40 px core radius, a plane for every frame."""
    x = np.arange(0, camera.width_px + SPACING_PX, SPACING_PX, dtype=float)
    y = np.arange(0, camera.height_px + SPACING_PX, SPACING_PX, dtype=float)
    planes = []
    for k in range(FRAMES):
        drift = 0.5 * peak
        flow = lamb_oseen(40, peak, (CENTRE[0] + drift * (k - FRAMES / 2), CENTRE[1]))
        u, v = flow(*np.meshgrid(x, y))
        planes.append((u + drift, v))
    u, v = np.moveaxis(planes, 1, 0) * camera.pixel * camera.frame_rate_hz
    metres = camera.pixel
    return make_plane(x * metres, y * metres, u, v, time=np.arange(FRAMES) / camera.frame_rate_hz)


def rate(peak: float, truth: bool) -> float:
    """Mpx-frames per CPU second, with everything that `piv render` does but start."""
    camera = Camera()
    series = drifting_vortex(peak, camera)
    with tempfile.TemporaryDirectory() as name:
        start = time.process_time()
        render_recording(
            series, Path(name) / "images.h5", camera, Seeding(), seed=1601, truth=truth
        )
        return FRAMES * camera.width_px * camera.height_px / 1e6 / (time.process_time() - start)


def rendering() -> str:
    """A line of the benchmark's figures."""
    rate(SLOW, True)  # compiled by then
    speeds = {
        f"{label} flow": (rate(peak, False), rate(peak, True))
        for label, peak in (("slow", SLOW), ("fast", FAST))
    }
    rates = ", ".join(
        f"{label} {plain:.1f} ({exact:.1f} with the truth)"
        for label, (plain, exact) in speeds.items()
    )
    return (
        f"- Rendering, Mpx-frames per CPU second (vortex of {SLOW:g} and of {FAST:g} px per frame, "
        f"planes of {SPACING_PX} px spacing, "
        f"0.04 ppp, noise, written as recordings are): {rates}."
    )


if __name__ == "__main__":
    print(rendering())
