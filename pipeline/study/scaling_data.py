"""Data of the scaling model: measured steps, the network, and the size of a scene's mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from fileio.errors import StageError
from fileio.formats.mesh_intervals import read_intervals, read_sweep
from fileio.toml_text import read_toml
from pipeline.scene.scene import Scene
from pipeline.study.scaling_model import Network

_MEASURED = {"cells", "columns", "correctors", "step_s", "pressure_iterations"}  # of steps.csv
_DATA = Path(__file__).with_name("scaling.toml")
_STEPS = Path(__file__).with_name("steps.csv")  # of make bench-steps


def _read_steps(
    path: Path, serial_seconds_per_cell: float, fixed_s: float = 0.0
) -> tuple[dict[str, float], dict[str, float]] | None:
    """Steps on one rank and on two from `make bench-steps`, for `fit`; None without the file."""
    if not path.exists():
        return None
    table = pd.read_csv(path, comment="#")
    try:
        rows = table[
            (table["mesh"] == "moving") & (table["samples"].astype(str) == "True")
        ].set_index("ranks")
        one, two = (rows.loc[n, sorted(_MEASURED)].astype(float).to_dict() for n in (1, 2))
        mesh = {key: one[key] for key in ("cells", "columns")}
        serial = serial_seconds_per_cell * one["cells"]
        return (
            {
                **mesh,
                "correctors": one["correctors"],
                "step_s": one["step_s"],
                "serial_s": serial,
                "fixed_s": fixed_s,
                "cycles": one["pressure_iterations"],
            },
            {**mesh, "alone_s": one["step_s"], "step_s": two["step_s"]},
        )
    except (KeyError, ValueError) as error:
        raise StageError(
            f"{path}: {error} is missing or no number; run make bench-steps again"
        ) from None


def read_data(
    path: Path = _DATA, steps: Path = _STEPS
) -> tuple[dict[str, float], dict[str, float] | None, Network]:
    """Steps on one rank and on two from `make bench-steps` or scaling.toml, and the network."""
    table = read_toml(path)
    network = dict(table["network"])
    if "saturated_range" in network:
        network["saturated_range"] = tuple(network["saturated_range"])
    two = {key: value for key, value in table.get("two_ranks", {}).items() if key != "source"}
    one = table["one_rank"]
    measured_here = _read_steps(
        steps, one.get("serial_s", 0.0) / one["cells"], one.get("fixed_s", 0.0)
    )
    return (*(measured_here or (one, two or None)), Network(**network))


def size(scene: Scene) -> tuple[int, int]:
    """Cells and columns of the mesh of the longest interval; StageError without a mesh."""
    interval = max(read_intervals(scene.out), key=lambda interval: interval.end - interval.start)
    column = read_sweep(scene.out, interval.name)["cell_column"].values
    return len(column), len(np.unique(column))
