"""CalculiX's result file `.frd` (ASCII, its default)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.fea.imported.importing import Fields
from pipeline.fea.settings import Import


def read_frd(path: Path, results: Import) -> Fields:
    """Nodes and displacements of all states; raises ValueError where the file lacks some.

    Source: the manual of CalculiX CrunchiX, "The .frd format" (fixed columns).
    """
    del results  # an .frd needs no settings
    nodes: dict[str, list[float]] = {}
    times: list[float] = []
    states: list[dict[str, list[float]]] = []
    block, time = None, 0.0
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        key = line[:3].strip()
        if line[:6].strip() == "2C":
            block = nodes
        elif line[:6].strip() == "100C":
            time = float(line[12:24])
        elif key == "-4" and line[5:13].strip() == "DISP":
            block = {}
            times.append(time)
            states.append(block)
        elif key in ("-3", "-4"):
            block = None
        elif key == "-1" and block is not None:
            block[line[3:13]] = [float(line[i : i + 12]) for i in (13, 25, 37)]
    if block is not None:
        raise ValueError(
            f"{path}: the file ends within a block of"
            f" {'nodes' if block is nodes else 'displacements'}:"
            " let the CalculiX run finish and import again"
        )
    if not states or not nodes:
        raise ValueError(
            f"{path}: no {'displacements' if nodes else 'nodes'} found:"
            " request them with *NODE FILE and U in ASCII"
        )
    for time, state in zip(times, states, strict=True):
        if state.keys() != nodes.keys():
            raise ValueError(
                f"{path}: {len(state)} displacements for {len(nodes)} nodes at time {time:g}:"
                " export all nodes of every state"
            )
    points = np.array(list(nodes.values()))
    displacements = np.array([[state[label] for label in nodes] for state in states])
    return Fields(points, displacements, np.array(times), np.empty(0, int))
