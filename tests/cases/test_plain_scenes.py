"""A scene.toml alone, in a folder of any name, from kinematics to report at level smoke."""

import json

import pytest

from tests.cases.conftest import make

pytestmark = pytest.mark.openfoam

WATER = """
[numerics]
time_step = 2e-3
write_interval = 0.02
[camera]
columns = 256
rows = 256
scale_mm_per_px = 0.3
truth = false
centre = {centre}
[levels.smoke]
model = {{ kind = "2d" }}
sheet = {{ spacing = 2e-3, rate_hz = 125.0 }}
piv = {{ preset = "fast" }}
"""
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
""" + WATER.format(centre="[0.0, 0.15]")
NEAR_THE_BOTTOM = """
title = "A finger of its own"
[finger]
root = [0.0, 0.095]
length = 0.07
thickness = 0.0145
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.005, duration = 0.1 }]
end_time = 0.1
[mesh]
wall_cell = 3.5e-3
wall_first_layer = 1.2e-3
wall_layers = 2
tip_cell = 2.2e-3
near_cell = 5e-3
far_cell = 0.04
""" + WATER.format(centre="[0.01, 0.045]")
# names with a dash and a capital, and with the name of another scene
SCENES = {"no_pinch": CYLINDER, "Low-1": NEAR_THE_BOTTOM}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_its_toml_alone(project, name):
    folder = project / "cases" / name
    folder.mkdir()
    (folder / "scene.toml").write_text(SCENES[name])
    done = make(project, name)
    assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-1000:]
    warnings = [line for line in done.stdout.splitlines() if "0.1 m" in line]
    assert len(warnings) == (name == "Low-1")
    out = folder / "out" / "smoke"
    comparison = json.loads((out / "comparison.json").read_text())
    assert {check["kind"] for check in comparison["checks"]} == {"agreement"}
    assert SCENES[name].split('"')[1] in (out / "report.html").read_text()
