"""COUPLED=1 with the real solver, to its page."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, write_scene

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
    """In a process of its own: a stage that forks from one that has used threads is ended."""
    scene = write_scene(tmp_path / "scene", more=SHORT)
    words = [sys.executable, "-m", "pipeline", "run", str(scene.folder), "--level", "tiny"]
    words += ["--coupled", "-n", "1"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    page = Path(done.stdout.split("report: ")[-1].strip()).read_text(encoding="utf-8")
    assert "Pressure and water make the finger" in page
    assert "motion is prescribed; the water does not bend it" not in page
    again = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert again.returncode == 0
    assert "kinematics:" not in again.stdout  # nothing is made twice
