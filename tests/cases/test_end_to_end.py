"""Both scenes from kinematics to report through make, at level smoke, in a copy of the project."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from piv.plane import read_plane
from tests.conftest import ROOT

pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(shutil.which("pimpleFoam") is None, reason="OpenFOAM is not installed"),
]
PARTS = ("Makefile", "requirements.lock", "cases", "pipeline", "piv", "postprocess")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy of the project without results, with this environment linked in."""
    folder = tmp_path_factory.mktemp("project")
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("out", "__pycache__"))
        else:
            shutil.copy2(source, folder / part)
    (folder / ".venv").symlink_to(ROOT / ".venv")
    return folder


def make(project: Path, *arguments: str) -> subprocess.CompletedProcess:
    command = ["make", "--no-print-directory", "LEVEL=smoke", "QUIET=1", "READY=Makefile", *arguments]
    return subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def finger(project):
    done = make(project, "single_finger")
    assert done.returncode == 0, done.stderr[-3000:]
    assert "report.html" in done.stdout
    return project / "cases" / "single_finger" / "out" / "smoke"


def tip_vortex(out: Path, name: str) -> pd.DataFrame:
    """The strongest track's rows while the finger is half-way."""
    table = pd.read_csv(out / name, comment="#")
    table = table[(table["time"] > 0.14) & (table["time"] < 0.25)]
    strength = table.groupby("track")["circulation"].apply(lambda c: c.abs().sum())
    return table[table["track"] == strength.idxmax()]


def test_one_clockwise_vortex_on_the_dorsal_side_seen_alike(finger):
    cfd, piv = (tip_vortex(finger, f"vortices_{source}.csv") for source in ("cfd", "piv"))
    for table in (cfd, piv):
        assert (table["circulation"] < 0).all()
        assert (table["side"] == "dorsal").all()
    for name, tolerance in (("circulation", 0.05), ("x", 1.5e-3), ("y", 1.5e-3)):  # the issue's own figures
        seen = np.interp(piv["time"], cfd["time"], cfd[name])
        scale = np.abs(seen).max() if name == "circulation" else 1.0
        assert np.abs(piv[name] - seen).max() < tolerance * scale, name


def test_the_report_and_its_tables_are_there(finger):
    assert (finger / "report.html").stat().st_size > 100_000
    checks = {c["id"]: c for c in json.loads((finger / "comparison.json").read_text())["checks"]}
    assert checks["tip-vortex-dorsal"]["met"]
    assert checks["centre-agrees"]["met"]
    run = json.loads((finger / "run" / "run.json").read_text())
    assert run["cells"] == pytest.approx(3000, rel=0.3)
    assert 0 < run["power_balance"]["closure_fraction"] < 0.6


def test_a_second_make_does_nothing_and_a_number_redoes_only_what_follows(finger, project):
    def made() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in finger.rglob("*") if path.is_file()}

    before = made()
    (project / "pipeline" / "run.py").touch()  # editing Python does not solve again
    assert make(project, "single_finger").returncode == 0
    assert made() == before
    scene = project / "cases" / "single_finger" / "scene.toml"
    scene.write_text(scene.read_text().replace("spacing = 8", "spacing = 12"))
    done = make(project, "single_finger.vortices")
    assert done.returncode == 0, done.stderr[-3000:]
    after = made()
    redone = {path.name for path in before if after[path] != before[path] and path.suffix == ".h5"}
    assert redone == {"piv.h5"}
    with read_plane(finger / "piv.h5") as plane:
        assert float(plane["x"][1] - plane["x"][0]) == pytest.approx(12 * 1.25e-4)


def test_deflation_draws_the_water_up_along_the_fingers_trace(project):
    done = make(project, "single_deflate")
    assert done.returncode == 0, done.stderr[-3000:]
    out = project / "cases" / "single_deflate" / "out" / "smoke"
    checks = {c["id"]: c for c in json.loads((out / "comparison.json").read_text())["checks"]}
    upward = [c for name, c in checks.items() if "upward" in name]
    assert upward
    assert all(c["met"] for c in upward), [c["measured"] for c in upward]
    with read_plane(out / "sheet.h5") as plane:
        bend = plane["bend"].values[:, 0]
    assert bend.min() < np.radians(-90)


def test_wrong_input_is_one_sentence(project):
    done = make(project, "single_finger", "LEVEL=huge")
    assert done.returncode != 0
    told = [line for line in done.stderr.splitlines() if line.startswith("settings:")]
    assert len(told) == 1
    assert "no level 'huge'" in told[0]
