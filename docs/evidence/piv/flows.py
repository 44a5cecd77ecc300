"""Displacement functions (px, y up) of the benchmark, and its conditions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SHAPE = (1024, 1280)
CENTRE = (640.0, 512.0)
NOISE, LOSS = 0.05, 0.25  # of the grey scale; out-of-plane shift as a part of the sheet


@dataclass(frozen=True)
class Case:
    """A flow and how it is pictured; `core`: radius (px) within which the error is also given."""

    flow: Callable
    noise: float = NOISE
    loss: float = 0.0
    core: float = 0.0
    hole: float = 0.0  # radius around the centre that is left out


def uniform(dx: float, dy: float):
    """The same displacement everywhere."""
    return lambda x, y: (dx + 0 * x, dy + 0 * x)


def lamb_oseen(core: float, peak: float, centre=CENTRE):
    """Vortex of core radius `core` and peak swirl `peak`."""

    def flow(x, y):
        rx, ry = x - centre[0], y - centre[1]
        r2 = rx**2 + ry**2 + 1e-9
        top = (1 - np.exp(-(1.12091**2))) / 1.12091
        swirl = peak * core / top / r2 * (1 - np.exp(-r2 / core**2))
        return -swirl * ry, swirl * rx

    return flow


def sine(wavelength: float, amplitude: float):
    """u varies as a sine in y."""
    return lambda x, y: (amplitude * np.sin(2 * np.pi * y / wavelength), 0 * x)


def shear(gradient: float):
    """u grows with y."""
    return lambda x, y: (gradient * (y - CENTRE[1]), 0 * x)


def cylinder(radius: float, speed: float):
    """Potential flow round a cylinder, frozen inside 0.6 radii."""

    def flow(x, y):
        rx, ry = x - CENTRE[0], y - CENTRE[1]
        r2 = np.maximum(rx**2 + ry**2, (0.6 * radius) ** 2)
        a = radius**2 / r2**2
        return speed * (1 - a * (rx**2 - ry**2)), -2 * speed * a * rx * ry

    return flow


def random_field(seed: int, rms: float = 1.5, waves: int = 60):
    """Random waves of 45 to 300 px, longitudinal and transverse ones."""
    rng = np.random.default_rng(seed)
    k = np.exp(rng.uniform(np.log(1 / 300), np.log(1 / 45), waves))
    angle, phase = rng.uniform(0, 2 * np.pi, (2, waves))
    towards = rng.uniform(0, 2 * np.pi, waves)
    size = 1 / k
    size *= rms / np.sqrt(np.sum(size**2) / 2)

    def flow(x, y):
        u, v = 0 * x, 0 * x
        for i in range(waves):
            along = np.cos(angle[i]) * x + np.sin(angle[i]) * y
            wave = size[i] * np.sin(2 * np.pi * k[i] * along + phase[i])
            u, v = u + wave * np.cos(towards[i]), v + wave * np.sin(towards[i])
        return u, v

    return flow


CASES = {
    "uniform, clean": Case(uniform(4.63, -2.28), noise=0),
    "uniform": Case(uniform(4.63, -2.28)),
    "uniform, loss": Case(uniform(4.63, -2.28), loss=LOSS),
    "vortex 40, clean": Case(lamb_oseen(40, 6), noise=0, core=80),
    "vortex 40": Case(lamb_oseen(40, 6), core=80),
    "vortex 40, loss": Case(lamb_oseen(40, 6), loss=LOSS, core=80),
    "vortex 20": Case(lamb_oseen(20, 6), core=40),
    "sine 128": Case(sine(128, 2)),
    "sine 64": Case(sine(64, 2)),
    "sine 32": Case(sine(32, 1)),
    "shear": Case(shear(0.03)),
    "shear, loss": Case(shear(0.03), loss=LOSS),
    "cylinder": Case(cylinder(100, 6), hole=130),
    "cylinder, loss": Case(cylinder(100, 6), loss=LOSS, hole=130),
}
