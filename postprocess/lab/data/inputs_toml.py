"""Uncertain inputs (reference/inputs.toml) and the runs beside the nominal one that vary them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from fileio.errors import StageError
from fileio.toml_text import read_toml
from postprocess.lab.data.dpiv_toml import Positive, Table

Row = tuple[str, dict[str, Any]]  # name of a run, and its values by dotted key of the scene
MESH_LENGTHS = ["wall_cell", "wall_first_layer", "tip_cell", "near_cell", "far_cell"]
MESH_LENGTHS += ["edge_layer", "sheet_layer"]
MESH_COUNTS = ("wall_layers",)
MESH_GROWTH = ("wall_growth", "layer_growth")


def _not_zero(value: float) -> float:
    if value == 0:
        raise StageError("a run with nothing changed measures nothing; give another step than 0")
    return value


class Input(Table):
    """A number of the scene by its dotted key.

    `step`: change in the run beside; `limit`: half-width of a uniform distribution.
    """

    name: str
    key: str
    step: Annotated[float, AfterValidator(_not_zero)]
    limit: Positive
    reason: str

    @property
    def per_change(self) -> float:
        """Standard uncertainty over the run's change: of a uniform distribution."""
        return self.limit / 3**0.5 / abs(self.step)


class Numerics(Table):
    """One kind of resolution: a run finer by `ratio`, judged by Roache's grid-convergence index."""

    name: Literal["grid", "time_step"]
    ratio: Annotated[float, Field(gt=1)]
    order: Positive
    safety: Positive

    @property
    def per_change(self) -> float:
        """Standard uncertainty over the run's change.

        Half the convergence index of the finer run, a 95 % band (Roache 1994, eq. 5).
        """
        return 0.5 * self.safety / (self.ratio**self.order - 1)


class Inputs(Table):
    """The file reference/inputs.toml."""

    format: str
    format_version: int
    too_uncertain: Positive
    input: tuple[Input, ...] = ()
    numerics: tuple[Numerics, ...] = ()

    @property
    def all(self) -> list[Input | Numerics]:
        """Every run beside the nominal one."""
        return [*self.input, *self.numerics]


def read_inputs(scene_folder: Path) -> Inputs:
    """Read and check reference/inputs.toml of a scene; FileNotFoundError or ValueError."""
    path = scene_folder / "reference" / "inputs.toml"
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: missing; it states how well the simulation's inputs are known"
            " (docs/comparison.md)"
        )
    try:
        inputs = Inputs(**read_toml(path))
    except ValidationError as error:
        first = error.errors()[0]
        raise StageError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    if inputs.format != "inputs" or inputs.format_version != 1:
        raise StageError(f'{path}: needs format = "inputs" and format_version = 1 at its top')
    return inputs


def input_rows(numbers: dict[str, Any], inputs: Inputs) -> list[Row]:
    """Rows of the runs beside the nominal one, whose scene has `numbers`; ValueError."""
    rows = [(one.name, _stepped(numbers, one.key, one.step)) for one in inputs.input]
    return rows + [(finer.name, _refined(numbers, finer)) for finer in inputs.numerics]


def _stepped(numbers: dict[str, Any], key: str, step: float) -> dict[str, Any]:
    """The number at `key` moved by `step`; a list, as of strokes, is replaced as a whole."""

    def moved(value: Any, keys: list[str]) -> Any:
        if not keys:
            return value + step
        if isinstance(value, list):
            at = int(keys[0])
            return [*value[:at], moved(value[at], keys[1:]), *value[at + 1 :]]
        return value | {keys[0]: moved(value[keys[0]], keys[1:])}

    keys = key.split(".")
    try:
        whole = moved(numbers, keys)
        short = next((k for k, name in enumerate(keys) if name.isdigit()), len(keys))
        for name in keys[:short]:
            whole = whole[name]
    except (KeyError, IndexError, TypeError, ValueError):
        raise StageError(f"inputs.toml: the scene has no number {key!r}") from None
    return {".".join(keys[:short]): whole}


def _refined(numbers: dict[str, Any], finer: Numerics) -> dict[str, Any]:
    if finer.name == "time_step":
        return {"numerics.time_step": numbers["numerics"]["time_step"] / finer.ratio}
    mesh = numbers["mesh"]
    values = {name: mesh[name] / finer.ratio for name in MESH_LENGTHS}
    values |= {name: round(mesh[name] * finer.ratio) for name in MESH_COUNTS}
    values |= {name: mesh[name] ** (1 / finer.ratio) for name in MESH_GROWTH}
    return {f"mesh.{name}": value for name, value in values.items()}
