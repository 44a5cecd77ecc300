"""The whole finger in 3-D by CalculiX: pressurisation of second-order hexahedra."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fileio.atomic import check_room, write_text
from fileio.errors import StageError
from pipeline.fea.settings import Actuator, Material
from pipeline.fea.solid.mesh import Solid

FloatArray = NDArray[np.float64]
INSTALL = "install it with `apt-get install calculix-ccx`"
FACES = [
    (0, 1, 2, 3),
    (4, 7, 6, 5),
    (0, 4, 5, 1),
    (1, 5, 6, 2),
    (2, 6, 7, 3),
    (3, 7, 4, 0),
]  # P1 … P6


def executable() -> str:
    """Path of CalculiX's solver; raises StageError with the command that installs it."""
    program = shutil.which("ccx")
    if program is None:
        raise StageError(
            f'engine = "calculix" needs the program ccx, which is not on the path: {INSTALL}'
        )
    return program


def release() -> str:
    """CalculiX's version, as it prints it."""
    done = subprocess.run([executable(), "-v"], capture_output=True, text=True, check=False)
    return done.stdout.split()[-1]


def hyperelastic(material: Material) -> str:
    """CalculiX's *HYPERELASTIC card of a law; raises ValueError where it knows none. D1 = 2 / bulk."""
    p, d = material.number, 2 / material.bulk
    if material.law == "neo_hooke":
        return f"*HYPERELASTIC, NEO HOOKE\n{_numbers([p('mu') / 2, d])}"
    if material.law == "mooney_rivlin":
        return f"*HYPERELASTIC, MOONEY-RIVLIN\n{_numbers([p('C10'), p('C01'), d])}"
    if material.law == "yeoh":
        # D2 and D3 stiffen the volume at large changes only; 1e-3 of D1's stiffness leaves the law as given
        return (
            f"*HYPERELASTIC, YEOH\n{_numbers([p('C10'), p('C20'), p('C30'), d, 1e3 * d, 1e3 * d])}"
        )
    raise ValueError(
        f'law = {material.law!r} is not one that engine = "calculix" offers here: '
        'use neo_hooke, mooney_rivlin or yeoh, or engine = "unit_cell"'
    )


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{float(v):.9e}" for v in values)


def _set(name: str, nodes: NDArray[np.intp]) -> str:
    rows = [", ".join(str(i + 1) for i in nodes[k : k + 8]) for k in range(0, len(nodes), 8)]
    return f"*NSET, NSET={name}\n" + ",\n".join(rows)


def _elements(name: str, cells: NDArray[np.intp], first: int) -> str:
    rows = [
        f"{first + number}, {', '.join(str(i + 1) for i in cell[:10])},\n{', '.join(str(i + 1) for i in cell[10:])}"
        for number, cell in enumerate(cells)
    ]
    return f"*ELEMENT, TYPE=C3D20R, ELSET={name}\n" + "\n".join(rows)


def _pressure_faces(solid: Solid) -> NDArray[np.intp]:
    """Element and face (face, 2), both from 1, of what the pressure wets."""
    cells = np.concatenate([solid.lower, solid.upper])
    return np.argwhere(solid.cavity[cells[:, FACES]].all(-1)) + 1


def deck(solid: Solid, actuator: Actuator, pressures: FloatArray) -> str:
    """Input file: root clamped, z = 0 symmetric, the cavities' pressure ramped to its last value (Pa).

    `pressures` (> 0, ascending) are the states written out; time is the fraction of the last one.
    """
    top = float(pressures[-1])
    nodes = "\n".join(f"{i + 1}, {_numbers(p)}" for i, p in enumerate(solid.points))
    loads = "\n".join(f"{element}, P{face}, {top:.9e}" for element, face in _pressure_faces(solid))
    cards = [
        "*NODE, NSET=ALL",
        nodes,
        _elements("LOWER", solid.lower, 1),
        _elements("UPPER", solid.upper, 1 + len(solid.lower)),
        _set("ROOT", solid.nodes(0, 0.0)),
        _set("SYMMETRY", solid.nodes(2, 0.0)),
    ]
    for layer in ("lower", "upper"):
        cards += [
            f"*MATERIAL, NAME={layer.upper()}",
            hyperelastic(getattr(actuator.materials, layer)),
        ]
        cards += [f"*SOLID SECTION, ELSET={layer.upper()}, MATERIAL={layer.upper()}"]
    cards += [
        "*BOUNDARY\nROOT, 1, 3\nSYMMETRY, 3, 3",
        "*TIME POINTS, NAME=STATES\n" + "\n".join(f"{p / top:.9e}," for p in pressures),
        "*STEP, NLGEOM, INC=500\n*STATIC\n0.05, 1., 1e-5, 0.1",
        # its tangent lacks part of the follower pressure, so that it converges steadily but linearly: allow it the time
        "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n8, 20, 9, 100, 60, 4, , 5",
        f"*DLOAD\n{loads}",
        "*NODE FILE, TIME POINTS=STATES\nU",
        "*END STEP",
    ]
    return "\n".join(cards) + "\n"


def run(folder: Path, text: str) -> Path:
    """Solve in `folder` (finger.inp → finger.frd); raises StageError with the log's last line where it fails."""
    program = executable()
    write_text(folder / "finger.inp", text)
    done = subprocess.run(
        [program, "finger"],
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    write_text(folder / "finger.log", done.stdout + done.stderr)
    if done.returncode or "*ERROR" in done.stdout:
        check_room(folder)
        reasons = [line.strip() for line in done.stdout.splitlines() if "*ERROR" in line]
        raise StageError(
            f"{folder / 'finger.log'}: CalculiX stopped ({(reasons or ['no reason given'])[0]}): "
            "ask for a lower pressure or a finer solid_mesh"
        )
    return folder / "finger.frd"
