"""Small `make faults` and tests.studies.stability: kills, two makes, full disk; endings."""

import shutil

import pytest

from pipeline.runs.make import Machine
from pipeline.study.outcome import write_outcome
from tests.studies.faults.conditions import disks, twice
from tests.studies.faults.kill import kills_in
from tests.studies.faults.project import SCENE, copy_project, make, out_of
from tests.studies.stability import images
from tests.studies.stability.solver import result

pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(shutil.which("pimpleFoam") is None, reason="OpenFOAM is not installed"),
]


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A solved copy of the project, the files of its stages, and a folder for logs."""
    folder = tmp_path_factory.mktemp("faults")
    project, wanted = copy_project(folder / "project"), folder / "wanted"
    done = make(project, f"{SCENE}.run")
    assert done.returncode == 0, done.stderr[-2000:]
    shutil.copytree(out_of(project), wanted)
    return project, wanted, folder


@pytest.mark.parametrize("stage", ["mesh", "run"])
def test_make_goes_on_after_kills_and_gives_the_same_result(solved, stage):
    project, wanted, folder = solved
    row = kills_in(project, wanted, stage, 4.0, 2, stage, folder / "log")
    assert row["difference"] == ""
    assert row["kills"] == 2


def test_two_makes_at_once_keep_the_files_intact(solved):
    row = next(iter(twice(*solved, ["mesh"])))
    assert row["ended"] in ("completed", "refused")
    assert row["afterwards"] == "as undisturbed"


def test_a_full_and_a_read_only_disk_give_one_sentence(solved):
    for row in disks(*solved, ["mesh"]):
        if str(row["ended"]).startswith("not tried"):
            pytest.skip(str(row["ended"]))
        assert row["ended"] == "refused", row
        assert row["afterwards"] == "as undisturbed"


TINY = {
    "model.kind": "2d", "motion.end_time": 0.02, "numerics.time_step": 1e-3,
    "motion.strokes": [{"pressure_kpa": 10.0, "start": 0.002, "duration": 0.05}],
    "mesh.wall_cell": 3.5e-3, "mesh.wall_first_layer": 1.2e-3, "mesh.wall_layers": 2,
    "mesh.tip_cell": 2.2e-3, "mesh.near_cell": 5e-3, "mesh.near_distance": 0.01,
    "mesh.far_cell": 0.05,
}  # fmt: skip
BEYOND = {"motion.strokes": [{"pressure_kpa": 90.0, "start": 0.0, "duration": 0.02}]}


@pytest.mark.parametrize(
    "changes, ended, words",
    [
        ({}, "completed", ""),
        ({"numerics.max_courant": 1.6}, "stopped", "Courant number"),  # it reaches 1.8
        ({"numerics.max_courant": 0.01}, "refused", "time_step of at most"),
        (BEYOND, "refused", "states cover"),
    ],
)
def test_a_run_ends_in_one_of_three_ways(solved, tmp_path, changes, ended, words):
    scene = str(solved[0] / "cases" / SCENE)
    planned = {"run": "axis_", "axis": "axis", "value": "", "level": "tiny", "ranks": 1,
               "compared_ranks": None}  # fmt: skip
    planned |= {"overrides": TINY | changes, "folder": scene, "out": str(tmp_path), "until": "run"}
    write_outcome(planned, Machine())
    judged = result(planned)
    assert judged["ended"] == ended, judged
    assert words in judged["reason"]
    assert str(tmp_path) not in judged["reason"]
    if ended == "completed":
        assert judged["from_nothing_fraction"] < 0.01


@pytest.mark.parametrize("name", ["no particles, noise", "all mask", "0.04"])
def test_pictures_without_an_answer_give_none(name):
    case = next(c for c in images.cases() if c.value == name)
    row = images.run_case(case, "fast")
    assert row["ended"] != "WRONG", row
    if name == "0.04":
        assert row["ended"] == "completed"
        assert row["valid"] > 0.9
    else:
        assert row["ended"] == "refused" or row["wrong_unflagged"] <= images.MAX_UNFLAGGED
