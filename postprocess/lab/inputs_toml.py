"""The runs beside the nominal one: uncertain inputs (reference/inputs.toml), finer numerics."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationError

from pipeline.scene.key_reference import complaints
from pipeline.scene.toml_text import read_toml
from piv.files.errors import StageError
from piv.files.provenance import check_version
from piv.files.record import NAME
from postprocess.lab.dpiv_toml import Positive, Table

# Roache (1994), eq. 5: order of the scheme, and the safety factor of two grids, which assume it
ORDER, SAFETY = 2.0, 3.0
MESH_LENGTHS = ["wall_cell", "wall_first_layer", "tip_cell", "near_cell", "far_cell"]
MESH_LENGTHS += ["edge_layer", "sheet_layer"]
MESH_GROWTH = ("wall_growth", "layer_growth")


class Input(Table):
    """A number of the scene by its dotted key.

    `step`: change in the run beside; `limit`: half-width of a uniform distribution.
    """

    kind: ClassVar = "input"  # as `validation.KINDS` has it
    name: Annotated[str, Field(pattern=f"^{NAME}$")]  # of the folder of its run
    key: str
    step: Positive
    limit: Positive
    reason: str

    @property
    def per_change(self) -> float:
        """Standard uncertainty over the run's change: of a uniform distribution."""
        return self.limit / 3**0.5 / self.step

    @property
    def how(self) -> str:
        """How its uncertainty is found."""
        return f"run with {self.key} {self.step:+g}"

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


@dataclass(frozen=True)
class Finer:
    """Grid or time step finer by `ratio`, judged by Roache's grid-convergence index."""

    kind: ClassVar = "numerical"
    name: str
    ratio: float

    @property
    def per_change(self) -> float:
        """Standard uncertainty over the run's change.

        Half the convergence index of the finer run, a 95 % band.
        """
        return 0.5 * SAFETY / (self.ratio**ORDER - 1)

    @property
    def how(self) -> str:
        """How its uncertainty is found."""
        return f"grid-convergence index of the run finer by {self.ratio:g}"

    def overrides(self, numbers: dict[str, Any]) -> dict[str, Any]:
        """The finer numbers by dotted key."""
        if self.name == "time_step":
            return {"numerics.time_step": numbers["numerics"]["time_step"] / self.ratio}
        mesh = numbers["mesh"]
        values = {name: mesh[name] / self.ratio for name in MESH_LENGTHS}
        values |= {name: mesh[name] ** (1 / self.ratio) for name in MESH_GROWTH}
        values["wall_layers"] = round(mesh["wall_layers"] * self.ratio)
        return {f"mesh.{name}": value for name, value in values.items()}


NUMERICS = (Finer("grid", 1.5), Finer("time_step", 2.0))


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
