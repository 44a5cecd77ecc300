"""What a run left in a case: its state and cost, its last checkpoint, tables to rewrite."""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.formats.mesh_intervals import Interval
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.foamfile import field_of, is_complete, labels_of, read_field
from pipeline.openfoam.function_objects import table_rows, tables
from pipeline.openfoam.surface_vtk import is_whole_vtk
from piv.files.errors import StageError
from piv.files.json_text import read_json

LOG = "log.pimpleFoam"
STATE = "state.json"  # the mesh, ranks and OpenFOAM for which an interval's folder was prepared
PROGRESS = "progress.json"  # cost of the interval so far, and whether it has ended
_LOGGED_STEP = re.compile(r"(?m)^ExecutionTime = .*ClockTime = \d+ s$")
FIELDS = ("U", "p", "phi", "uniform/time")
MOVED = ("pointDisplacement", "polyMesh/points")  # written where the mesh moves


def case_state(case: Case) -> dict[str, Any]:
    """The mesh (time of its file), ranks and OpenFOAM to which the files of a case belong."""
    points = case.folder / "constant" / "polyMesh" / "points"
    if not points.exists():
        raise StageError(f"{case.folder}: no mesh; run the case stage first")
    return {"ranks": case.ranks, "mesh": points.stat().st_mtime_ns, "version": foam_version()}


def prepared_for(folder: Path) -> dict[str, Any]:
    """The state for which a case was last prepared, or {}. StageError where it is damaged."""
    path, remedy = folder / STATE, "delete it and run make again"
    if not path.exists():
        return {}
    return read_json(path, f"{remedy}: {folder.name} is solved from its beginning")


def prepared_case(folder: Path) -> Case:
    """The case in `folder` with the ranks for which it was last prepared; one where never."""
    return Case(folder, prepared_for(folder).get("ranks", 1))


def resumable_case(case: Case, moving: bool, quiet: bool) -> Case:
    """The case as an interrupted run has left it that can be resumed, else `case`.

    `case`: of the first interval, whose mesh is `moving` or not; the others follow it.
    """
    earlier = prepared_case(case.folder)
    known = earlier != case and prepared_for(case.folder) == case_state(earlier)
    if not known or last_checkpoint(earlier, moving) is None:
        return case
    if not quiet:
        print(
            f"solve: resumes with ranks = {earlier.ranks}, not {case.ranks}"
            f" (remove {case.folder.parent} to start again from the beginning)"
        )
    return earlier


def saved_times(case: Case, wanted: tuple[str, ...]) -> list[tuple[float, str]]:
    """Times (s) and folders' names, ascending, with whole files of all ranks, also `wanted`."""
    of_ranks = [_whole_times(folder, wanted) for folder in case.folders]
    return sorted((t, n) for t, n in of_ranks[0].items() if all(t in times for times in of_ranks))


def _whole_times(folder: Path, wanted: tuple[str, ...]) -> dict[float, str]:
    saved = {}
    for place in folder.iterdir() if folder.is_dir() else ():
        time = _number(place.name)
        if time is None or time <= 0 or not all((place / name).exists() for name in wanted):
            continue
        # old-time fields of the second-order scheme count as well; frames of the motion do not
        files = [path for path in place.rglob("*") if path.is_file() and path.suffix != ".gz"]
        if all(map(is_complete, files)):
            saved[time] = place.name
    return saved


def saved_field(case: Case, name: str, cells: int) -> np.ndarray:
    """A field `<time>/<name>` of all cells in the mesh's own order, from the files of all ranks."""
    if case.ranks == 1:
        return read_field(case.folder / name, cells)
    whole: np.ndarray | None = None
    addressing = case.contents("constant/polyMesh/cellProcAddressing")
    for labels, content in zip(addressing, case.contents(name), strict=True):
        members = labels_of(labels)
        part = field_of(content, len(members), case.folder / name)
        if whole is None:
            whole = np.full((cells, *part.shape[1:]), np.nan)
        whole[members] = part
    if whole is None or np.isnan(whole).any():
        raise StageError(
            f"{case.folder}: {name} is not whole; delete the case folder and run make again"
        )
    return whole


