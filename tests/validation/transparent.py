"""The body made transparent: water on both sides of its outline, so that the mesh moves and the flow does not know."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pipeline import case, kinematics, mesh
from pipeline.errors import StageError
from pipeline.foamfile import END, binary_list, header, write_bytes
from pipeline.guards import Guard
from pipeline.legs import read_legs, read_stage
from pipeline.motion import read_motion
from pipeline.prepare import prepare
from pipeline.quality import cell_areas, cell_centres
from pipeline.ranks import Ranks
from pipeline.scene import Scene
from pipeline.solver import solve
from pipeline.stage import read_dataset, write_dataset

Field = Callable[[np.ndarray, float], np.ndarray]  # positions (n, 2) m, time s -> velocities (n, 2) m/s
PATCHES = "tank|top|gap"


@dataclass(frozen=True)
class Cells:
    """Velocity (cell, 2) of the mesh's cells at one instant, with their centres (cell, 2) and areas."""

    centres: np.ndarray
    areas: np.ndarray
    velocity: np.ndarray


def solve_transparent(scene: Scene, initial: Field, boundary: str, quiet: bool = True) -> None:
    """Mesh, case and solution of a scene whose body lets water through.

    `boundary`: OpenFOAM's type of U on all outer sides (`slip`, or `fixedValue` of the initial field, uniform there).
    """
    scene.out.mkdir(parents=True, exist_ok=True)
    kinematics.run(scene, quiet)
    mesh.run(scene, quiet)
    path = scene.out / "planform.h5"
    legs = read_legs(scene.out)
    if len(legs) > 1:
        raise StageError(
            f"{path}: {len(legs)} planforms; a flow of known order must stay on one: refine or move less"
        )
    with read_dataset(path, "planform") as file:
        root = file.load()
    stage = read_stage(scene.out, 0)
    stage["body"] = stage["body"] * 0
    write_dataset(root, path, {"stage_0": stage})
    case.run(scene, quiet)
    folder = scene.out / "case" / legs[0].name
    first = cells(scene, 0.0, None)
    _write_velocity(folder / "0" / "U", initial(first.centres, 0.0), boundary)
    pressure = (folder / "0" / "p").read_text()
    pressure = re.sub(r"gap( +)\{[^}]*\}", r"gap\1{ type zeroGradient; }", pressure)
    (folder / "0" / "p").write_text(pressure)
    solution = (folder / "system" / "fvSolution").read_text()
    solution = solution.replace(
        "PIMPLE\n{", "PIMPLE\n{\n    pRefCell            0;\n    pRefValue           0;"
    )
    solution = re.sub(
        r"(relTol +)[\d.]+;", r"\g<1>0;", re.sub(r"(tolerance +)[\de.-]+;", r"\g<1>1e-11;", solution)
    )
    solution = re.sub(r"maxIter +\d+;", "", solution)
    (folder / "system" / "fvSolution").write_text(solution)
    (folder / "system" / "functions").write_text("// no body, no forces\n")
    prepare(scene, legs, legs[0], Ranks(), quiet)
    with tqdm(disable=True) as bar:
        solve(
            folder,
            legs[0],
            scene.motion.end_time,
            scene.numerics,
            Ranks(),
            None,
            bar,
            Guard(scene.numerics.max_courant),
        )


def cells(scene: Scene, time: float, folder: Path | None) -> Cells:
    """Cells at `time`; the velocity is read from `folder`, or zero without one."""
    stage = read_stage(scene.out, 0)
    triangles, quads = stage["triangles"].values, stage["quads"].values
    with read_dataset(scene.out / "sweep.h5", "sweep", "leg_0") as file:
        column = file["cell_column"].values
    nodes = read_motion(scene.out).nodes(time)
    centres = cell_centres(nodes, triangles, quads)[column]
    areas = cell_areas(nodes, triangles, quads)[column]
    velocity = np.zeros_like(centres) if folder is None else read_vectors(folder / "U")[:, :2]
    return Cells(centres, areas, velocity)


def at_end(scene: Scene) -> Cells:
    """Cells at the run's end."""
    time = scene.motion.end_time
    return cells(scene, time, scene.out / "case" / "leg_0" / f"{time:.8g}")


def read_vectors(path: Path) -> np.ndarray:
    """Internal values (cell, 3) of a binary volVectorField."""
    content = path.read_bytes()
    found = re.search(rb"nonuniform List<vector>\s+(\d+)\n?\(", content)
    if found is None:
        raise ValueError(f"{path}: no list of vectors in it")
    return np.frombuffer(content, "<f8", 3 * int(found.group(1)), found.end()).reshape(-1, 3)


def _write_velocity(path: Path, velocity: np.ndarray, boundary: str) -> None:
    value = " ".join(f"{c:.12g}" for c in (*velocity.mean(0), 0.0))
    outer = "slip" if boundary == "slip" else f"{boundary}; value uniform ({value})"
    sides = (
        f'    "({PATCHES})" {{ type {outer}; }}\n    sheet {{ type empty; }}\n    back {{ type empty; }}\n'
    )
    field = np.column_stack([velocity, np.zeros(len(velocity))])
    body = b"dimensions [0 1 -1 0 0 0 0];\n\ninternalField nonuniform List<vector> " + binary_list(field)
    end = f";\n\nboundaryField\n{{\n{sides}}}\n".encode()
    write_bytes(path, header("volVectorField", "0", "U", binary=True) + body + end + END)
