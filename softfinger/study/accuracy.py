"""Choose the settings of a run by accuracy or time, from the measurements of make tradeoff."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from pipeline.fea.up_to_date import check_states
from pipeline.kinematics.camera_window import tip_path
from pipeline.runs.estimate import duration, estimate, of_page
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME, STAGES, until
from pipeline.scene.read_toml import command, read_layers
from pipeline.scene.scene import Scene, load_scene
from piv.files.errors import StageError
from piv.files.json_text import parse_json
from piv.files.record import read_record
from piv.formats.user_tables import read_columns
from softfinger.make import Machine, make
from softfinger.study.machine_speed import probe
from softfinger.study.rows import read_study

_NUMBER = r"(\d+\.?\d*|\.\d+)"
_SHORT = ("smoke", "draft", "coarse")  # runs of a study from which errors can be extrapolated
_UNITS = {"s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class Setting:
    """A measured level: MPI ranks, CPU seconds by stage, relative errors.

    `errors`: the largest in each window of the stroke, by the window's start (s).
    """

    level: str
    ranks: int
    errors: dict[float, float]
    seconds: dict[str, float]

    def error(self, until: float = np.inf) -> float:
        """The largest error of the windows that begin before `until` (s), at least of the first."""
        return largest_error(self.errors, until)


def largest_error(errors: dict[float, float], until: float) -> float:
    """The largest of `errors` by their window's start (s), of windows that begin before `until`."""
    return max(error for start, error in errors.items() if start < until or start == min(errors))


def results_of(scene: Scene) -> tuple[Path, str]:
    """The table of the settings that were measured for a scene, or for one that it extends.

    And a warning where it is another's; StageError where there is none, or none that is near.
    """
    folders = scene.folder, *scene.parents
    paths = [folder / "studies" / "results" / "tradeoff.csv" for folder in folders]
    path = next((path for path in paths if path.exists()), None)
    if path == paths[0]:
        return path, ""
    why = "no settings were measured for it"
    if path is not None:
        home = path.parents[2]
        other, own = (
            _of_motion(load_scene(folder, scene.level)) for folder in (home, scene.folder)
        )
        apart = [
            f"{name} {value:.3g} against {other[name]:.3g}"
            for name, value in own.items()
            if not other[name] / _NEAR[name] <= value <= other[name] * _NEAR[name]
        ]
        if not apart:
            return (
                path,
                f"warning: the errors were measured on {home.resolve().name}, a scene like it",
            )
        why = f"those of {home.resolve().name} are of another motion ({', '.join(apart)})"
    try:
        short, whole = (duration(_study_time(scene, only)) for only in (_SHORT, ()))
    except StageError as error:  # no table of runs, or a level of it is not this scene's
        raise StageError(f"{scene.folder}: {why}; {error}") from None
    raise StageError(
        f"{scene.folder}: {why}; measure its own with softfinger tradeoff"
        f" {quote(str(scene.folder))} --only {','.join(_SHORT)}, about {short} of CPU time, which"
        f" extrapolates the error of {_SHORT[-1]}, or by the whole study with"
        f" {command('tradeoff', scene.folder)}, about {whole}"
    )


# largest ratio of two scenes' numbers whose level errors are alike
_NEAR = {"fingers": 1.0, "turns of the pressure": 1.0, "Reynolds number": 2.0, "length (m)": 1.5}


def _of_motion(scene: Scene) -> dict[str, float]:
    path = tip_path(scene)
    return {
        "fingers": 2.0 if scene.pinch else 1.0,
        "turns of the pressure": 1.0 + path.turns,
        "Reynolds number": path.speed * scene.finger.width / scene.fluid.kinematic_viscosity,
        "length (m)": scene.finger.length,
    }


def study_table(scene: Scene) -> Path:
    """The table of runs that measures what accuracy costs, of a scene or of one that it extends."""
    for folder in (scene.folder, *scene.parents):
        if (path := folder / "studies" / "tradeoff.csv").exists():
            return path
    raise StageError(
        f"{scene.folder / 'studies' / 'tradeoff.csv'}: no such study; give a table, as"
        " cases/single_finger/studies/tradeoff.csv"
    )


