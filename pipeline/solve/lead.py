"""The current before the motion begins: the stream past the resting body, solved once.

It starts as the undisturbed stream. What it has become is what the run begins with.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from tqdm import tqdm

from pipeline.case.interval_case import write_numbers
from pipeline.openfoam.displacement_files import Steps, time_name
from pipeline.openfoam.foamfile import END, write_bytes, write_field
from pipeline.scene.current import LEAD, lead_steps
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import saved_field
from pipeline.solve.guards import Guard
from pipeline.solve.interval import KnownMotion, SolverInterval
from pipeline.solve.prepare import prepare

_FIELDS = ("U", "p")
T = TypeVar("T")


def solve_lead(
    scene: Scene,
    first: SolverInterval,
    solve: Callable[[SolverInterval, KnownMotion, tqdm], T],
    quiet: bool,
) -> list[T]:
    """Give the first interval its first fields, by `solve`; what that returned, if it was needed.

    It is not where the water rests at 0 s, or where the fields are there.
    """
    steps = lead_steps(scene)
    folder = first.case.folder
    if not steps or all((folder / "0" / name).exists() for name in _FIELDS):
        return []
    step = scene.numerics.time_step
    interval = replace(first.span, end=steps * step, moving=False)
    part = SolverInterval(
        replace(first.case, folder=folder.parent / LEAD),
        replace(first.mesh, interval=interval),
        Steps.of(interval.begin, interval.end, step),
        Guard(scene.numerics.max_courant),  # its samples, and with them its energy, are not kept
    )
    write_numbers(scene, [interval], interval, first.mesh.planform, LEAD)
    motion = KnownMotion(part)
    prepare([part], 0, motion, quiet)
    with tqdm(total=interval.end, unit="s", disable=quiet or None, desc="current") as bar:
        progress = solve(part, motion, bar)
    end, cells = time_name(interval.end), part.mesh.cells
    for path in (folder / "0.orig").iterdir():
        if path.name not in _FIELDS:
            write_bytes(folder / "0" / path.name, path.read_bytes() + END)
    for name in _FIELDS:  # last: they tell that all are there
        values = saved_field(part.case, f"{end}/{name}", cells)
        write_field(folder / "0" / name, folder / "0.orig" / name, values)
    return [progress]
