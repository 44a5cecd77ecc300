"""Nodes and displacements of CalculiX's result file `.frd` (ASCII, its default)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def read_frd(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (state), coordinates (node, 3) and displacements (state, node, 3) of all states.

    In the units of the file. Raises ValueError where the file has no nodes, no displacements, or ends within a block.
    Source: the format's description in the manual of CalculiX CrunchiX, "The .frd format" (fixed columns).
    """
    labels: list[int] = []
    places: list[list[float]] = []
    times: list[float] = []
    fields: list[dict[int, list[float]]] = []
    block, time = "", 0.0
    with open(path, encoding="ascii", errors="replace") as file:
        for line in file:
            key = line[:3].strip()  # of data and of the lines around them
            if line[:6].strip() == "2C":
                block = "nodes"
            elif line[:6].strip() == "100C":
                time = float(line[12:24])
            elif key == "-4":
                block = "displacements" if line[5:13].strip() == "DISP" else ""
                if block:
                    times.append(time)
                    fields.append({})
            elif key == "-3":
                block = ""
            elif key == "-1" and block:
                label, values = int(line[3:13]), [float(line[i : i + 12]) for i in (13, 25, 37)]
                if block == "nodes":
                    labels.append(label)
                    places.append(values)
                else:
                    fields[-1][label] = values
    if block:
        raise ValueError(
            f"{path}: the file ends within a block of {block}: let the CalculiX run finish and import again"
        )
    if not labels or not fields:
        raise ValueError(
            f"{path}: no {'displacements' if labels else 'nodes'} found: request them with *NODE FILE and U in ASCII"
        )
    for time, field in zip(times, fields, strict=True):
        if len(field) != len(labels):
            raise ValueError(
                f"{path}: {len(field)} displacements for {len(labels)} nodes at time {time:g}: export all nodes of every state"
            )
    displacements = np.array([[field[label] for label in labels] for field in fields])
    return np.array(times), np.array(places), displacements
