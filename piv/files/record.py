"""The record of a stage, `made/<stage>.json`: its inputs, and the checksums of its outputs.

Readers check a file that a record names. Files that no record names, such as those of other
programs, are not checked.
"""

import json
import os
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from piv.files.atomic import sha256, write_text
from piv.files.errors import StageError
from piv.files.regular import read_regular

FOLDER = "made"
FORMAT = {"format": "stage-record", "format_version": 1}
_DEPTH = 6  # of a file in a run's folder: case/interval_0/postProcessing/sheet/0.1/sheet.vtk
REMEDY = "delete it and run make again"
NAME = r"[A-Za-z0-9][A-Za-z0-9_.-]*"  # of a folder that is made, as a file gives it
_GATE = "/gate.vtk"  # a pipe of a coupled run (pipeline/openfoam/gate.py)
_COSTS = ("wall_time", "cpu_time", "peak_memory")
_LARGEST = 1e18  # of a cost; a larger integer is no float


def check_own(out: Path) -> None:
    """StageError where a link leads out of a run's folder `out`, or `out` out of its scene's.

    Whatever a run writes, replaces or deletes lies below `out`, so this guards all such paths. A
    pipe or device is refused too, since opening it may never return. The gate of a coupled run is
    not: it may be running, and where it was killed its next start removes the gate unread.
    """
    home = next((p for p in out.parents if (p / "scene.toml").is_file()), out.parent)
    above = [p for p in out.parents if home in p.parents]
    places = [(path, home) for path in (out, *above)]
    places += [(Path(link), out) for link in _links(out)] if out.is_dir() else []
    for path, within in places:
        if not _is_below(path, within) or (path.is_symlink() and not path.exists()):
            raise StageError(f"{path}: leads out of {within}, or nowhere; remove this link")


def _links(folder: Path | str) -> Iterator[str]:
    """Links below a folder, none of which is followed; StageError for a pipe or device."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                yield entry.path
            elif entry.is_dir(follow_symlinks=False):
                yield from _links(entry.path)
            elif not (entry.is_file(follow_symlinks=False) or entry.path.endswith(_GATE)):
                raise StageError(f"{entry.path}: is neither a file nor a folder; remove it")


def _is_below(path: Path, folder: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def record_path(out: Path, stage: str) -> Path:
    """Path of the record of a stage of the run in `out`."""
    return out / FOLDER / f"{stage}.json"


def read_record(out: Path, stage: str) -> dict[str, Any] | None:
    """The record of a stage; None where it is missing, of another version, or not sound.

    A cost that it does not state is 0.
    """
    return _parsed(record_path(out, stage))


def write_record(out: Path, stage: str, about: dict[str, Any], outputs: list[Path]) -> None:
    """Write a stage's record: `about`, and size, time and SHA-256 of each file in `outputs`."""
    files = {
        path.relative_to(out).as_posix(): _state(path) | {"sha256": sha256(path)}
        for path in sorted(outputs)
    }
    record = FORMAT | {"stage": stage} | about | {"outputs": files}
    write_text(record_path(out, stage), json.dumps(record, indent=1) + "\n")


def forget(out: Path, stage: str, digest: str) -> None:
    """Remove a stage's record, and its outputs but those that were recorded with this digest.

    A solver would otherwise resume from a damaged file, or one of another run.
    """
    if (record := read_record(out, stage)) is not None:
        same = record.get("digest") == digest
        for name in changed_outputs(out, record) if same else record["outputs"]:
            (out / name).unlink(missing_ok=True)
    record_path(out, stage).unlink(missing_ok=True)


def changed_outputs(out: Path, record: dict[str, Any]) -> dict[str, str]:
    """Faults of a record's files, by name: missing, or other content than recorded.

    A file of the recorded size and time counts as unchanged; any other is read.
    """
    changed = {}
    for name, known in record["outputs"].items():
        path = out / name
        if not path.is_file():
            changed[name] = f"{name} is missing"
        elif _state(path) | {"sha256": known["sha256"]} != known and _sum(path) != known["sha256"]:
            changed[name] = f"{name} has changed since it was written"
    return changed


def check_whole(path: str | Path, remedy: str = REMEDY) -> bool:
    """Whether a record names the file; StageError where its content is not the recorded one."""
    path = Path(os.path.abspath(path))
    if not path.is_file():
        return False
    for out in path.parents[:_DEPTH]:
        if not (out / FOLDER).is_dir():
            continue
        known = _known(out, (out / FOLDER).stat().st_mtime_ns).get(path.relative_to(out).as_posix())
        if known is not None and _sum(path) != known:
            raise StageError(f"{path}: damaged or changed since it was written; {remedy}")
        return known is not None
    return False


@lru_cache(maxsize=64)
def _known(out: Path, changed: int) -> dict[str, str]:
    """SHA-256 of every recorded file in `out`; `changed`: its time of change, for the cache."""
    records = map(_parsed, sorted((out / FOLDER).glob("*.json")))
    return {name: state["sha256"] for r in records if r for name, state in r["outputs"].items()}


def _parsed(path: Path) -> dict[str, Any] | None:
    try:
        record = json.loads(read_regular(path))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or not FORMAT.items() <= record.items():
        return None
    record = dict.fromkeys(_COSTS, 0) | {"made_from": {}} | record
    return record if _is_sound(record, path.parents[1]) else None


def _is_sound(record: dict[str, Any], out: Path) -> bool:
    """Whether a record has the shape of this program's, and names files of the run alone."""
    made, outputs = record["made_from"], record.get("outputs")
    if not isinstance(made, dict) or not isinstance(outputs, dict):
        return False
    costs = [record[key] for key in _COSTS]
    return (
        isinstance(record.get("digest"), str)
        and isinstance(record.get("stage"), str)
        and all(isinstance(made.get(key, {}), dict) for key in ("numbers", "files", "inputs"))
        and all(type(cost) in (int, float) and 0 <= cost < _LARGEST for cost in costs)
        and all(isinstance(s, dict) and isinstance(s.get("sha256"), str) for s in outputs.values())
        and _are_own(out, outputs)
    )


def _are_own(out: Path, names: Iterable[str]) -> bool:
    """Whether each name is of a file below `out` that no link makes another one."""
    for name in names:
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or not path.parts or "\0" in name:
            return False
        if os.path.islink(out / name) or os.path.isdir(out / name):
            return False
    return all(_is_below(folder, out) for folder in {(out / name).parent for name in names})


def _state(path: Path) -> dict[str, Any]:
    state = path.stat()
    return {"bytes": state.st_size, "time_ns": state.st_mtime_ns}


def _sum(path: Path) -> str:
    state = path.stat()
    return _sum_of(path, state.st_mtime_ns, state.st_size, state.st_ino)


@lru_cache(maxsize=256)
def _sum_of(path: Path, *state: int) -> str:
    """SHA-256 of a file in this state, computed once."""
    return sha256(path)
