"""Ask for accuracy, or for a time, not for settings: the cheapest setting measured to reach it (make tradeoff).

Command: python -m pipeline choose cases/single_finger --accuracy 5% (make single_finger ACCURACY=5%, or BUDGET=10min)
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.records import COST
from fileio.json_text import parse_json, read_json
from fileio.stages import BY_NAME, STAGES
from pipeline.study.machine_speed import probe
from pipeline.study.plan import write_scenes
from pipeline.study.table import Row, parse_cell

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


def spent(out: Path) -> tuple[float, float]:
    """CPU and wall seconds of all stages in out/<level>/costs/."""
    costs = [COST.read(path) for path in sorted((out / "costs").glob("*.json"))]
    return sum(c["cpu_time"] for c in costs), sum(c["wall_time"] for c in costs)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `choose`."""
    parser.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--accuracy", help="largest error, as 5%%")
    what.add_argument("--budget", help="longest time, as 10min")
    what.add_argument(
        "--after", action="store_true", help="compare the time that it took with the predicted"
    )


def run(args: argparse.Namespace) -> None:
    """Command `choose`: before the run, or with --after what it took."""
    noted = args.scene / "out" / "studies" / STUDY / "choice.json"
    if args.after:
        _say_what_it_took(args.scene.name, noted)
        return
    error, time = (
        read(text) if text else None
        for read, text in ((accuracy, args.accuracy), (budget, args.budget))
    )
    settings, head = read_results(results_of(args.scene))
    here = probe()
    times = [predicted(setting, head["probe"], here) for setting in settings]
    index = choose(settings, times, error, time)
    row = settings[index].row
    write_scenes(args.scene, STUDY, [row])
    choice = {"run": row.run, "level": row.level, "ranks": row.ranks, "error": settings[index].error,
              "seconds": round(times[index], 1), "probe": here}  # fmt: skip
    write_text(noted, json.dumps(choice, indent=1) + "\n")
    print(
        f"choose: {row.run} (level {row.level}, {json.dumps(row.overrides)}): measured error {settings[index].error:.1%};"
        f" about {times[index]:.0f} s of CPU on this machine",
        file=sys.stderr,
    )
    if doubt := judges_doubt(head, max(error or 0.0, settings[index].error)):
        print(f"choose: {doubt}", file=sys.stderr)
    if unknown := [stage.name for stage in STAGES if stage.name not in settings[index].seconds]:
        print(f"choose: not counted, as nothing measured it: {', '.join(unknown)}", file=sys.stderr)
    print(row.run, row.level, row.ranks)  # for make


def _say_what_it_took(scene: str, noted: Path) -> None:
    choice = read_json(noted, f"run make {scene} ACCURACY=… again, which writes it")
    cpu, wall = spent(noted.parent / choice["run"] / "out" / choice["level"])
    print(
        f"choose: took {cpu:.0f} s of CPU ({wall:.0f} s by the clock, stage by stage); predicted {choice['seconds']:.0f} s,"
        f" {cpu / choice['seconds'] - 1:+.0%}"
    )