def _study_time(scene: Scene, only: tuple[str, ...]) -> float:
    """The predicted CPU time of the study, or of some runs, s; equal stages count once."""
    out, seconds = scene.folder / "out" / "studies" / "tradeoff", dict[str, float]()
    rows = read_study(study_table(scene))
    for row in (row for row in rows if not only or row.run in only):
        run = open_run(scene.folder, row.level, row.overrides, out / row.run)
        for stage in until(row.until):
            seconds[run.digest(stage.name)] = estimate(run, stage.name)[0]
    return sum(seconds.values())


def read_results(path: Path) -> tuple[list[Setting], dict[str, Any]]:
    """Settings of a table of results, and its head; StageError where it is unusable.

    The head has the `probe` of the machine that measured, the name of the `best` run (the
    reference of the errors), and `best_errors`, its own by window, where they were estimated.
    """
    remedy = f"make it anew with {command('tradeoff', path.parents[2])}"
    (head, records), (_, windows) = (
        _read_table(file, remedy) for file in (path, path.with_name("errors.csv"))
    )
    errors: dict[str, dict[float, float]] = {}
    for window in windows:
        of_run = errors.setdefault(window["run"], {})
        of_run[float(window["start_s"])] = float(window["error"] or "inf")
    head["best_errors"] = errors.get(head.get("best", ""), {})
    settings = []
    for record in records:
        seconds = {k[8:-2]: float(v) for k, v in record.items() if k.startswith("predict_") and v}
        # the page of a level knows its errors with no other key changed
        if record["error"] and record["run"] == record["level"] and seconds:
            ranks = int(float(record["ranks"]))
            settings.append(Setting(record["level"], ranks, errors[record["run"]], seconds))
    if "probe" not in head or not settings:
        raise StageError(f"{path}: no probe or no settings in it; {remedy}")
    return settings, head


def _read_table(path: Path, remedy: str) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """Head and rows of a CSV file; StageError where it is missing."""
    if not path.exists():
        raise StageError(f"{path}: missing; {remedy}")
    table = read_columns(path, ["run"], None)
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    head = parse_json(first[1:], path, remedy) if first.startswith("#") else {}
    return head, [dict(zip(table.names, row, strict=True)) for row in table.rows]


def parse_accuracy(text: str) -> float:
    """Relative error of a text such as "5%" or "0.05"."""
    match = re.fullmatch(rf"\s*{_NUMBER}\s*(%?)\s*", text)
    value = float(match.group(1)) * (0.01 if match.group(2) else 1.0) if match else -1.0
    if not 0 < value < 1:
        raise StageError(f"ACCURACY={text}: give a share between 0 and 1, as 5% or 0.05")
    return value


def parse_time(text: str, key: str) -> float:
    """Seconds of the value of a `key`, such as "10min", "2h" or "0.2s"."""
    match = re.fullmatch(rf"\s*{_NUMBER}\s*([a-z]+)\s*", text)
    if not match or match.group(2) not in _UNITS or float(match.group(1)) <= 0:
        raise StageError(f"{key}={text}: give a time, as 10min, 2h or 90s")
    return float(match.group(1)) * _UNITS[match.group(2)]


def predicted_time(setting: Setting, there: dict[str, float], here: dict[str, float]) -> float:
    """CPU seconds of a setting here; there, here: probes of the measuring and this machine."""
    ratio = {piece: here[piece] / there[piece] for piece in there}
    return sum(
        seconds * ratio["solver" if BY_NAME[stage].ranks else "images"]
        for stage, seconds in setting.seconds.items()
    )


