"""Costs of a large pair, of a plane of many vortices and of rendering (make bench-piv).

CPU time, which other programs on the machine hardly change.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import xarray as xr

from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import make_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.render_recording import render_recording
from piv.vortices.find import find_vortices
from tests.studies.pages import machine, write_study
from tests.studies.piv.flows import CENTRE, lamb_oseen, uniform
from tests.studies.piv.particles import render
from tests.studies.piv.turbulence_field import TurbulentPlane

LARGE = (5000, 5000)  # px: 25 Mpx
SIDE = 808  # px: 100 vectors, 8 px apart
STRENGTHS = (0.8, 2.5)  # px RMS
SEEDS = range(4301, 4311)
SPACING_PX = 4  # of the plane series that is rendered, that of the scenes: 0.5 mm
FRAMES = 24
SLOW, FAST = 1.0, 6.0  # px per frame: peak of the swirl; the vortex drifts at half of it


def large_pair() -> str:
    """Memory and time of `piv correlate` of a pair of 25 Mpx."""
    with tempfile.TemporaryDirectory() as name:
        paths = [str(Path(name) / f"{k}.tif") for k in "ab"]
        images = render(uniform(3.1, 1.3), shape=LARGE, seed=4300, noise=0.05)
        for path, image in zip(paths, images, strict=True):
            cv2.imwrite(path, image)
        command = [sys.executable, "-m", "piv", "correlate", *paths, "--quiet", "-o"]
        subprocess.run([*command, str(Path(name) / "out.h5")], check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (
        f"- `piv correlate` of a pair of {np.prod(LARGE) / 1e6:.0f} Mpx, one thread: "
        f"{used.ru_maxrss / 2**20:.2f} GB at most "
        f"(2 allowed), {used.ru_utime + used.ru_stime:.0f} CPU s."
    )


def turbulent_vortices() -> str:
    """Time of finding and fitting the vortices of 100 x 100 vectors of turbulence."""
    seconds, found = [], []
    for seed in SEEDS:
        plane = TurbulentPlane(1.0, seed)
        for rms in STRENGTHS:

            def flow(x, y, rms=rms, plane=plane):
                return tuple(rms * d for d in plane(x, y, 3))

            field = correlate_pair(*render(flow, shape=(SIDE, SIDE), seed=seed, noise=0.05))
            if not seconds:
                find_vortices(field)  # compiled by then
            start = time.process_time()
            found.append(len(find_vortices(field)))
            seconds.append(time.process_time() - start)
    return (
        f"- Vortices of {field.sizes['x']} × {field.sizes['y']} vectors of turbulence of "
        f"{STRENGTHS[0]} and {STRENGTHS[1]} px, 5 % noise, {min(found)} to {max(found)} in a "
        "plane: "
        f"{np.percentile(seconds, 95):.2f} CPU s at the 95th percentile of {len(seconds)} planes "
        f"(2 allowed), median {np.median(seconds):.2f}."
    )


def drifting_vortex(peak: float, camera: Camera) -> xr.Dataset:
    """Plane series (SI) of a Lamb-Oseen vortex of 40 px core radius, a plane for every frame."""
    x, y = (np.arange(0.0, n + SPACING_PX, SPACING_PX) for n in (camera.width_px, camera.height_px))
    drift, grid = 0.5 * peak, np.meshgrid(x, y)
    places = [CENTRE[0] + drift * (k - FRAMES / 2) for k in range(FRAMES)]
    u, v = np.moveaxis([lamb_oseen(40, peak, (at, CENTRE[1]))(*grid) for at in places], 1, 0)
    u, v = (f * camera.pixel * camera.frame_rate_hz for f in (u + drift, v))
    time = np.arange(FRAMES) / camera.frame_rate_hz
    return make_plane(x * camera.pixel, y * camera.pixel, u, v, time=time)


def rate(peak: float, truth: bool) -> float:
    """Mpx-frames per CPU second, with everything that `piv render` does but start."""
    camera = Camera()
    series = drifting_vortex(peak, camera)
    with tempfile.TemporaryDirectory() as name:
        path, start = Path(name) / "images.h5", time.process_time()
        render_recording(series, path, camera, Seeding(), seed=1601, truth=truth)
        return FRAMES * camera.width_px * camera.height_px / 1e6 / (time.process_time() - start)


def rendering() -> str:
    """Speed of the renderer."""
    rate(SLOW, True)  # compiled by then
    rates = ", ".join(
        f"{label} flow {rate(peak, False):.1f} ({rate(peak, True):.1f} with the truth)"
        for label, peak in (("slow", SLOW), ("fast", FAST))
    )
    return (
        f"- Rendering, Mpx-frames per CPU second (vortex of {SLOW:g} and of {FAST:g} px per frame, "
        f"planes of {SPACING_PX} px spacing, "
        f"0.04 ppp, noise, written as recordings are): {rates}."
    )


def study() -> None:
    """All of them."""
    seeds = f"Seeds 1601, {SEEDS[0] - 1}-{SEEDS[-1]}"
    notes = large_pair(), turbulent_vortices(), rendering(), f"{seeds}; {machine()}."
    write_study("costs", [], *notes)