def last_checkpoint(case: Case, moving: bool = True) -> tuple[float, str] | None:
    """Latest time that all ranks, samples and the log have on disk; None without one."""
    folder = case.folder
    limits = sampled_until(folder), np.nextafter(first_damaged(folder), 0.0), _logged_until(folder)
    sampled = min(limits)
    saved = saved_times(case, FIELDS + (MOVED if moving else ()))
    return max((at for at in saved if at[0] <= sampled * (1 + 1e-9)), default=None)


def reached_time(case: Case, name: str) -> str:
    """The time of the checkpoint `name` (s) with all its digits; the folder's name shows eight.

    Started at the rounded time, the solver would interpolate the mesh motion elsewhere and differ
    from an undisturbed run.
    """
    path = case.folders[0] / name / "uniform" / "time"
    value = re.search(r"(?m)^value\s+(\S+);", path.read_text(errors="replace"))
    if value is None:
        raise StageError(
            f"{path}: no value of the time; delete {path.parents[1]} and run make again"
        )
    return value[1]


def read_progress(folder: Path) -> dict[str, Any]:
    """Cost of an interval (`wall_time`, `cpu_time`, s), times of its resumptions, whether `ended`.

    StageError where the file is damaged.
    """
    path = folder / PROGRESS
    remedy = (
        "delete it and run make again: the solver resumes from its last checkpoint, its cost counts"
        " from there"
    )
    known = read_json(path, remedy) if path.exists() else {}
    return {"wall_time": 0.0, "cpu_time": 0.0, "resumed": []} | known


def has_ended(folder: Path, interval: Interval) -> bool:
    """Whether an interval was solved to its end and all its sampled surfaces are there."""
    return bool(read_progress(folder).get("ended")) and first_damaged(folder) > interval.end


def first_damaged(folder: Path) -> float:
    """Earliest time (s) whose sampled surface is missing or cut off; infinite without one.

    Each kind of surface has its own sampling interval: the least between two of its times.
    """
    surfaces_whole = [
        {
            time: any(map(is_whole_vtk, at.glob("*.vtk")))
            for at in surfaces.iterdir()
            if (time := _number(at.name)) is not None
        }
        for surfaces in (folder / "postProcessing").glob("*Surface")
    ]
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


def force_times(folder: Path) -> list[float]:
    """The solver's last start (s), and the times in its table of forces since then."""
    parts = tables(folder / "postProcessing" / "forces", "*.dat")
    if not parts:
        return [0.0]
    start = parts[-1][0]
    paths = [path for time, path in parts if time == start and path.name.startswith("force")]
    return [start, *sorted(float(time) for path in paths for time in table_rows(path)[:, 0])]


def sampled_until(folder: Path) -> float:
    """Latest time (s) whose samples are surely whole: the forces of the next step are there."""
    times = force_times(folder)
    return times[-3] if len(times) > 3 else times[0]


def _logged_until(folder: Path) -> float:
    """Time (s) of the last whole step in the solver's log; infinite without a log.

    MPI passes the log on late: a kill may lose lines, needed by history.csv, of steps on disk.
    """
    if not (folder / LOG).exists():
        return np.inf
    text = (folder / LOG).read_text(errors="replace")
    ends = [step.start() for step in _LOGGED_STEP.finditer(text)]
    times = re.findall(r"(?m)^Time = (\S+)$", text[: ends[-1]]) if ends else []
    return float(times[-1]) if times else 0.0


def drop_tables(folder: Path, start: float) -> None:
    """Remove the tables of solvers started at `start` (s) or later.

    OpenFOAM would write `<name>_<time>.dat` beside them, and tables from a later, damaged
    checkpoint must not replace new ones.
    """
    for recorder in (folder / "postProcessing").glob("*"):
        for time, path in tables(recorder, "*.dat"):
            if time >= start - 1e-9:
                path.unlink()


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
