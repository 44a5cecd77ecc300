"""Many actuators by the unit cell: in parallel, with a progress bar, going on where it was interrupted."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from pipeline.fea.analyse import bend
from pipeline.fea.settings import Actuator, Fea

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Bends:
    """Pressure (Pa), radius (m) and wall gap (m) of the states that converged."""

    pressure: FloatArray
    radius: FloatArray
    wall_gap: FloatArray


def _file(folder: Path, name: str, actuator: Actuator, fea: Fea) -> Path:
    given = [actuator.model_dump(mode="json"), fea.model_dump(mode="json"), version("felupe")]
    digest = hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:12]
    return folder / f"{name}-{digest}.csv"


def _solve(path: Path, actuator: Actuator, fea: Fea) -> Path:
    states = bend(actuator, fea)
    part = path.with_suffix(".part")
    gaps = states.wall_gap if states.wall_gap is not None else np.zeros_like(states.radius)
    table = np.stack([states.pressure, states.radius, gaps], -1)
    np.savetxt(part, table, delimiter=",", header="pressure,radius,wall_gap", comments="", fmt="%.9g")
    os.replace(part, path)
    return path


def sweep(cases: dict[str, tuple[Actuator, Fea]], folder: Path, processes: int) -> dict[str, Bends]:
    """Bends of every case by name. Each is kept in `folder` under a digest of its settings and not solved again."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {name: _file(folder, name, *case) for name, case in cases.items()}
    missing = [name for name, path in files.items() if not path.exists()]
    with (
        ProcessPoolExecutor(processes) as pool,
        tqdm(
            total=len(cases), initial=len(cases) - len(missing), unit="case", disable=not sys.stderr.isatty()
        ) as bar,
    ):
        jobs = [pool.submit(_solve, files[name], *cases[name]) for name in missing]
        for job in as_completed(jobs):
            job.result()
            bar.update()
    tables = {name: np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2) for name, path in files.items()}
    return {name: Bends(*table.T) for name, table in tables.items()}
