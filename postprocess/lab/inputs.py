"""What is not known of the simulation: inputs (reference/inputs.toml), and its level's error."""

from __future__ import annotations

from copy import deepcopy
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import Field, ValidationError

from pipeline.scene.key_reference import complaints
from pipeline.scene.toml_text import read_toml
from piv.files.errors import StageError
from piv.files.provenance import check_version
from piv.files.record import NAME
from postprocess.lab.dpiv_toml import Positive, Table

UNIFORM = 3**-0.5  # standard deviation over the half-width of a uniform distribution
ERRORS = {"circulation": "error_circulation", "centre": "error_centre"}
LOST = 1.0  # error of a vortex that a level does not have
LEVELS = ("smoke", "draft", "coarse", "medium", "fine", "reference")  # the first is a plane flow
MEASURED = Path(__file__).parents[2] / "cases" / "single_finger"  # plane flow against whole ones
EMPTY = pd.DataFrame(columns=["run", "start_s", "end_s", *ERRORS])


class Input(Table):
    """A number of the scene by its dotted key.

    `step`: change in the run beside; `limit`: half-width of a uniform distribution.
    """

    name: Annotated[str, Field(pattern=f"^{NAME}$")]  # of the folder of its run
    key: str
    step: Positive
    limit: Positive
    reason: str

    @property
    def per_change(self) -> float:
        """Standard uncertainty over the run's change."""
        return UNIFORM * self.limit / self.step

    @property
    def how(self) -> str:
        """How its uncertainty is found."""
        return f"{self.key} {self.step:+g}"

    def stretch(self, numbers: dict[str, Any]) -> float | None:
        """Factor by which its step lengthens a scene's only stroke; None: it does something else.

        Similarity tells what that changes, without a run.
        """
        strokes = numbers["motion"].get("strokes") or []
        if self.key != "motion.strokes.0.duration" or len(strokes) != 1:
            return None
        return float(1 + self.step / strokes[0]["duration"])

    def overrides(self, numbers: dict[str, Any]) -> dict[str, Any]:
        """The changed number by dotted key; a list, as of strokes, is replaced as a whole."""
        keys = [int(k) if k.isdigit() else k for k in self.key.split(".")]
        depth = next((n for n, k in enumerate(keys) if isinstance(k, int)), len(keys))
        changed: Any = deepcopy(numbers)
        try:
            reduce(getitem, keys[:-1], changed)[keys[-1]] += self.step
            return {".".join(map(str, keys[:depth])): reduce(getitem, keys[:depth], changed)}
        except (KeyError, IndexError, TypeError):
            raise StageError(f"inputs.toml: the scene has no number {self.key!r}") from None


class Inputs(Table):
    """The file reference/inputs.toml."""

    format: str
    format_version: int
    input: tuple[Input, ...]


def read_inputs(scene_folder: Path) -> tuple[Input, ...]:
    """The inputs in reference/inputs.toml of a scene, none without that file; StageError."""
    path = scene_folder / "reference" / "inputs.toml"
    if not path.exists():
        return ()
    table = read_toml(path)
    remedy = "remove [[numerics]] and too_uncertain, and set format_version = 2"
    check_version(table, path, "inputs", 2, remedy)
    try:
        return Inputs(**table).input
    except ValidationError as error:
        raise StageError(f"{path}: {'; '.join(complaints(error.errors(), Inputs))}") from None


def level_windows(scenes: list[Path], level: str, plane: bool) -> pd.DataFrame:
    """Relative standard uncertainties by `run` (a level) and window of time, coarsest level first.

    Columns `start_s`, `end_s` and one by quantity, of places over the tip's width; none of a level
    that was not measured. `scenes`: the scene's folder and those that it extends, nearest first;
    the first with studies/results counts. A `plane` flow errs at any level as the plane level does,
    in a scene without a study as in `MEASURED`.
    """
    for folder in [*scenes, MEASURED] if plane else scenes:
        if (path := folder / "studies" / "results" / "errors.csv").exists():
            table = pd.read_csv(path, comment="#")
            table = table[table.groupby("run")["error"].transform("count") > 0]
            if plane:
                flat = table[table["run"] == LEVELS[0]].assign(run=level)
                table = pd.concat([flat, table[table["run"] != level]])
            known = {name: UNIFORM * table[of].fillna(LOST) for name, of in ERRORS.items()}
            table = table.assign(**known)[list(EMPTY)]
            return pd.concat([table[table["run"] == one] for one in LEVELS])
    return EMPTY


def level_uncertainty(
    windows: pd.DataFrame, level: str, during: tuple[float, float]
) -> dict[str, float]:
    """The largest relative standard uncertainty of each quantity `during` (s); empty: unknown."""
    rows = windows[windows["run"] == level]
    met = rows[(rows["start_s"] < during[1]) & (rows["end_s"] > during[0])]
    rows = met if len(met) else rows.tail(1)  # later its error is at least that
    return {name: float(rows[name].max()) for name in ERRORS} if len(rows) else {}
