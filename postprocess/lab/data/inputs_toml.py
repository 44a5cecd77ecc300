"""Inputs that are not exactly known (reference/inputs.toml), and the runs beside the nominal one that measure what they do.

Each run is a scene of its own, `out/<level>/inputs/<name>/scene.toml`, that extends the nominal one and changes one number.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from fileio.atomic import write_text
from fileio.provenance import read_settings
from fileio.toml_text import read_toml
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.dpiv_toml import Positive, Table

MESH_LENGTHS = (
    "wall_cell", "wall_first_layer", "tip_cell", "near_cell", "far_cell", "edge_layer", "sheet_layer",
)  # fmt: skip
MESH_COUNTS = ("wall_layers",)
MESH_GROWTH = ("wall_growth", "layer_growth")


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("a run with nothing changed measures nothing; give another step than 0")
    return value


class Input(Table):
    """One number of the scene: `key` with dots, `step` of the run beside, `limit` (half-width of a uniform distribution)."""

    name: str
    key: str
    step: Annotated[float, AfterValidator(_not_zero)]
    limit: Positive
    reason: str

    @property
    def std(self) -> float:
        """Standard uncertainty of a uniform distribution."""
        return self.limit / 3**0.5


class Numerics(Table):
    """One kind of resolution: a run finer by `ratio`, and Roache's grid-convergence index of that run from the two."""

    name: Literal["grid", "time_step"]
    ratio: Annotated[float, Field(gt=1)]
    order: Positive
    safety: Positive

    @property
    def per_difference(self) -> float:
        """Standard uncertainty over the difference of the two runs: half the index, which is a 95 % band.

        What the finer run changes is added to the simulation: what is left is the finer run's error (Roache 1994, eq. 5).
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

    @property
    def names(self) -> list[str]:
        """Names of all runs beside the nominal one."""
        return [one.name for one in self.all]


def read_inputs(path: Path) -> Inputs:
    """Read and check; FileNotFoundError or ValueError in one sentence."""
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: missing; it says how well the simulation's inputs are known (docs/comparison.md)"
        )
    try:
        inputs = Inputs(**read_toml(path))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    if inputs.format != "inputs" or inputs.format_version != 1:
        raise ValueError(f'{path}: needs format = "inputs" and format_version = 1 at its top')
    return inputs


def run_folder(files: StageFiles, name: str) -> Path:
    """Folder of the scene of one run."""
    return files.out / "inputs" / name


def write_runs(files: StageFiles, inputs: Inputs, parent: str = "inputs") -> list[Path]:
    """Write the scenes of all runs into folder `parent` of the level where they changed; returns their folders."""
    numbers, parent_folder = scene_numbers(files), files.out / parent
    folders = []
    for one in inputs.input:
        root, *rest = one.key.split(".")
        table = changed(numbers, [root, *rest], one.step, one.key)
        # of the level: what the scene gives for this level would have the last word
        level = {files.level: {root: {rest[0]: table[root][rest[0]]}}}
        folders.append(_write(parent_folder / one.name, {"levels": level}))
    for finer in inputs.numerics:
        level = {files.level: _finer(numbers, finer)}
        folders.append(_write(parent_folder / finer.name, {"levels": level}))
    return folders


def write_virtual(files: StageFiles, pressure_kpa: float) -> Path:
    """Write the scene of a virtual laboratory: the last stroke goes to another pressure; returns its folder."""
    motion = read_settings(files.required("kinematics.h5", "kinematics"))["motion"]
    if not motion["strokes"]:
        raise ValueError(
            f"{files.scene_folder / 'scene.toml'}: motion.strokes is empty; a virtual laboratory changes the last of them"
        )
    strokes = [*motion["strokes"][:-1], motion["strokes"][-1] | {"pressure_kpa": pressure_kpa}]
    folder = files.out / "virtual" / f"{pressure_kpa:g}kpa"
    return _write(folder, {"motion": {"strokes": strokes}})


def changed(section: Any, keys: list[str], step: float, key: str) -> Any:
    """A section of the scene with the number at `keys` moved by `step`; ValueError where there is none."""
    first, *rest = keys
    try:
        at: Any = int(first) if isinstance(section, list) else first
        old = section[at]
        new = changed(old, rest, step, key) if rest else old + step
    except (KeyError, IndexError, TypeError, ValueError):
        raise ValueError(f"inputs.toml: the scene has no number {key!r}") from None
    if isinstance(section, list):
        return [new if k == at else value for k, value in enumerate(section)]
    return section | {at: new}


def _finer(numbers: dict[str, Any], finer: Numerics) -> dict[str, Any]:
    if finer.name == "time_step":
        return {"numerics": {"time_step": numbers["numerics"]["time_step"] / finer.ratio}}
    mesh = numbers["mesh"]
    lengths = {name: mesh[name] / finer.ratio for name in MESH_LENGTHS}
    counts = {name: round(mesh[name] * finer.ratio) for name in MESH_COUNTS}
    return {
        "mesh": lengths | counts | {name: mesh[name] ** (1 / finer.ratio) for name in MESH_GROWTH}
    }


def _write(folder: Path, tables: dict[str, Any]) -> Path:
    head = f'# Written by postprocess.lab: {folder.name}, beside the nominal run.\nextends = "../../../.."\n'
    text = head + "".join(
        f"{line}\n" for key, table in tables.items() for line in _toml(key, table)
    )
    path = folder / "scene.toml"
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    return folder


def _toml(name: str, table: dict[str, Any]) -> list[str]:
    if all(isinstance(v, dict) for v in table.values()):
        return [line for key, value in table.items() for line in _toml(f"{name}.{key}", value)]
    # TOML has no word for what is not given
    return [
        f"[{name}]",
        *(f"{key} = {_value(value)}" for key, value in table.items() if value is not None),
    ]


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items() if v is not None) + " }"
        )
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return json.dumps(value, ensure_ascii=False)
