"""Costs of a large pair and of a plane of many vortices (make bench-piv).

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

from docs.evidence.piv.flows import TurbulentPlane, uniform
from docs.evidence.piv.pages import machine, write_study
from docs.evidence.piv.particles import render
from piv.correlation.pair import correlate_pair
from piv.vortices.find import find_vortices

LARGE = (5000, 5000)  # px: 25 Mpx
SIDE = 808  # px: 100 vectors, 8 px apart
STRENGTHS = (0.8, 2.5)  # px RMS
SEEDS = range(4301, 4311)


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
    seconds, found = list[float](), list[int]()
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


def study() -> None:
    """All of them."""
    seeds = f"Seeds {SEEDS[0] - 1}-{SEEDS[-1]}"
    notes = large_pair(), turbulent_vortices(), f"{seeds}; {machine()}."
    write_study("costs", [], *notes)
