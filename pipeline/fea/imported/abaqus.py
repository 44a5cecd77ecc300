"""Abaqus input file (.inp: nodes, instances, node sets) with a CSV of nodal displacements."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.fea.imported.importing import Fields

FloatArray = NDArray[np.float64]
COLUMNS = ("pressure_kpa", "node", "u1", "u2", "u3")


@dataclass
class _Model:
    parts: dict[str, dict[int, FloatArray]] = field(default_factory=dict)
    instances: dict[str, tuple[str, list[list[float]]]] = field(default_factory=dict)
    sets: dict[tuple[str, str], list[int]] = field(
        default_factory=dict
    )  # (name, part or instance) → labels


def _parse(path: Path) -> _Model:
    """Keyword by keyword; only what places nodes and names sets is kept. Names are compared in capitals."""
    model = _Model()
    part = instance = ""
    keyword, options = "", dict[str, str]()
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            if line.startswith("**") or not line.strip():
                continue
            if line.startswith("*"):
                keyword, *rest = [word.strip().upper() for word in line[1:].split(",")]
                options = {
                    key.strip(): value.strip()
                    for key, _, value in (word.partition("=") for word in rest)
                }
                if keyword == "PART":
                    part = options["NAME"]
                elif keyword == "END PART":
                    part = ""
                elif keyword == "INSTANCE":
                    instance = options["NAME"]
                    model.instances[instance] = (options["PART"], [])
                elif keyword == "END INSTANCE":
                    instance = ""
                continue
            words = [word.strip() for word in line.split(",") if word.strip()]
            try:
                if keyword == "NODE":
                    model.parts.setdefault(part, {})[int(words[0])] = np.array(
                        [float(w) for w in words[1:4]]
                    )
                elif keyword == "INSTANCE":
                    model.instances[instance][1].append([float(w) for w in words])
                elif keyword == "NSET":
                    owner = options.get("INSTANCE", part)
                    labels = [int(w) for w in words]
                    if "GENERATE" in options:
                        labels = list(
                            range(labels[0], labels[1] + 1, labels[2] if len(labels) > 2 else 1)
                        )
                    model.sets.setdefault((options["NSET"], owner), []).extend(labels)
            except (ValueError, IndexError) as error:
                raise ValueError(
                    f"{path}, line {number}: {line.strip()!r} is no data line of *{keyword}: correct it"
                ) from error
    return model


def _placed(points: FloatArray, lines: list[list[float]]) -> FloatArray:
    """Translation (first data line of *Instance), then rotation by an angle about an axis through two points."""
    if lines:
        points = points + lines[0][:3]
    if len(lines) > 1:
        a, b, degrees = np.array(lines[1][:3]), np.array(lines[1][3:6]), lines[1][6]
        k = (b - a) / np.linalg.norm(b - a)
        c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
        away = points - a  # Rodrigues' formula
        points = a + c * away + s * np.cross(k, away) + (1 - c) * (away @ k)[:, None] * k
    return points


def read_abaqus(path: Path, displacements: Path) -> Fields:
    """Nodes placed by their instances, and the displacements of every state.

    The CSV has columns pressure_kpa, node, u1, u2, u3 and, with more than one instance, instance; lengths are in the
    model's unit. Raises ValueError with file, key and remedy.
    """
    model = _parse(path)
    instances = model.instances or {"": ("", [])}
    places, index = [], dict[tuple[str, int], int]()
    for name, (part, lines) in instances.items():
        if part not in model.parts:
            raise ValueError(
                f"{path}: part {part!r} of instance {name!r} has no *Node: export the model flat or with its parts"
            )
        labels = list(model.parts[part])
        for label in labels:
            index[name, label] = len(index)
        places.append(_placed(np.array([model.parts[part][label] for label in labels]), lines))
    points = np.concatenate(places)

    states: dict[float, FloatArray] = {}
    only = next(iter(instances)) if len(instances) == 1 else None
    table = pd.read_csv(displacements, comment="#", skipinitialspace=True, dtype={"instance": str})
    for column in (*COLUMNS, *(("instance",) if only is None else ())):
        if column not in table:
            raise ValueError(
                f"{displacements}: column {column} is missing: write it with docs/abaqus_export.py"
            )
    for row in table.to_dict("records"):
        name = only if only is not None else row["instance"].strip().upper()
        key = (name, int(row["node"]))
        if key not in index:
            raise ValueError(
                f"{displacements}: node {row['node']} of instance {name!r} is not in {path.name}: export both from one job"
            )
        state = states.setdefault(float(row["pressure_kpa"]), np.full(points.shape, np.nan))
        state[index[key]] = [float(row[u]) for u in ("u1", "u2", "u3")]
    for pressure, values in states.items():
        absent = int(np.isnan(values[:, 0]).sum())
        if absent:
            first = next(key[1] for key, k in index.items() if np.isnan(values[k, 0]))
            raise ValueError(
                f"{displacements}: {absent} of {len(points)} nodes, first {first}, have no displacement at {pressure:g} kPa: export all nodes"
            )
    sets: dict[str, list[int]] = {}
    for (name, owner), labels in model.sets.items():
        owners = [i for i, (part, _) in instances.items() if owner in (i, part)] or [owner]
        sets.setdefault(name, []).extend(
            index[o, label] for o in owners for label in labels if (o, label) in index
        )
    progress = np.array(sorted(states))
    fields = np.array([states[p] for p in progress])
    return Fields(
        points,
        fields,
        progress,
        {name: np.array(nodes, dtype=np.intp) for name, nodes in sets.items()},
    )
