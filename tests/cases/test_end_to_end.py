"""Scenes from kinematics to report through make, at level smoke, in a copy of the project."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from docs.evidence.examples import NAMES, place, run_example
from pipeline.formats.finger_loads import read_loads
from pipeline.openfoam.function_objects import read_function_object
from pipeline.scene.scene import load_scene
from piv.formats.plane_series import read_plane
from postprocess.compare.stage import compare
from postprocess.evidence.stage_files import StageFiles
from tests.cases.conftest import make
from tests.conftest import CASES, ROOT

pytestmark = pytest.mark.openfoam


def made(project: Path, scene: str, stage: str = "") -> Path:
    """Make a scene, up to its page or a stage; the folder of its results."""
    done = make(project, scene + stage)
    assert done.returncode == 0, done.stderr[-3000:]
    return project / "cases" / scene / "out" / "smoke"


@pytest.fixture(scope="module")
def finger(project):
    return made(project, "single_finger")


def read(path: Path) -> dict:
    return json.loads(path.read_text())


def checks_of(out: Path) -> dict[str, dict]:
    return {check["id"]: check for check in read(out / "comparison.json")["checks"]}


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
    # tolerances of the findings
    for name, tolerance in (("circulation", 0.05), ("x", 1.5e-3), ("y", 1.5e-3)):
        seen = np.interp(piv["time"], cfd["time"], cfd[name])
        scale = np.abs(seen).max() if name == "circulation" else 1.0
        assert np.abs(piv[name] - seen).max() < tolerance * scale, name


def test_the_report_and_its_tables_are_there(finger):
    assert (finger / "report.html").stat().st_size > 100_000
    checks, run = checks_of(finger), read(finger / "run" / "run.json")
    assert checks["tip-vortex-dorsal"]["met"]
    assert checks["centre-agrees"]["met"]
    assert run["cells"] == pytest.approx(3000, rel=0.3)
    assert 0 < run["power_balance"]["closure_fraction"] < 0.6


def test_loads_along_the_finger_are_those_of_the_solver(finger):
    """1e-5: both sum the same faces, the samples in single precision."""
    loads = read_loads(finger / "loads.h5")
    folder = finger / "case" / "interval_0" / "postProcessing" / "forces"
    raw = read_function_object(folder, "moment.dat")
    solver = np.interp(loads["time"], raw[:, 0], raw[:, 3])
    assert np.abs(loads["root_moment"].values - solver).max() < 1e-5 * np.abs(solver).max()
    page = (finger / "report.html").read_text(encoding="utf-8")
    # since runs can be coupled the page states the bend in modelled water, and what to do about it
    assert "By a chain of slices in modelled water, a finger with this pressure would be" in page
    assert loads.attrs["unknown"] == ""
    apart = np.abs(loads["bend_in_water"] - loads["bend"]).values.max()
    assert 0.05 < apart < 1.0  # rad


def test_a_second_make_does_nothing_and_a_number_redoes_what_follows(finger, project, tmp_path):
    own = shutil.copytree(project, tmp_path / "own", symlinks=True)
    out = own / finger.relative_to(project)

    def dates() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}

    before = dates()
    (own / "pipeline" / "solve" / "solver.py").touch()  # editing Python does not solve again
    assert make(own, "single_finger").returncode == 0
    assert dates() == before
    scene = own / "cases" / "single_finger" / "scene.toml"
    scene.write_text(scene.read_text().replace("spacing = 8", "spacing = 12"))
    done = make(own, "single_finger.vortices")
    assert done.returncode == 0, done.stderr[-3000:]
    after = dates()
    redone = {path.name for path in before if after[path] != before[path] and path.suffix == ".h5"}
    assert redone == {"piv.h5"}
    with read_plane(out / "piv.h5") as plane:
        assert float(plane["x"][1] - plane["x"][0]) == pytest.approx(12 * 1.25e-4)


def test_deflation_draws_the_water_up_along_the_fingers_trace(project):
    out = made(project, "single_deflate", ".vortices_cfd")
    compare(StageFiles(load_scene(out.parents[1], "smoke")))  # without PIV
    upward = [check for name, check in checks_of(out).items() if "upward" in name]
    assert upward
    assert all(c["met_by"] == {"cfd": True} for c in upward), [c["measured"] for c in upward]
    with read_plane(out / "sheet.h5") as plane:
        bend = plane["bend"].values[:, 0]
    assert bend.min() < np.radians(-90)


QUICK_PINCH = """
extends = "../pinch"
title = "A quick pinch"

