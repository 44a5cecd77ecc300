"""Layers of parallel shear are no vortices; vortices in them are."""

import cv2
import numpy as np
import pytest
import xarray as xr
from scipy import ndimage

from docs.evidence.small_scene import shared_data
from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import make_plane
from piv.vortices.field_noise import field_noise
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import lamb_oseen

X, Y = np.meshgrid(np.arange(0, 513, 8.0), np.arange(0, 385, 8.0))
LAYERS = {
    "sine": lambda n: np.sin(2 * np.pi * n / 150 + 1),
    "jet": lambda n: np.exp(-((n / 40) ** 2)),
    "mixing layer": lambda n: np.tanh(n / 30),
    "boundary layer": lambda n: 1 - np.exp(-np.maximum(n + 150, 0) / 40),
}


def sheared(layer: str, noise: float, seed: int, vortex: float = 0.0) -> xr.Dataset:
    """Shear of 3 px at any angle in noise as windows of 24 px give it, with a vortex in it."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 2 * np.pi)
    speed = 3 * LAYERS[layer](-(X - 256) * np.sin(turn) + (Y - 192) * np.cos(turn))
    u, v = lamb_oseen(X, Y, 250.0, 190.0, vortex, 40.0)
    errors = [3 * noise * ndimage.uniform_filter(rng.normal(size=X.shape), 3) for _ in "uv"]
    std = np.full(X.shape, max(noise, 1e-3))
    known = dict.fromkeys(("u_std", "v_std"), (("y", "x"), std))
    u, v = u + speed * np.cos(turn) + errors[0], v + speed * np.sin(turn) + errors[1]
    return make_plane(X[0], Y[:, 0], u, v).assign(known)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("layer", LAYERS)
def test_no_vortex_in_parallel_shear(layer, noise):
    for seed in range(3):
        plane = sheared(layer, noise, seed)
        assert find_vortices(plane, correlation_length=36.0) == []


@pytest.mark.parametrize("alike", [1, 3])
def test_no_vortex_in_shear_whose_vectors_state_no_error(alike):
    """Errors of single vectors, or alike over three; a vortex of thrice the shear stays."""
    marks = 0
    for seed in range(6):
        rng = np.random.default_rng(1000 + seed)
        errors = [ndimage.uniform_filter(rng.normal(size=X.shape), alike) for _ in "uv"]
        assert field_noise(*(alike * 0.2 * e for e in errors))[2] == alike
        plane = sheared("boundary layer", 0.0, seed).drop_vars(["u_std", "v_std"])
        u, v = (plane[n] + alike * 0.2 * e for n, e in zip("uv", errors, strict=True))
        marks += len(find_vortices(make_plane(X[0], Y[:, 0], u.values, v.values)))
        swirl = lamb_oseen(X, Y, 250.0, 190.0, 3000.0, 40.0)
        u, v = (f.values + s for f, s in zip((u, v), swirl, strict=True))
        found = find_vortices(make_plane(X[0], Y[:, 0], u, v))
        assert any(np.hypot(w.x - 250, w.y - 190) < 20 for w in found)
    assert marks == 0


@pytest.mark.parametrize("layer", LAYERS)
def test_a_vortex_in_the_shear_is_found(layer):
    # of either sense; its peak vorticity, smoothed, is three times the largest shear's
    for seed, sense in enumerate((1, -1)):
        found = find_vortices(sheared(layer, 0.03, seed, sense * 3000.0), correlation_length=36.0)
        assert any(np.hypot(w.x - 250, w.y - 190) < 20 and w.circulation * sense > 0 for w in found)


@pytest.mark.parametrize(
    "folder, count",
    [("pypiv_finger", 0), ("pivuq_particledisparity", 0), ("pivlab_karman", 3)],
)
def test_recorded_layers_bear_no_mark(folder, count):
    """Parallel fingers, a jet, and three vortices that a cylinder sheds."""
    data = shared_data()
    if data is None or not (data / folder).exists():
        pytest.skip("shared data are absent")
    paths = sorted(p for p in (data / folder).iterdir() if p.suffix in (".tif", ".bmp"))[:2]
    images = [cv2.imread(str(p), cv2.IMREAD_UNCHANGED)[:768] for p in paths]
    assert len(find_vortices(correlate_pair(*images))) == count
