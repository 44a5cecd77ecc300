"""Ask for accuracy, or for a time, not for settings: the cheapest setting measured to reach it (make tradeoff).

Command: python -m pipeline choose cases/single_finger --accuracy 5% (make single_finger ACCURACY=5%, or BUDGET=10min)
"""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fileio.errors import StageError
from fileio.json_text import parse_json
from fileio.record import read_record
from pipeline.runs.make import Machine, make
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME, STAGES
from pipeline.study.machine_speed import probe
from pipeline.study.rows import Row, parse_cell

STUDY = "asked"
NUMBER = r"(\d+\.?\d*|\.\d+)"
UNITS = {"s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0}
OF_THE_STUDY = {"sheet.rate_hz"}  # varied there to save time, not as a setting


@dataclass(frozen=True)
class Setting:
    """One measured setting: its scene's overrides, its error, CPU seconds by stage."""

    row: Row
    error: float
    seconds: dict[str, float]


def read_results(path: Path) -> tuple[list[Setting], dict[str, Any]]:
    """Settings of a table of results, and its head: `probe` of the machine that measured them, `best` run, and that run's own `best_error` where it was estimated."""
    if not path.exists():
        raise StageError(
            f"{path}: no measured settings for this scene; make them with make tradeoff SCENE={path.stem}"
        )
    lines = path.read_text(encoding="utf-8").splitlines()
    remedy = f"make it anew with make tradeoff SCENE={path.stem}"
    try:
        head: dict[str, Any] = next(
            (parse_json(line[1:], path, remedy) for line in lines if line.startswith("#")), {}
        )
    except ValueError as error:
        raise StageError(str(error)) from None
    settings = []
    for record in csv.DictReader(line for line in lines if not line.startswith("#")):
        if record["run"] == head.get("best") and record["error"]:
            head["best_error"] = float(record["error"])
        seconds = {k[8:-2]: float(v) for k, v in record.items() if k.startswith("predict_") and v}
        if not record["error"] or record["kind"] != "flow" or not seconds:
            continue
        overrides = {
            k: parse_cell(v) for k, v in record.items() if "." in k and v and k not in OF_THE_STUDY
        }
        row = Row(record["run"], record["level"], int(float(record["ranks"])), overrides=overrides)
        settings.append(Setting(row, float(record["error"]), seconds))
    if "probe" not in head or not settings:
        raise StageError(f"{path}: no probe or no settings in it; {remedy}")
    return settings, head


def results_of(scene: Path) -> Path:
    """What make tradeoff has measured of a scene."""
    return scene / "studies" / "results" / "tradeoff.csv"


def accuracy(text: str) -> float:
    """0.05 of "5%" or "0.05"."""
    match = re.fullmatch(rf"\s*{NUMBER}\s*(%?)\s*", text)
    value = float(match.group(1)) * (0.01 if match.group(2) else 1.0) if match else -1.0
    if not 0 < value < 1:
        raise StageError(f"ACCURACY={text}: give a share between 0 and 1, as 5% or 0.05")
    return value


def budget(text: str) -> float:
    """Seconds of "10min", "2h" or "90s"."""
    match = re.fullmatch(rf"\s*{NUMBER}\s*([a-z]+)\s*", text)
    if not match or match.group(2) not in UNITS or float(match.group(1)) <= 0:
        raise StageError(f"BUDGET={text}: give a time, as 10min, 2h or 90s")
    return float(match.group(1)) * UNITS[match.group(2)]


def predicted(setting: Setting, there: dict[str, float], here: dict[str, float]) -> float:
    """CPU seconds of a setting on this machine, from those measured there and the probes of both."""
    ratio = {piece: here[piece] / there[piece] for piece in there}
    return sum(
        seconds * ratio["solver" if BY_NAME[stage].ranks else "images"]
        for stage, seconds in setting.seconds.items()
    )


def choose(
    settings: list[Setting], times: list[float], most_error: float | None, most_time: float | None
) -> int:
    """Index of the cheapest setting within `most_error`, or of the most accurate within `most_time` (s).

    Raises StageError that names the nearest where there is none.
    """
    order = range(len(settings))
    if most_error is not None:
        good = [k for k in order if settings[k].error <= most_error]
        if not good:
            best = min(order, key=lambda k: settings[k].error)
            raise StageError(
                f"no measured setting reaches {100 * most_error:.3g} %; the best, {settings[best].row.run}, is within"
                f" {100 * settings[best].error:.3g} %: ask for that, or set the scene finer yourself"
            )
        return min(good, key=lambda k: times[k])
    assert most_time is not None
    good = [k for k in order if times[k] <= most_time]
    if not good:
        fast = min(order, key=lambda k: times[k])
        raise StageError(
            f"nothing is done in {most_time:.0f} s; the fastest, {settings[fast].row.run}, takes {times[fast]:.0f} s"
        )
    return min(good, key=lambda k: settings[k].error)


def judges_doubt(head: dict[str, Any], error: float) -> str:
    """A sentence where an `error` is smaller than the own one of the run that judged it; empty otherwise, or where that is not known."""
    own = head.get("best_error")
    if own is None or error >= own:
        return ""
    return f"the errors are those against {head['best']}, whose own is estimated at {own:.1%}: below that they are not known"


def run_asked(folder: Path, accuracy_text: str, budget_text: str, jobs: int, quiet: bool) -> Run:
    """Make the run of the setting that is asked for, to its report. StageError."""
    error = accuracy(accuracy_text) if accuracy_text else None
    time = budget(budget_text) if budget_text else None
    settings, head = read_results(results_of(folder))
    here = probe()
    times = [predicted(setting, head["probe"], here) for setting in settings]
    index = choose(settings, times, error, time)
    row, found = settings[index].row, settings[index].error
    run = open_run(folder, row.level, row.overrides, folder / "out" / "asked" / row.run)
    if not quiet:
        print(
            f"{row.run} (level {row.level}, {json.dumps(row.overrides)}): measured error"
            f" {found:.1%}; about {times[index]:.0f} s of CPU on this machine"
        )
        if doubt := judges_doubt(head, max(error or 0.0, found)):
            print(doubt)
        if unknown := [s.name for s in STAGES if s.name not in settings[index].seconds]:
            print(f"not counted, as nothing measured it: {', '.join(unknown)}")
    make(run, "report", Machine(row.ranks, jobs), quiet)
    if not quiet:
        records = [read_record(run.out, stage.name) for stage in STAGES]
        cpu = sum(record["cpu_time"] for record in records if record)
        print(
            f"took {cpu:.0f} s of CPU; predicted {times[index]:.0f} s, {cpu / times[index] - 1:+.0%}"
        )
    return run
