"""Outcomes of runs that may be refused or stopped, recorded as results of a study."""

import re
import resource
import shutil
from pathlib import Path
from typing import Any

from pipeline.openfoam.environment import foam_version
from pipeline.runs.run import run_of, targets
from piv.files.errors import StageError
from piv.files.provenance import digest
from piv.files.record import read_record, write_record
from softfinger.make import Machine, make

OUTCOME = "outcome"
LONGEST = 7200.0  # s; a stage that takes longer counts as hung
_LONGEST_REASON = 400  # characters


def outcome_digest(about: dict[str, Any]) -> str:
    """Digest of the inputs of an outcome: the run up to its last stage, and OpenFOAM."""
    try:
        run = run_of(about)
        made_from: Any = [run.digest(stage) for stage in targets(about["until"])]
    except StageError as error:
        made_from = str(error)
    return digest([made_from, about["until"], foam_version()])


def outcome_is_there(about: dict[str, Any]) -> bool:
    """Whether a run's outcome is recorded and its inputs are unchanged."""
    record = read_record(Path(about["out"]), OUTCOME)
    return record is not None and record["digest"] == outcome_digest(about)


def write_outcome(about: dict[str, Any], machine: Machine) -> None:
    """Make a run up to its last stage; record how and why it ended, and its CPU time."""
    out, until = Path(about["out"]), about["until"]
    result: dict[str, Any] = {"ended": "completed", "ended_at": until, "reason": ""}
    try:
        make(run_of(about), until, machine, quiet=True, longest=LONGEST)
    except StageError as error:
        result = _ended(str(error))
    except RuntimeError as error:
        stage, _, text = str(error).partition(": ")
        result = {"ended": "crashed", "ended_at": stage, "reason": text}
    for place in (out.resolve(), out, about["folder"]):  # a reason is independent of the folder
        result["reason"] = result["reason"].replace(f"{place}/", "")
    result["reason"] = result["reason"][:_LONGEST_REASON]
    if until == "solve":  # no later stage reads the solver's case
        shutil.rmtree(out / "case", ignore_errors=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cost = {"cpu_time": round(used.ru_utime + used.ru_stime, 1)}
    write_record(out, OUTCOME, {"digest": outcome_digest(about)} | cost | result, [])


def _ended(text: str) -> dict[str, Any]:
    """Classify an error message: refused, stopped by a guard, failed, or hung."""
    text = " ".join(text.split())
    if "was killed at" in text or "its process ended with signal" in text:
        raise StageError(text)  # by the machine: no result
    stage, _, reason = text.partition(": ")
    stage = stage if re.fullmatch(r"\w+", stage) else "scene"
    stopped = re.search(r"stopped at ([-+\d.e]+) s", text)
    if stopped:
        at = float(stopped.group(1))
        return {"ended": "stopped", "ended_at": stage, "stopped_at_s": at, "reason": reason}
    if "is not over after" in text:
        return {"ended": "hung", "ended_at": stage, "reason": reason}
    failed = re.search(r"failed (at|in)\b", text)
    return {"ended": "failed" if failed else "refused", "ended_at": stage, "reason": reason}
