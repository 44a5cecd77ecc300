"""The record of a stage, `made/<stage>.json`: its inputs, and the checksums of its outputs.

Readers check a file that a record names. Files that no record names, such as those of other
programs, are not checked.
"""

import json
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

from piv.files.atomic import sha256, write_text
from piv.files.errors import StageError

FOLDER = "made"
FORMAT = {"format": "stage-record", "format_version": 1}
_DEPTH = 6  # of a file in a run's folder: case/interval_0/postProcessing/sheet/0.1/sheet.vtk
REMEDY = "delete it and run make again"


def record_path(out: Path, stage: str) -> Path:
    """Path of the record of a stage of the run in `out`."""
    return out / FOLDER / f"{stage}.json"


def read_record(out: Path, stage: str) -> dict[str, Any] | None:
    """The record of a stage; None where it is missing or of another version."""
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
        record = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    known = isinstance(record, dict) and FORMAT.items() <= record.items()
    return record if known and isinstance(record.get("outputs"), dict) else None


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
