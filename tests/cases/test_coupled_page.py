"""COUPLED=1 with the real solver, to its page."""

import shutil

import pytest

from pipeline.__main__ import main
from pipeline.runs.make import Machine
from pipeline.runs.run import open_run
from pipeline.study.couple import couple
from tests.conftest import write_scene

pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("pimpleFoam") is None, reason="OpenFOAM is not installed"),
]
SHORT = """
[motion]
strokes = [{ pressure_kpa = 6.0, start = 0.002, duration = 0.2 }]
end_time = 0.02
[camera]
columns = 320
rows = 256
[piv]
every = 4
preset = "fast"
[structure]
tolerance = 0.02
"""


def test_a_coupled_run_reaches_its_page_which_does_not_call_the_motion_prescribed(tmp_path):
    scene = write_scene(tmp_path / "scene", more=SHORT)
    run = couple(open_run(scene.folder, "tiny").scene, Machine(), quiet=True)
    page = run.path("report").read_text(encoding="utf-8")
    assert "Pressure and water make the finger" in page
    assert "motion is prescribed; the water does not bend it" not in page
    words = ["run", str(scene.folder), "--level", "tiny", "--coupled", "--quiet", "-n", "1"]
    assert main(words) == 0  # finds all of it done
