"""Displacements of nodes as a CSV, which docs/abaqus_export.py writes."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.fea.imported.importing import Fields
from pipeline.fea.settings import Import
from piv.formats.user_tables import read_columns

COLUMNS = ("pressure_kpa", "instance", "node", "x", "y", "z", "u1", "u2", "u3", "profile")


def read_nodes(path: Path, results: Import) -> Fields:
    """Nodes and displacements by pressure; raises ValueError with file, line, column and remedy."""
    cells = read_columns(path, COLUMNS, None)
    numeric = [name for name in COLUMNS if name != "instance"]
    table = pd.DataFrame(cells.numbers(numeric), columns=numeric).astype({"node": int})
    table["instance"] = cells.text("instance")
    states = dict(iter(table.set_index(["instance", "node"]).groupby("pressure_kpa")))
    first = next(iter(states.values()))
    for pressure, state in states.items():
        differing = first.index.symmetric_difference(state.index)
        if len(differing) or state.index.has_duplicates:
            instance, node = differing[0] if len(differing) else state.index[0]
            raise ValueError(
                f"{path}: node {node} of instance {instance!r} is not in every state once, see"
                f" {pressure:g} kPa: export all nodes of every state"
            )
    moved = [
        state.loc[first.index, ["u1", "u2", "u3"]].to_numpy(float) for state in states.values()
    ]
    return Fields(
        first[["x", "y", "z"]].to_numpy(float),
        np.array(moved),
        np.array(list(states)),
        np.flatnonzero(first["profile"]),
    )