[motion]
strokes = [{ pressure_kpa = 20.0, start = 0.005, duration = 0.25 }]
end_time = 0.2

[sheet]
rate_hz = 250.0

[levels.smoke]
camera = { pairs_every = 3 }
"""


@pytest.fixture(scope="module")
def pinch(project):
    """A pinch that closes in 0.16 s, with the findings of the scene pinch; no page."""
    case = project / "cases" / "quick_pinch"
    (case / "reference").mkdir(parents=True)
    (case / "scene.toml").write_text(QUICK_PINCH)
    shutil.copy2(CASES / "pinch" / "reference" / "findings.toml", case / "reference")
    return made(project, "quick_pinch", ".compare")


def test_the_pinch_shows_an_exact_pair_and_piv_sees_it(pinch):
    checks = checks_of(pinch)
    exact = pd.read_csv(pinch / "pairs_cfd.csv")
    for name in ("pair-opposite", "boundary-line", "above-upward", "downward-jet"):
        assert checks[name]["met"], (name, checks[name]["measured"], checks[name]["notes"])
    assert checks["pair-tracked"]["measured"]["cfd"] == 1.0
    assert exact["imbalance"].max() < 1e-6
    # windows of 8 mm hide half of the vortex: the pair's circulation is undecided, with a cure
    assert checks["pair-equal"]["met"] is None
    assert "set a smaller piv.window" in checks["pair-equal"]["cure"]
    pairs = np.genfromtxt(pinch / "pairs_piv.csv", delimiter=",", names=True)
    stated = np.hypot(pairs["circulation_std_0"], pairs["circulation_std_1"])
    assert len(pairs) > 5
    assert (np.abs(pairs["circulation_0"] + pairs["circulation_1"]) < 2 * stated).mean() > 0.9
    # so that a wide band alone does not pass: 76 % (median) with these windows of 8 mm
    assert np.median(stated / np.abs(pairs["circulation_0"])) < 0.9
    left, right = pairs["circulation_0"], pairs["circulation_1"]
    # 0.29 was measured (RMS) with these windows; the shipped pinch at smoke has 0.6 %
    assert np.abs(left + right).mean() < 0.3 * np.abs(left).mean()
    assert exact["mirror_distance"].max() < 1e-9
    # a quarter of a window; below 1 mm on one processor, 1.5 mm on another
    assert checks["pair-mirrored"]["measured"]["piv"] < 2e-3


DENSE = """
extends = "../single_finger"
title = "Enough cells for four ranks"

[motion]
# 6 kPa moved the tip by 0.03 mm until then: a motion of nothing, which is refused now
strokes = [{ pressure_kpa = 20.0, start = 0.002, duration = 0.2 }]
end_time = 0.008

[levels.dense]
model = { kind = "2d" }
numerics = { time_step = 0.5e-3, non_orthogonal_correctors = 0 }
[levels.dense.mesh]
wall_cell = 0.55e-3
wall_first_layer = 0.18e-3
wall_layers = 3
tip_cell = 0.32e-3
near_cell = 0.6e-3
near_distance = 0.022
far_cell = 0.006
"""


def test_more_ranks_than_cores_still_finish(project):
    """`make NP=4` on two cores."""
    case = project / "cases" / "dense"
    case.mkdir()
    (case / "scene.toml").write_text(DENSE)
    done = make(project, "dense.solve", "LEVEL=dense", "NP=4")
    assert done.returncode == 0, done.stderr[-3000:]
    run = read(case / "out" / "dense" / "run" / "run.json")
    assert run["cells"] >= 4 * 5000  # a smaller mesh gets fewer ranks
    assert run["ranks"] == 4


@pytest.fixture(scope="module")
def laid(finger, tmp_path_factory):
    folder = tmp_path_factory.mktemp("examples")
    place(folder, finger)
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_an_example_draws_its_picture_in_few_lines(laid, name):
    if name == "study" and not (ROOT / ".venv-study" / ".ready").exists():
        pytest.skip("Snakemake is not installed: make .venv-study/.ready")
    script = (ROOT / "docs" / "examples" / f"{name}.py").read_text()
    assert len(script.splitlines()) <= 30
    assert f"examples/{name}.png" in (ROOT / "docs" / "gallery.md").read_text()
    assert run_example(name, laid).stat().st_size > 5_000  # an empty picture has less
