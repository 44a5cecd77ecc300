"""The time of a run from which it can resume."""

import pytest

from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.displacement_files import checkpoint_steps
from pipeline.openfoam.foamfile import END, write_bytes
from pipeline.solve.checkpoint import (
    FIELDS,
    LOG,
    MOVED,
    drop_tables,
    last_checkpoint,
    reached_time,
    sampled_until,
    saved_times,
)
from pipeline.solve.results import history
from pipeline.solve.solver import resumes_rightly
from piv.files.errors import StageError

MORE = ("U_0", "meshPhi")


def save(folder, time):
    for name in (*FIELDS, *MOVED, *MORE):
        write_bytes(folder / time / name, b"1 2 3" + END)


def record(case, start, times):
    path = case / "postProcessing" / "forces" / start / "force.dat"
    write_bytes(path, b"# Time\n" + b"".join(b"%g\t(1 2 3)\n" % t for t in times))
    return path


def test_a_time_counts_once_the_step_after_it_was_sampled(tmp_path):
    for time in ("0.01", "0.02"):
        save(tmp_path, time)
    assert last_checkpoint(Case(tmp_path)) is None
    record(tmp_path, "0", [0.005, 0.01, 0.015, 0.02])
    # 0.02 may have been killed among its samples
    assert last_checkpoint(Case(tmp_path)) == (0.01, "0.01")
    record(tmp_path, "0", [0.005, 0.01, 0.015, 0.02, 0.025, 0.03])
    assert last_checkpoint(Case(tmp_path)) == (0.02, "0.02")


def test_a_time_counts_once_its_step_is_in_the_log(tmp_path):
    """A kill of MPI's launcher loses lines of the log, whose steps history.csv would lack."""
    for time in ("0.01", "0.02"):
        save(tmp_path, time)
    record(tmp_path, "0", [0.01, 0.02, 0.03, 0.04])
    step = "Time = {}\n\nExecutionTime = 1.5 s  ClockTime = 2 s\n\n"
    log = tmp_path / LOG
    log.write_text(step.format("0.01") + step.format("0.02"))
    assert last_checkpoint(Case(tmp_path)) == (0.02, "0.02")
    log.write_text(step.format("0.01") + "Time = 0.02\n\nExecutionTime = 1.5 s  Clo")
    assert last_checkpoint(Case(tmp_path)) == (0.01, "0.01")
    log.write_text("Create time\n")
    assert last_checkpoint(Case(tmp_path)) is None


@pytest.mark.parametrize("name", [*FIELDS, *MOVED, *MORE])
def test_an_incomplete_file_needs_the_time_before(tmp_path, name):
    for time in ("0.01", "0.02"):
        save(tmp_path, time)
    record(tmp_path, "0", [0.01, 0.02, 0.03, 0.04])
    (tmp_path / "0.02" / name).write_bytes(b"1 2")
    assert last_checkpoint(Case(tmp_path)) == (0.01, "0.01")


def test_all_ranks_must_have_written_it(tmp_path):
    record(tmp_path, "0", [0.01, 0.02, 0.03, 0.04])
    for rank, times in enumerate((("0.01", "0.02"), ("0.01",))):
        for time in times:
            save(tmp_path / f"processor{rank}", time)
    assert last_checkpoint(Case(tmp_path, 2)) == (0.01, "0.01")
    assert last_checkpoint(Case(tmp_path)) is None


def test_a_resumed_part_counts_from_its_begin_and_later_ones_are_dropped(tmp_path):
    first = record(tmp_path, "0", [0.01, 0.02, 0.03, 0.04, 0.05])
    second = record(tmp_path, "0.03", [])
    assert sampled_until(tmp_path) == 0.03
    drop_tables(tmp_path, 0.03)
    assert first.exists()
    assert not second.exists()
    assert sampled_until(tmp_path) == 0.03  # the first part, without its last two rows
    drop_tables(tmp_path, 0.0)
    assert sampled_until(tmp_path) == 0.0


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_resumed_run_starts_at_its_time_with_all_digits(tmp_path, ranks):
    case = Case(tmp_path, ranks)
    reached = "0.340000000000000246"  # the sum of 340 steps of 1 ms
    files = [folder / "0.34" / "uniform" / "time" for folder in case.folders]
    for path in files:
        write_bytes(path, f'value           {reached};\nname "0.34";'.encode() + END)
    assert reached_time(case, "0.34") == reached
    for path in files:
        write_bytes(path, b"index 340;" + END)
    with pytest.raises(StageError, match="no value of the time"):
        reached_time(case, "0.34")


def test_a_log_with_an_incomplete_line_is_read(tmp_path):
    step = (
        "Courant Number mean: 0.1 max: 0.5\nTime = {0}\n\n"
        "GAMG:  Solving for p, Initial residual = 0.8, Final residual = 0.01, No Iterations 6\n"
        "time step continuity errors : sum local = 1e-08, global = -2e-10, cumulative = 1e-9\n"
        "ExecutionTime = {1} s  ClockTime = {1} s\n"
    )
    cut = "Courant Number mean: 0.1 max\nCourant Number mean: 0.1 max: 0.7\nTime = \n"
    parts = step.format(0.1, 3), step.format(0.2, 5), cut, step.format(0.2, 1)
    (tmp_path / "log").write_text("".join(parts))
    table = history(tmp_path / "log")
    assert table[:, 0].tolist() == [0.1, 0.2]
    assert table[1].tolist() == [0.2, 0.1, 0.5, 1e-8, -2e-10, 6, 6]


@pytest.mark.parametrize(
    "wanted, time_step, steps",
    [(0.02, 1e-3, 20), (0.0193, 1e-3, 20), (1e-4, 1e-3, 2), (0.61, 0.02, 30)],
)
def test_checkpoints_are_an_even_number_of_steps_apart(wanted, time_step, steps):
    assert checkpoint_steps(wanted, time_step) == steps


def test_the_fields_of_a_handover_are_no_checkpoint(tmp_path):
    save(tmp_path, "0.01")
    for name in ("U", "p", "polyMesh/points"):
        write_bytes(tmp_path / "0.015" / name, b"1 2 3" + END)
    record(tmp_path, "0", [0.01, 0.02, 0.03, 0.04])
    assert last_checkpoint(Case(tmp_path)) == (0.01, "0.01")
    assert saved_times(Case(tmp_path), ("U", "p")) == [(0.01, "0.01"), (0.015, "0.015")]


@pytest.mark.parametrize(
    "version, model, pinch, moving, rightly",
    [
        ("v1912", "half", True, True, True),
        ("v2306", "half", False, True, False),
        ("v2306", "2d", True, True, False),
        ("v2306", "2d", False, True, True),
        ("v2306", "half", False, False, True),
    ],
)
def test_v2306_does_not_resume_moving_meshes_with_a_symmetry_plane(
    version, model, pinch, moving, rightly
):
    """Its forces would change (docs/openfoam_versions.md)."""
    assert resumes_rightly(version, model, pinch, moving) == rightly
