"""A small scene whose every stage takes seconds, and the differences of two of its runs."""

import json
from pathlib import Path

import h5py
import numpy as np

from docs.evidence.small_scene import write_scene
from pipeline.runs.run import Run, open_run, targets
from piv.files.record import read_record

SMALL = """
title = "Small"
[motion]
strokes = [{{ pressure_kpa = {pressure}, start = 0.002, duration = 0.05 }}]
end_time = 0.06
[sheet]
spacing = 2e-3
[camera]
columns = 320
rows = 256
scale_mm_per_px = 0.25
centre = [0.016, 0.185]
truth = true
[piv]
every = 2
preset = "fast"
[levels.other]
extends = "tiny"
fluid = {{ density = 1000.0 }}
mesh = {{ near_cell = 4.5e-3 }}
motion = {{ max_bend_step_deg = 4.0 }}
sheet = {{ spacing = 2.1e-3 }}
camera = {{ density_ppp = 0.03 }}
piv = {{ window = 48 }}
structure = {{ loss_factor = 0.1 }}
vortices = {{ scale = 4e-3 }}
"""
SPENT = ("wall_time", "resumed")  # numbers of a run that a resumed one does not repeat


def small_run(
    folder: Path, level: str = "tiny", pressure: float = 12.0, coupled: bool = False
) -> Run:
    """The run of a stroke of 60 ms in 2-D; without results where the folder is new."""
    if not folder.exists():
        write_scene(folder, more=SMALL.format(pressure=pressure))
    if coupled:
        return open_run(folder, level, {"motion.source": "structure"}, folder / "out" / "coupled")
    return open_run(folder, level)


def files_of(out: Path, target: str) -> list[str]:
    """Names of the files of a target; the flow shows whether the case is right."""
    records = [read_record(out, stage) for stage in targets(target)]
    names = [name for record in records if record for name in record["outputs"]]
    return [name for name in names if name.split("/")[0] != "case"]


def difference(wanted: Path, out: Path, chosen: list[str]) -> str:
    """The first difference in the files of some targets; empty where there is none."""
    names = [name for target in chosen for name in files_of(wanted, target)]
    return next((d for name in names if (d := _of_file(wanted / name, out / name))), "")


def _of_file(one: Path, other: Path) -> str:
    name = one.name
    if not other.exists():
        return f"{name} is missing"
    if name in ("report.html", "comparison.json"):  # hold their date and the files' checksums
        return "" if other.stat().st_size > 0.99 * one.stat().st_size else f"{name} is shorter"
    if one.suffix == ".h5" or name in ("run.json", "history.csv"):
        a, b = (_values(path) for path in (one, other))
        differ = [key for key in sorted(a.keys() | b.keys()) if a.get(key) != b.get(key)]
        return f"{name}: {', '.join(differ)} differs" if differ else ""
    return "" if one.read_bytes() == other.read_bytes() else f"{name} differs"


def _values(path: Path) -> dict:
    """The values of a file by name, without what a resumed run does not repeat."""
    if path.suffix == ".json":
        values = json.loads(path.read_text())
    elif path.suffix == ".csv":
        table = np.genfromtxt(path, delimiter=",", names=True)
        values = {name: table[name].tobytes() for name in table.dtype.names}
    else:
        names: list[str] = []
        with h5py.File(path) as file:
            file.visit(names.append)
            values = {n: _bytes(file[n]) for n in names if isinstance(file[n], h5py.Dataset)}
    return {key: value for key, value in values.items() if key not in SPENT}


def _bytes(item: h5py.Dataset) -> tuple:
    values = item[...]
    content = values.tolist() if values.dtype == object else values.tobytes()
    return values.shape, str(values.dtype), content
