"""A scene.toml alone, in a folder of any name, from kinematics to report at level smoke."""

import json

import pytest

from tests.cases.conftest import make

pytestmark = pytest.mark.openfoam

CYLINDER = """
title = "A cylinder that is pushed aside"
[body]
shape = "circle"
diameter = 0.02
centre = [-0.005, 0.15]
depth = 0.05
[motion]
source = "rigid"
displacement = { kind = "power", rate = 0.1, exponent = 0.0, smoothing = 0.02 }
end_time = 0.1
[mesh]
wall_cell = 2e-3
wall_first_layer = 0.8e-3
wall_layers = 2
tip_cell = 2e-3
near_cell = 4e-3
far_cell = 0.04
[numerics]
time_step = 2e-3
write_interval = 0.02
[camera]
columns = 256
rows = 256
scale_mm_per_px = 0.3
truth = false
centre = [0.0, 0.15]
[levels.smoke]
model = { kind = "2d" }
sheet = { spacing = 2e-3, rate_hz = 125.0 }
piv = { preset = "fast" }
"""
NAME = "No_pinch-1"  # with a capital, a dash and the name of another scene


def test_a_scene_is_its_toml_alone(project):
    """A finger's is so in the tutorial (test_tutorials)."""
    folder = project / "cases" / NAME
    folder.mkdir()
    (folder / "scene.toml").write_text(CYLINDER)
    done = make(project, NAME)
    assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-1000:]
    out = folder / "out" / "smoke"
    comparison = json.loads((out / "comparison.json").read_text())
    assert {check["kind"] for check in comparison["checks"]} == {"agreement"}
    assert CYLINDER.split('"')[1] in (out / "report.html").read_text()
