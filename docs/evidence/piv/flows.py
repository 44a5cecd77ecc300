"""Displacement functions (px, y up) of the benchmark, and its conditions.

Of a Gaussian, solenoidal, isotropic field of turbulence with energy spectrum E(k) ~ k^-5/3 the
plane cut's spectra in the plane follow by integration over the wavenumber normal to it (Batchelor
1953, ch. 3): with κ the wavenumber in the plane and S(k) = E(k)/(4πk²), the solenoidal part of
the plane has ∫S dk_z, the curl-free part ∫S k_z²/k² dk_z and the velocity normal to the plane ∫S
κ²/k² dk_z. The three are independent. Divergence then has a fifth of vorticity's mean square.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

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


# of turbulence
LONGEST, SHORTEST = 400.0, 20.0  # px: wavelengths of the inertial range, nothing beyond either
# px: rows and columns after which the field repeats; four of the longest waves and more
DOMAIN = (1600, 2000)
DEPTHS = 400  # points of the integral over k_z


def plane_spectra(wavenumber: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectral densities of the solenoidal part, the curl-free part, the normal velocity."""
    low, high = 2 * np.pi / LONGEST, 2 * np.pi / SHORTEST
    own, index = np.unique(np.rint(wavenumber / high * 4000).astype(int), return_inverse=True)
    kappa = own * high / 4000
    first = np.sqrt(np.maximum(low**2 - kappa**2, 0))
    last = np.sqrt(np.maximum(high**2 - kappa**2, 0))
    share = (np.arange(DEPTHS) + 0.5) / DEPTHS
    # points crowd where the integrand is steep, at the lower end
    depth = first[:, None] + (last - first)[:, None] * share**3
    step = (last - first)[:, None] * 3 * share**2 / DEPTHS
    k2 = kappa[:, None] ** 2 + depth**2
    density = np.maximum(k2, 1e-12) ** (-11 / 6) * step
    parts = (density, density * depth**2 / k2, density * (1 - depth**2 / k2))
    out = (np.sum(p, axis=1)[index].reshape(wavenumber.shape) for p in parts)
    return tuple(np.where(wavenumber > 0, p, 0) for p in out)  # type: ignore[return-value]


class TurbulentPlane:
    """Displacement (dx, dy, dz px) in a plane of `rms` px per component; x right, y up."""

    def __init__(self, rms: float, seed: int):
        rng = np.random.default_rng(seed)
        ky, kx = (2 * np.pi * np.fft.fftfreq(n) for n in DOMAIN)
        kx, ky = np.meshgrid(kx, ky)
        kappa = np.hypot(kx, ky)
        parts = (np.sqrt(p) * np.fft.fft2(rng.normal(size=DOMAIN)) for p in plane_spectra(kappa))
        solenoidal, free, normal = parts
        cos, sin = (np.divide(k, kappa, out=np.zeros_like(k), where=kappa > 0) for k in (kx, ky))
        u, v = 1j * (cos * free - sin * solenoidal), 1j * (sin * free + cos * solenoidal)
        fields = [np.fft.ifft2(f).real for f in (u, v, normal)]
        scale = rms / np.sqrt(np.mean([np.mean(f**2) for f in fields]))
        # order 3 on points one pixel apart errs by 1e-4 of a wave of 20 px
        self._splines = [spline_filter(scale * f, order=3, mode="grid-wrap") for f in fields]

    def __call__(self, x, y, components: int = 2):
        """Displacement at (x, y), px: two components, or three with the one out of the plane."""
        at = np.stack([np.asarray(y, float) + 100, np.asarray(x, float) + 100])
        way = {"order": 3, "prefilter": False, "mode": "grid-wrap"}
        return tuple(map_coordinates(f, at, **way) for f in self._splines[:components])
