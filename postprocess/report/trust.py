"""The numerical error of a level by windows of the stroke, as the study of the trade-off has it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.scene.read_toml import command
from postprocess.words import NBSP, quantity

_ERRORS = {
    "error_circulation": "circulation of the tip vortex",
    "error_centre": "its centre, of the tip's width",
    "error_near_tip": "velocity within two tip widths of the tip",
    "error_velocity": "velocity in the sheet, of the tip's speed",
    "error_force": "force on the finger",
}
_HOLDS = 0.25  # error from which on a page's numbers do not count as known
_TRIAL = 0.5  # in mid-stroke: a level shows that everything works, and no number of the finger


@dataclass(frozen=True)
class LevelError:
    """What a page says of its level's error.

    `trial`: why the level is for trying out alone ("" where it is not). `table`: names of the
    quantities and rows (window, their errors) as text. `end`: instant (s) from which on an error
    exceeds _HOLDS or none was measured; None where nothing was.
    """

    sentence: str
    trial: str = ""
    table: tuple[list[str], list[tuple[str, list[str]]]] | None = None
    end: float | None = None


def level_error(
    scenes: list[Path],
    level: str,
    middle: tuple[float, float] | None = None,
    run_end: float = math.inf,
) -> LevelError:
    """The error of a level; `middle`: instants (s) of the middle of this scene's stroke.

    Windows that begin after `run_end` (s) are left out, and the last one ends there.
    `scenes`: the scene's folder and those that it extends, nearest first; the first with
    studies/results that have the level counts. Windows of another scene are stretched to the pace
    of this one's stroke.
    """
    unknown = (
        f"Level {level}: its numerical error was not measured for this scene"
        f" ({command('tradeoff', scenes[0])} measures it)."
    )
    for folder, table, windows in _measured(scenes, level):
        own = folder == scenes[0]
        if middle and not own:
            windows = _stretched(windows, middle)
        # a run that ends before the middle of the stroke has the errors of that
        begun, ends = windows["start_s"] < run_end, windows["end_s"].clip(upper=run_end)
        windows = windows.assign(end_s=ends.where(begun, windows["end_s"]))
        windows = windows[begun | (windows.index == 0)]
        if windows["error"].notna().any():
            name = folder.resolve().name
            said = _said(windows, table, name, level)
            if own:
                return said
            trial = said.trial and f"{said.trial} on scene {name}"
            return LevelError(f"{unknown} {said.sentence}", trial, said.table, said.end)
    return LevelError(unknown)


def measured_errors(scenes: list[Path], level: str) -> dict[str, float]:
    """Errors of a level in mid-stroke, by column of errors.csv; empty where none was measured.

    `scenes`: as of `level_error`.
    """
    for _, _, windows in _measured(scenes, level):
        first = windows.iloc[0]
        return {name: float(first[name]) for name in _ERRORS if pd.notna(first.get(name))}
    return {}


def _measured(scenes: list[Path], level: str) -> Iterator[tuple[Path, pd.DataFrame, pd.DataFrame]]:
    """Folder, table of errors.csv and rows of a level, of each of the scenes that has measured it.

    Rows are sorted by time.
    """
    for folder in scenes:
        path = folder / "studies" / "results" / "errors.csv"
        if path.exists():
            table = pd.read_csv(path, comment="#")
            windows = table[table["run"] == level].sort_values("start_s", ignore_index=True)
            if windows["error"].notna().any():
                yield folder, table, windows


def _stretched(windows: pd.DataFrame, middle: tuple[float, float]) -> pd.DataFrame:
    """Windows (s) of a stroke of another pace, of which the first is the middle of the stroke."""
    start, end = windows.loc[0, ["start_s", "end_s"]]
    pace = (middle[1] - middle[0]) / (end - start)
    at = {name: middle[0] + pace * (windows[name] - start) for name in ("start_s", "end_s")}
    return windows.assign(**at)


def _said(windows: pd.DataFrame, table: pd.DataFrame, scene: str, level: str) -> LevelError:
    known = {name: words for name, words in _ERRORS.items() if name in windows}
    unknown_as_large = windows["error"].fillna(math.inf)  # of a vortex that was not found
    parts = ", ".join(
        f"{_percent(error)} until {end:.3f}{NBSP}s"
        for error, end in zip(windows["error"], windows["end_s"], strict=True)
    )
    against = "extrapolated from the levels below"
    if pd.notna(best := windows["reference"].iloc[0]):
        against = f"against level {best}, the finest whole stroke that was run"
        own = table.loc[table["run"] == best, "error"].max()
        if pd.notna(own):
            against += f", whose own error is estimated at {_percent(own)} at most"
    rows = [
        (f"{row['start_s']:.3f} to {row['end_s']:.3f}", [_percent(row[name]) for name in known])
        for _, row in windows.iterrows()
    ]
    wrong = windows.index[unknown_as_large > _HOLDS]
    end = windows.loc[wrong[0], "start_s"] if len(wrong) else windows["end_s"].iloc[-1]
    most = 100 * windows["error"].max()
    trial = f"those of level {level} are wrong by up to {most:.0f}{NBSP}%"
    return LevelError(
        f"Level {level} errs by at most {parts}: {against}, on scene {scene}.",
        trial if unknown_as_large.iloc[0] > _TRIAL else "",
        (list(known.values()), rows),
        float(end),
    )


def _percent(error: float) -> str:
    return quantity(float(error) if pd.notna(error) else None, "fraction")