def choose(
    settings: list[Setting],
    times: list[float],
    most_error: float | None,
    most_time: float | None,
    until: float = np.inf,
) -> int:
    """Index of the cheapest setting within `most_error`, or the most accurate in `most_time` (s).

    Errors are those `until` an instant (s). StageError with the nearest setting where there is
    none.
    """
    order = range(len(settings))
    errors = [setting.error(until) for setting in settings]
    if most_error is not None:
        good = [k for k in order if errors[k] <= most_error]
        if not good:
            best = min(order, key=lambda k: errors[k])
            part = "a part of the stroke (--until 0.2s), " if np.isinf(until) else ""
            raise StageError(
                f"no measured setting reaches {100 * most_error:.3g} %; the best,"
                f" {settings[best].level}, is within {100 * errors[best]:.3g} %: give"
                f" that, {part}or set the scene finer yourself"
            )
        return min(good, key=lambda k: times[k])
    assert most_time is not None
    good = [k for k in order if times[k] <= most_time]
    if not good:
        fast = min(order, key=lambda k: times[k])
        raise StageError(
            f"no measured setting takes {most_time:.0f} s or less; the fastest,"
            f" {settings[fast].level}, takes {times[fast]:.0f} s"
        )
    return min(good, key=lambda k: errors[k])


def reference_warning(head: dict[str, Any], error: float, until: float = np.inf) -> str:
    """A sentence where `error` is below that of the reference run; empty otherwise."""
    if not head["best_errors"]:
        return ""
    own = largest_error(head["best_errors"], until)
    if error >= own:
        return ""
    return (
        f"errors are relative to {head['best']}, whose own error is estimated at {own:.1%}:"
        " smaller ones are not known"
    )


def make_cheapest(
    folder: Path, accuracy: str, budget: str, until: str, machine: Machine, quiet: bool
) -> Run:
    """Make the report of the setting that `choose` gives for an accuracy or a budget.

    `until`: a time as text, after which errors do not count; empty: all of the stroke counts.
    """
    error = parse_accuracy(accuracy) if accuracy else None
    time = parse_time(budget, "BUDGET") if budget else None
    last = parse_time(until, "--until") if until else np.inf
    scene = open_run(folder).scene
    check_states(scene)
    try:
        path, warning = results_of(scene)
    except StageError:
        if time is None:
            raise
        return _make_finest(folder, time, machine, quiet)
    if warning:
        print(warning)
    settings, head = read_results(path)
    here = probe()
    times = [predicted_time(setting, head["probe"], here) for setting in settings]
    index = choose(settings, times, error, time, last)
    chosen, found = settings[index], settings[index].error(last)
    run = open_run(folder, chosen.level, {}, folder / "out" / "asked" / chosen.level)
    if not quiet:
        print(
            f"level {chosen.level}: measured error {found:.1%}"
            f"{f' until {last:g} s' if until else ''}; about {times[index]:.0f} s of CPU on this"
            " machine"
        )
        if doubt := reference_warning(head, max(error or 0.0, found), last):
            print(doubt)
        if unknown := [s.name for s in STAGES if s.name not in chosen.seconds]:
            print(f"not counted, because not measured: {', '.join(unknown)}")
    make(run, "report", replace(machine, ranks=chosen.ranks), quiet)
    if not quiet:
        records = [read_record(run.out, stage.name) for stage in STAGES]
        cpu = sum(record["cpu_time"] for record in records if record)
        ratio = cpu / times[index] - 1
        print(f"took {cpu:.0f} s of CPU; predicted {times[index]:.0f} s, {ratio:+.0%}")
    return run


def finest_within(folder: Path, time: float) -> tuple[Run, float]:
    """The run of the level that takes longest within `time` (s) by its estimate, and its estimate.

    StageError with the fastest where none does.
    """
    layers = read_layers(folder / "scene.toml")
    names = dict.fromkeys(name for layer in layers for name in layer.levels)
    runs = [open_run(folder, name, {}, folder / "out" / "asked" / name) for name in names]
    times = [of_page(run) for run in runs]
    good = [k for k in range(len(runs)) if times[k] <= time]
    if not good:
        fast = int(np.argmin(times))
        raise StageError(
            f"no level takes {time:.0f} s or less; the fastest, {runs[fast].scene.level}, takes"
            f" about {times[fast]:.0f} s"
        )
    best = max(good, key=lambda k: times[k])
    return runs[best], times[best]


def _make_finest(folder: Path, time: float, machine: Machine, quiet: bool) -> Run:
    run, seconds = finest_within(folder, time)
    if not quiet:
        print(
            f"level {run.scene.level}: its error is not measured for this scene; about"
            f" {duration(seconds)} of CPU on this machine"
        )
    make(run, "report", machine, quiet)
    return run
