"""What a reader must know before a page's numbers are trusted: the level's own error, and what became of the finger's work."""

from __future__ import annotations

from typing import Any

import pandas as pd

from pipeline.scene.scene import Scene
from postprocess.draw.quantity_text import NBSP

ERRORS = {
    "error_dorsal": "circulation on the dorsal side of the tip",
    "error_circulation": "circulation of the tip vortex",
    "error_centre": "place of the tip vortex (of a tip's width)",
    "error_velocity": "velocity in the sheet",
    "error_force": "force on the finger",
}
TRIAL = 0.5  # a level whose worst error is larger shows that everything works, and no number of the finger


def level_errors(run: Scene) -> dict[str, Any]:
    """ERRORS of a level against the finest run, with `scene` and `error`, the largest; empty where not measured.

    `best` is that run's level, `best_error` its own estimated error.

    From studies/results/tradeoff.csv of the scene, or of the nearest that it extends.
    """
    for scene in (run.folder, *run.parents):
        path = scene / "studies" / "results" / "tradeoff.csv"
        if path.exists():
            table = pd.read_csv(path, comment="#")
            rows = table[
                (table["run"] == run.level) & (table["kind"] == "flow") & table["error"].notna()
            ]
            if len(rows):
                best = table.loc[table["cells"].idxmax()]
                names = table.columns.intersection([*ERRORS, "error"])
                known: dict[str, Any] = {name: float(rows.iloc[0][name]) for name in names}
                return known | {
                    "scene": scene.resolve().name,
                    "best": best["level"],
                    "best_error": float(best["error"]),
                }
    return {}


def trial(errors: dict[str, Any], level: str) -> str:
    """Why a level is for trying out alone; empty where it is not."""
    if not errors or errors["error"] <= TRIAL:
        return ""
    return f"level {level} shows that everything works, its numbers are wrong by up to {100 * errors['error']:.0f}{NBSP}%"


def level_sentence(errors: dict[str, Any], scene: str, level: str) -> str:
    """The level's numerical uncertainty in words."""
    if not errors:
        return f"Level {level}: its numerical error was not measured for this scene (make tradeoff SCENE={scene} measures it)."
    # the tip vortex is shown beside the dorsal side, where that was measured and judged
    worst = min(ERRORS.keys() & errors.keys(), key=lambda name: abs(errors[name] - errors["error"]))
    per_cent = lambda name: f"{100 * errors[name]:.1f}{NBSP}%"  # noqa: E731
    rest = ", ".join(
        f"{words} {per_cent(name)}"
        for name, words in ERRORS.items()
        if name != worst and name in errors
    )
    against = (
        "extrapolated from the level below"
        if level == errors["best"]
        else f"against level {errors['best']}, the finest that was run, whose own error is estimated at {per_cent('best_error')}"
    )
    return (
        f"Level {level} errs by {per_cent(worst)} at worst ({ERRORS[worst]}); {rest}: {against},"
        f" on scene {errors['scene']}."
    )


def power_sentence(balance: dict[str, Any]) -> str:
    """How much of the finger's work the schemes take, and how much is unexplained, of run.json's `power_balance`."""
    work = abs(balance["work"]) or 1.0
    schemes = (balance["taken"]["convection"] + balance["taken"]["coupling"]) / work
    return (
        f"Of the finger's work on the water the numerical schemes take {100 * schemes:.0f}{NBSP}%, which the water would not;"
        f" {100 * abs(balance['unexplained_fraction']):.1f}{NBSP}% is unexplained."
    )
