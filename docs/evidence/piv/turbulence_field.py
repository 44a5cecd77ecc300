"""Plane cuts of isotropic turbulence: exact displacement functions.

Of a Gaussian, solenoidal, isotropic field with energy spectrum E(k) ~ k^-5/3 the cut's in-plane
spectra follow by integration over the wavenumber normal to it (Batchelor 1953, ch. 3): with κ the
wavenumber in the plane and S(k) = E(k)/(4πk²), the solenoidal part of the plane has ∫S dk_z, the
curl-free part ∫S k_z²/k² dk_z and the velocity normal to the plane ∫S κ²/k² dk_z. The three are
independent. Divergence then has a fifth of vorticity's mean square.
"""

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

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
