"""The numerical error of a level, as the study of the trade-off measured it."""

from pathlib import Path

import pandas as pd

from pipeline.scene.read_toml import command
from postprocess.words import NBSP, quantity

_ERRORS = {
    "error_dorsal": "circulation on the dorsal side of the tip",
    "error_circulation": "circulation of the tip vortex",
    "error_centre": "place of the tip vortex relative to the tip's width",
    "error_velocity": "velocity in the sheet",
    "error_force": "force on the finger",
}
_TRIAL = 0.5  # a level of a larger error shows that everything works, and no number of the finger


def level_error(scenes: list[Path], level: str) -> tuple[str, str]:
    """A sentence on the level's error, and why it is for trying out alone ("" where it is not).

    `scenes`: the scene's folder and those that it extends, nearest first; the first with a
    studies/results/tradeoff.csv that has the level counts.
    """
    unknown = (
        f"Level {level}: its numerical error was not measured for this scene"
        f" ({command('tradeoff', scenes[0])} measures it)."
    )
    for folder in scenes:
        path = folder / "studies" / "results" / "tradeoff.csv"
        table = pd.read_csv(path, comment="#") if path.exists() else None
        if table is None:
            continue
        rows = table[(table["run"] == level) & (table["kind"] == "flow") & table["error"].notna()]
        if len(rows):
            best = table.loc[table["cells"].idxmax()]
            sentence, trial = _sentence(rows.iloc[0], best, folder.resolve().name, level)
            if folder == scenes[0]:
                return sentence, trial
            of = f" on scene {folder.resolve().name}"
            return f"{unknown} {sentence}", trial and f"{trial}{of}"
    return unknown, ""


def _sentence(row: pd.Series, best: pd.Series, scene: str, level: str) -> tuple[str, str]:
    known = {name: words for name, words in _ERRORS.items() if pd.notna(row.get(name))}
    worst = max(known, key=lambda name: float(row[name]))
    shown = {name: quantity(float(row[name]), "fraction") for name in known}
    rest = ", ".join(f"{words} {shown[name]}" for name, words in known.items() if name != worst)
    against = (
        f"against level {best['level']}, the finest that was run, whose own error is estimated"
        f" at {quantity(float(best['error']), 'fraction')}"
    )
    if level == best["level"]:
        against = "extrapolated from the level below"
    elif pd.notna(row.get("reference")):  # of a row that was renewed alone
        against = f"against level {row['reference']}"
    near = ""
    if pd.notna(row.get("error_near_tip")):
        share = quantity(float(row["error_near_tip"]), "fraction")
        near = f" Within two tip widths of the tip its velocity errs by {share} of the flow there."
    trial = f"those of level {level} are wrong by up to {100 * row['error']:.0f}{NBSP}%"
    return (
        f"Level {level} errs by {shown[worst]} at worst ({known[worst]}); {rest}: {against},"
        f" on scene {scene}.{near}",
        trial if row["error"] > _TRIAL else "",
    )
