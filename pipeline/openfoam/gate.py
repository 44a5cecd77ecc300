"""A gate that holds the solver at the end of a time step until the next one's motion is written.

OpenFOAM samples a small surface last in every step. A pipe (FIFO) lies in the place of its file,
and opening it blocks until someone reads: without a shell, a compiler or a busy wait, as root or
not. With MPI the first rank is held, and the others wait for it before they move the mesh.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from select import select

from pipeline.openfoam.displacement_files import time_name
from piv.files.atomic import write_text

_PATIENCE = 0.1  # s between two looks whether the solver is alive
_SAMPLER = """
// of a coupled run: pipeline/openfoam/gate.py
gate
{
    type            surfaces;
    libs            ("libsampling.so");
    writeControl    timeStep;
    writeInterval   1;
    surfaceFormat   vtk;
    formatOptions   { vtk { legacy true; format binary; } }
    fields          (p);
    interpolationScheme cell;
    surfaces        ( gate { type patch; patches (top); interpolate false; } );
}
"""


def add_gate(case: Path) -> None:
    """Let the solver of `case` stop at a gate in every step, after all that it records."""
    path = case / "system" / "functions"
    write_text(path, path.read_text(encoding="utf-8") + _SAMPLER)


def _pipe(case: Path, at: float) -> Path:
    return case / "postProcessing" / "gate" / time_name(at) / "gate.vtk"


def clear_gates(case: Path) -> None:
    """Remove the gates that a killed run has left in `case`."""
    shutil.rmtree(case / "postProcessing" / "gate", ignore_errors=True)


def close_gate(case: Path, at: float) -> None:
    """The solver of `case` will stop at the end of the step at `at` s."""
    path = _pipe(case, at)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def open_gate(case: Path, at: float, alive: Callable[[], bool]) -> None:
    """Let the solver of `case` go on that stops, or will stop, at `at` s, while it is `alive`."""
    path = _pipe(case, at)
    pipe = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        while alive():
            ready, *_ = select([pipe], [], [], _PATIENCE)
            if ready and not os.read(pipe, 2**16):  # the solver has written all
                break
    finally:
        os.close(pipe)
        path.unlink()
        path.parent.rmdir()
