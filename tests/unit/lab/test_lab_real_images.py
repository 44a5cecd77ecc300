"""Real pictures: a dark body is found to a pixel."""

import cv2
import numpy as np
import pytest
from scipy.optimize import minimize

from docs.evidence.small_scene import shared_data
from piv.images.calibration import Calibration, save_calibration
from postprocess.lab.dpiv_toml import read_dpiv
from postprocess.lab.recorded import LabRecording
from postprocess.lab.silhouette import integral_image, learn
from tests.lab_scene import PICTURES, inside_sum, state


def recording(tmp_path, source: str, files: str) -> LabRecording:
    folder = (shared_data() or tmp_path) / source
    if not folder.exists():
        pytest.skip("shared data are absent")
    save_calibration(Calibration(1e-4), tmp_path / "calibration.json")
    more = {"files": f'"{folder / files}"', "frame_rate_hz": "100.0"}
    more |= {"scale": '{ calibration = "calibration.json", std_percent = 1.0 }'}
    more |= {"axes": '{ y = "down", root_px = [700.0, 40.0] }'}
    return LabRecording(read_dpiv(state(tmp_path, PICTURES | more)))


def test_edge_of_a_real_cylinder(tmp_path):
    """The circle of the likelihood against the radius of the half-way mean grey level."""
    pictures = recording(tmp_path, "pivlab_karman", "*.bmp")
    images = [pictures.frame(i) for i in range(len(pictures))]
    rows, columns = pictures.shape
    rough = np.zeros((rows, columns), np.uint8)
    cv2.circle(rough, (745, 380), 47, 1, -1)
    evidence = learn(images, [rough.astype(bool)] * len(images))
    sums = [integral_image(evidence.image(image)) for image in images]
    turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)

    def loss(a):
        circle = a[0] + a[2] * np.cos(turn), rows - 1 - a[1] + a[2] * np.sin(turn)
        outline = np.column_stack(circle)
        return -sum(inside_sum(s, outline) for s in sums)

    a = np.array([745.0, 380.0, 45.0])
    for step in (6.0, 1.0):
        simplex = {"initial_simplex": np.vstack([a, a + step * np.eye(3)])}
        a = minimize(loss, a, method="Nelder-Mead", options=simplex).x
    y, x = np.mgrid[:rows, :columns]
    away = np.hypot(x - a[0], y - a[1])
    mean = np.mean(images, axis=0)
    rings = np.arange(35, 66)
    level = np.array([mean[(away >= r - 0.5) & (away < r + 0.5)].mean() for r in rings])
    half = 0.5 * (level[:8].mean() + level[-8:].mean())
    edge = float(np.interp(half, level[8:24], rings[8:24]))
    assert a[2] == pytest.approx(edge, abs=1.0)
