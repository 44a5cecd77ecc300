"""Small `make faults` and docs.evidence.stability: kills, two makes, full disk; endings."""

import os

import pytest

from docs.evidence.faults.campaign import Campaign, kills, twice
from docs.evidence.faults.files import disks
from docs.evidence.stability.solver import result
from piv.files.record import record_path
from softfinger.make import Machine
from softfinger.study.outcome import write_outcome

pytestmark = pytest.mark.openfoam


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """An undisturbed small run up to the sheet, in a folder whose name OpenFOAM cannot read."""
    return Campaign(tmp_path_factory.mktemp("faults") / "o'brien lab", "sheet")


@pytest.mark.parametrize("stage", ["mesh", "solve"])
def test_make_goes_on_after_kills_and_gives_the_same_result(solved, stage):
    row = kills(solved, stage, 2, 1)
    assert (row["wrong"], row["times"]) == (0, 2), row


def test_two_makes_at_once_keep_the_files_intact(solved):
    row = twice(solved, "mesh")
    assert row["wrong"] == 0, row


def test_a_full_and_a_read_only_disk_give_one_sentence(solved):
    try:
        rows = list(disks(solved, ["mesh"]))
    except PermissionError as error:
        pytest.skip(str(error))
    assert [(row["refused"], row["wrong"]) for row in rows] == 3 * [(1, 0)], rows


def test_a_sampled_plane_that_was_zeroed_is_refused_and_then_made_again(solved):
    """Of the same size and time, so that no stage before it is stale."""
    solved.restore(solved.wanted)
    path = max(solved.out.glob("case/*/postProcessing/sheetSurface/*/sheet.vtk"))
    content, state = path.read_bytes(), path.stat()
    middle = len(content) // 2
    path.write_bytes(content[:middle] + bytes(1200) + content[middle + 1200 :])
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    record_path(solved.out, "sheet").unlink()
    code, sentence = solved.make("sheet").answer()
    assert code == 2
    assert f"{path}: damaged or changed since it was written; delete it and run make" in sentence
    path.unlink()
    assert solved.again("sheet") == ""


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
    scene = str(solved.run.scene.folder)
    planned = {"run": "axis_", "axis": "axis", "value": "", "level": "tiny", "ranks": 1,
               "compared_ranks": None}  # fmt: skip
    planned |= {"overrides": TINY | changes, "folder": scene}
    planned |= {"out": str(tmp_path), "until": "solve"}
    write_outcome(planned, Machine())
    judged = result(planned)
    assert judged["ended"] == ended, judged
    assert words in judged["reason"]
    assert str(tmp_path) not in judged["reason"]
    if ended == "completed":
        assert judged["from_nothing_fraction"] < 0.01
