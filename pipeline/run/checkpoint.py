"""The last checkpoint that is complete, and the removal of tables that a resumed run will write again."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from fileio.errors import StageError
from pipeline.openfoam.function_objects import table_rows
from pipeline.openfoam.ranks import Ranks, is_whole
from pipeline.openfoam.surface_vtk import is_whole_vtk

LOG = "log.pimpleFoam"
LOGGED_STEP = re.compile(r"(?m)^ExecutionTime = .*ClockTime = \d+ s$")
FIELDS = ("U", "p", "phi", "uniform/time")
MOVED = ("pointDisplacement", "polyMesh/points")  # written where the mesh moves


def saved_times(folder: Path, ranks: Ranks, wanted: tuple[str, ...]) -> list[tuple[float, str]]:
    """Times in a case's folder, or in one of its ranks', at which the `wanted` files are there and every file is whole, ascending."""
    saved = []
    for place in folder.iterdir() if folder.is_dir() else ():
        time = _number(place.name)
        if time is None or time <= 0 or not all((place / name).exists() for name in wanted):
            continue
        # the old-time fields of the second-order scheme count as well, whatever their names; frames of the motion do not
        if all(
            is_whole(path, ranks)
            for path in place.rglob("*")
            if path.is_file() and path.suffix != ".gz"
        ):
            saved.append((time, place.name))
    return sorted(saved)


def last_checkpoint(case: Path, ranks: Ranks, moving: bool = True) -> tuple[float, str] | None:
    """Latest time that all ranks have written whole, whose samples and log are on disk; None where there is none."""
    sampled = min(sampled_until(case), np.nextafter(first_damaged(case), 0.0), logged_until(case))
    wanted = FIELDS + (MOVED if moving else ())
    common: dict[float, str] | None = None
    for folder in ranks.folders(case):
        times = {t: n for t, n in saved_times(folder, ranks, wanted) if t <= sampled * (1 + 1e-9)}
        common = times if common is None else {t: n for t, n in common.items() if t in times}
    return max(common.items()) if common else None


def reached_time(case: Path, ranks: Ranks, name: str) -> str:
    """The time of the checkpoint `name` (s) with all its digits, of which the folder's name shows eight.

    The solver adds up its time steps with a rounding error each: started at the rounded time, it would interpolate the
    mesh motion elsewhere and differ from an undisturbed run.
    """
    path = ranks.folders(case)[0] / name / "uniform" / "time"
    value = re.search(r"(?m)^value\s+(\S+);", path.read_text(errors="replace"))
    if value is None:
        raise StageError(
            f"{path}: no value of the time; delete {path.parents[1]} and run make again"
        )
    return value[1]


def first_damaged(case: Path) -> float:
    """Earliest time (s) of which a sampled surface is missing or cut off, as where the disk was full; infinite without one.

    Each kind of surface is sampled at an interval of its own, the least between two of its times.
    """
    surfaces_whole: list[dict[float, bool]] = []
    for surfaces in (case / "postProcessing").glob("*Surface"):
        folders = [
            (time, folder)
            for folder in surfaces.iterdir()
            if (time := _number(folder.name)) is not None
        ]
        surfaces_whole.append(
            {t: any(map(is_whole_vtk, folder.glob("*.vtk"))) for t, folder in folders}
        )
    last = max((time for whole in surfaces_whole for time in whole), default=0.0)
    damaged = [time for whole in surfaces_whole for time, good in whole.items() if not good]
    for whole in surfaces_whole:
        times = sorted(whole)
        if len(times) > 1:
            interval = min(b - a for a, b in pairwise(times))
            damaged += [a + interval for a, b in pairwise(times) if b - a > 1.5 * interval]
            if last - times[-1] > (1 - 1e-6) * interval:
                damaged.append(times[-1] + interval)
    return min(damaged, default=np.inf)


def force_times(case: Path) -> list[float]:
    """When the solver was last started (s), and the times in its table of forces since then."""
    parts = _parts(case / "postProcessing" / "forces")
    if not parts:
        return [0.0]
    start, folder = parts[-1]
    return [
        start,
        *sorted(
            float(time) for path in folder.glob("force*.dat") for time in table_rows(path)[:, 0]
        ),
    ]


def sampled_until(case: Path) -> float:
    """Latest time (s) whose samples are surely whole.

    OpenFOAM writes the fields of a time before its samples: those are whole when the forces of the step after are there.
    """
    times = force_times(case)
    return times[-3] if len(times) > 3 else times[0]


def logged_until(case: Path) -> float:
    """Time (s) of the last whole step in the solver's log; infinite where there is no log.

    MPI hands the log on late: a kill may take the lines of steps whose fields are on disk, and history.csv is made of them.
    """
    if not (case / LOG).exists():
        return np.inf
    text = (case / LOG).read_text(errors="replace")
    ends = [step.start() for step in LOGGED_STEP.finditer(text)]
    times = re.findall(r"(?m)^Time = (\S+)$", text[: ends[-1]]) if ends else []
    return float(times[-1]) if times else 0.0


def drop_tables(case: Path, start: float) -> None:
    """Remove the tables that a run (re)started at `start` (s) or later has written.

    OpenFOAM would not overwrite them but write `<name>_<time>.dat` beside them, and what began at a later, damaged
    checkpoint must not replace what is computed anew.
    """
    for recorder in (case / "postProcessing").glob("*"):
        for time, folder in _parts(recorder):
            if time >= start - 1e-9:
                for path in folder.glob("*.dat"):
                    path.unlink()


def _parts(recorder: Path) -> list[tuple[float, Path]]:
    """Folders of a function object that hold tables, by the time at which the run began, ascending."""
    folders = recorder.iterdir() if recorder.is_dir() else ()
    timed = [(_number(folder.name), folder) for folder in folders if any(folder.glob("*.dat"))]
    return sorted((time, folder) for time, folder in timed if time is not None)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
