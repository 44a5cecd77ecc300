"""Data of the scaling model: measured steps, the network, and the size of a scene's mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fileio.formats.mesh_intervals import read_intervals, read_sweep
from fileio.toml_text import read_toml
from pipeline.scene.scene import Scene
from pipeline.study.scaling_model import Network

_DATA = Path(__file__).with_name("scaling.toml")


def read_data() -> tuple[dict[str, float], dict[str, float], Network]:
    """Measured steps on one rank and on two, and the network."""
    table = read_toml(_DATA)
    return table["one_rank"], table["two_ranks"], Network(**table["network"])


def size(scene: Scene) -> tuple[int, int]:
    """Cells and columns of the mesh of the longest interval; StageError without a mesh."""
    interval = max(read_intervals(scene.out), key=lambda interval: interval.end - interval.start)
    column = read_sweep(scene.out, interval.name)["cell_column"].values
    return len(column), len(np.unique(column))
