"""What a current adds to an OpenFOAM case: inflow, outflow and walls, and their samples."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy import ndarray

from pipeline.geometry.sweep import PolyMesh
from pipeline.openfoam.foamfile import write_field
from pipeline.openfoam.through_flow import ENDS, WALLS
from pipeline.scene.current import Current, Stream
from piv.files.atomic import write_text

_MOST_VALUES = 2e6  # of a boundary layer's inflow in files, over time and faces
_SAME = 1e-12  # of the largest speed: steps that change less are left out
_WRITTEN = "writeControl timeStep; writeInterval 1; log no;"


def write_current(
    stream: Stream, times: ndarray, mesh: PolyMesh, points: ndarray, folder: Path
) -> None:
    """Add a current to the fields of a case in `folder` with these `points` (point, 3) m.

    `times` (s): of its time steps.
    Inflow: the velocity at each time step. Outflow: pressure 0, velocity without gradient, and
    where water enters there, its speed across the face alone (pressureInletOutletVelocity).
    """
    current = stream.current
    speed = stream.law(times)
    middles = face_middles(mesh, points, "upstream")
    share = stream.share(middles[:, 1])
    # the first fluxes follow from this value: as much flows in as out
    first = f" value uniform ({stream.begins * float(share.mean()):.10g} 0 0);"
    if current.profile == "uniform":
        inflow = _table(times, speed)
    else:
        inflow = "type timeVaryingMappedFixedValue; mapMethod nearest; setAverage no;"
        _write_samples(folder, middles, share, times, speed)
    slips = {"tank": "type slip;"} if current.walls == "slip" else {}
    held = {"top": "type noSlip;"} if current.channel else {}
    zero = dict.fromkeys(ENDS, "type zeroGradient;")
    entries = {
        "U": {
            "upstream": inflow + first,
            "downstream": "type pressureInletOutletVelocity;" + first,
        }
        | slips
        | held,
        # an accelerated stream has a gradient of the pressure there; fixedFluxPressure has none
        "p": {
            "upstream": "type fixedFluxExtrapolatedPressure; value uniform 0;",
            "downstream": "type fixedValue; value uniform 0;",
        },
        "nut": zero,
        "pointDisplacement": dict.fromkeys(ENDS, "type calculated;"),
    }
    fields = next(path for path in (folder / "0", folder / "0.orig") if path.is_dir())
    for name, patches in entries.items():
        _add_patches(fields / name, patches)


def start_stream(stream: Stream, heights: ndarray, folder: Path) -> None:
    """Let the undisturbed stream be the first velocity; `heights` (cell,) m above the bottom."""
    first = folder / "0" / "U"
    along = stream.begins * stream.share(heights)
    write_field(first, first, np.outer(along, [1.0, 0.0, 0.0]))


def _add_patches(path: Path, patches: dict[str, str]) -> None:
    """Append entries to the boundaryField at the end of a field; they override its patterns."""
    head, _, tail = path.read_text(encoding="utf-8").rpartition("}")
    lines = "".join(f"    {name} {{ {text} }}\n" for name, text in patches.items())
    write_text(path, f"{head}{lines}}}{tail}")


def _changing(speed: ndarray) -> ndarray:
    """Which of the values a table by straight lines needs."""
    bent = np.abs(np.diff(speed, 2)) > _SAME * max(float(np.abs(speed).max()), 1e-30)
    return np.concatenate([[True], bent, [True]])


def _table(times: ndarray, speed: ndarray) -> str:
    kept = _changing(speed)
    rows = "".join(
        f"\n        ({t:.10g} ({u:.10g} 0 0))"
        for t, u in zip(times[kept], speed[kept], strict=True)
    )
    return f"type uniformFixedValue; uniformValue table\n    ({rows}\n    );"


def _write_samples(
    folder: Path, middles: ndarray, share: ndarray, times: ndarray, speed: ndarray
) -> None:
    """Write constant/boundaryData: velocities at the faces' middles (face, 3) over time."""
    place = folder / "constant" / "boundaryData" / "upstream"
    every = int(np.ceil(len(times) * len(middles) / _MOST_VALUES))
    kept = np.flatnonzero(_changing(speed))
    kept = np.union1d(kept[::every], kept[[0, -1]])
    write_text(place / "points", _vectors(middles))
    across = np.zeros((len(share), 2))
    for number in kept:
        velocity = np.column_stack([speed[number] * share, across])
        write_text(place / f"{times[number]:.10g}" / "U", _vectors(velocity))


def _vectors(values: ndarray) -> str:
    rows = "".join("({:.10g} {:.10g} {:.10g})\n".format(*row) for row in values.tolist())
    return f"{len(values)}\n(\n{rows})\n"


def face_middles(mesh: PolyMesh, points: ndarray, patch: str) -> ndarray:
    """Middles (face, 3) m of the faces of a patch of quadrilaterals."""
    start, count = next((s, n) for name, s, n in mesh.patches if name == patch)
    corners = mesh.face_points[mesh.face_offset[start] : mesh.face_offset[start + count]]
    return np.asarray(points[corners.reshape(count, 4)].mean(1))


def wall_type(current: Current | None) -> str:
    """OpenFOAM's type of the velocity on the tank's sides."""
    return "slip" if current and current.walls == "slip" else "fixedValue"


def samples_text(patches: Sequence[str]) -> str:
    """Function objects of what passes the tank's ends, and of the friction on its walls.

    They are those that pipeline/openfoam/through_flow.py reads. `patches`: of the mesh.
    """
    walls = [name for name in WALLS if name in patches]

    def of_end(end: str, name: str, fields: str, operation: str) -> str:
        return (
            f'{end}{name}\n{{\n    type surfaceFieldValue; libs ("libfieldFunctionObjects.so");\n'
            f"    regionType patch; name {end}; fields ({fields}); operation {operation};\n"
            f"    writeFields no; {_WRITTEN}\n}}\n"
        )

    parts = [
        # in each step, so that sums over steps are those of the solver
        'speedSquareOfStep\n{\n    type magSqr; libs ("libfieldFunctionObjects.so");\n'
        "    field U; result speedSqr; executeControl timeStep; executeInterval 1;\n"
        "    writeControl none; log no;\n}\n"
    ]
    parts += [
        text
        for end in ENDS
        for text in (
            of_end(end, "Carried", "p speedSqr U", "weightedSum; weightField phi"),
            of_end(end, "Pressure", "p", "areaIntegrate"),
            of_end(end, "Flux", "phi", "sum"),
        )
    ]
    parts += [
        'momentum\n{\n    type volFieldValue; libs ("libfieldFunctionObjects.so");\n'
        f"    fields (U); operation volIntegrate; regionType all; writeFields no; {_WRITTEN}\n}}\n",
        'wallForces\n{\n    type forces; libs ("libforces.so");\n'
        f"    patches ({' '.join(walls)}); rho rhoInf; rhoInf $density; CofR $momentPoint;\n"
        f"    {_WRITTEN}\n}}\n",
    ]
    return "// What the current carries through the tank's ends.\n" + "".join(parts)
