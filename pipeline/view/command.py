"""A run as a time series that opens in ParaView: water.pvd and walls.pvd, with a script for a first picture.

Command: softfinger view cases/single_finger --level coarse (make single_finger.view)
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from tqdm import tqdm

from fileio.atomic import whole, write_bytes, write_text
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_intervals, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from fileio.lock import exclusive
from pipeline.openfoam.polymesh_files import read_faces
from pipeline.openfoam.ranks import Ranks
from pipeline.run.checkpoint import saved_times
from pipeline.run.map_fields import read_cells
from pipeline.run.prepare import prepared_for
from pipeline.scene.scene import Scene
from pipeline.view.grids import X, Z, topology, walls, water, with_mirror_image

PARTS = ("water", "walls")
SCRIPT = Path(__file__).with_name("first_picture.py")

Instant = tuple[Interval, Ranks, float, str]  # with the name of the folder of its fields


def instants(out: Path) -> list[Instant]:
    """Those of which a run has written all fields so far, ascending; an overlap belongs to the interval before."""
    written: list[Instant] = []
    for interval in read_intervals(out):
        case = out / "case" / interval.name
        state = prepared_for(case)
        ranks = Ranks(state.get("ranks", 1), bool(state.get("collated", False)))
        shared = [dict(saved_times(folder, ranks, ("U", "p"))) for folder in ranks.folders(case)]
        written += [
            (interval, ranks, time, name)
            for time, name in sorted(shared[0].items())
            if time > interval.start + 1e-9 and all(time in times for times in shared)
        ]
    return written


def grids(
    out: Path, members: list[Instant], density: float
) -> Iterator[tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]]:
    """Water and walls at each instant of one mesh interval."""
    if not members:
        return
    interval = members[0][0]
    case = out / "case" / interval.name
    planform, sweep = read_planform(out, interval.mesh), read_sweep(out, interval.name)
    motion, mesh = (
        read_motion(out, interval.mesh),
        topology(planform, sweep, read_faces(case / "constant" / "polyMesh")),
    )
    z = planform["levels"].values[sweep["level"].values]
    for _, ranks, time, name in members:
        points = np.column_stack([motion.nodes(time)[sweep["node"].values], z])
        velocity, pressure = (
            read_cells(case, name, field, ranks, len(mesh.types)) for field in ("U", "p")
        )
        yield (
            water(mesh, points, velocity, density * pressure),
            walls(mesh, points, density * pressure),
        )


def up_to_date(paths: list[Path], source: Path) -> bool:
    """Whether all are there and no older than the fields that they show."""
    made = source.stat().st_mtime
    return all(path.exists() and path.stat().st_mtime >= made for path in paths)


def collection(times: list[float], names: list[str]) -> str:
    """A ParaView collection: a file for each time (s)."""
    sets = "".join(
        f'<DataSet timestep="{t!r}" file="{n}"/>\n' for t, n in zip(times, names, strict=True)
    )
    return f'<VTKFile type="Collection" version="0.1">\n<Collection>\n{sets}</Collection>\n</VTKFile>\n'


def picture_settings(scene: Scene) -> dict[str, Any]:
    """What the first picture shows: the camera's view (m) of the sheet."""
    camera = scene.camera
    return {
        "centre": list(camera.centre),
        "height": camera.rows * camera.scale_mm_per_px * 1e-3,
        "width": camera.columns * camera.scale_mm_per_px * 1e-3,
        "sheet": scene.sheet.z,
    }


def write_series(scene: Scene, target: Path, planes: tuple[int, ...], quiet: bool) -> int:
    """Write the files of a series to `target`, those that are not there yet; returns the number of instants."""
    out = scene.out
    shown = instants(out) if (out / "planform.h5").exists() and (out / "case").exists() else []
    if not shown:
        raise StageError(
            f"{out}: no run has written its fields there yet; make {scene.folder.name}.view LEVEL={scene.level} runs it first"
        )
    files = {
        instant: [target / f"{part}_{k:05d}.vtu" for part in PARTS]
        for k, instant in enumerate(shown)
    }
    with tqdm(total=len(shown), desc="view", disable=quiet or None) as bar:
        for interval, members in groupby(shown, lambda instant: instant[0]):
            case = out / "case" / interval.name
            wanted = []
            for instant in members:
                _, ranks, _, name = instant
                if up_to_date(files[instant], ranks.folders(case)[-1] / name / "U"):
                    bar.update()
                else:
                    wanted.append(instant)
            for instant, pair in zip(wanted, grids(out, wanted, scene.fluid.density), strict=True):
                for path, grid in zip(files[instant], pair, strict=True):
                    for plane in planes:
                        grid = with_mirror_image(grid, plane)
                    with whole(path, suffix=True, sync=False) as unfinished:
                        grid.save(unfinished)
                bar.update()
    for part, names in zip(PARTS, zip(*files.values(), strict=True), strict=True):
        for stale in set(target.glob(f"{part}_*.vtu")) - set(names):
            stale.unlink()
        write_text(
            target / f"{part}.pvd", collection([t for _, _, t, _ in shown], [n.name for n in names])
        )
    return len(shown)


def view(scene: Scene, whole: bool = False, quiet: bool = False) -> None:
    """Write the series of a run; `whole`: mirrored at the planes of symmetry, the whole tank."""
    target = scene.out / ("view_whole" if whole else "view")
    planes: tuple[int, ...] = ()
    if whole and scene.model.kind in ("half", "quarter"):
        planes += (Z,)
    if whole and scene.pinch is not None and scene.model.kind in ("quarter", "2d"):
        planes += (X,)
    with exclusive(target):
        count = write_series(scene, target, planes, quiet)
        write_text(target / "picture.json", json.dumps(picture_settings(scene)) + "\n")
        write_bytes(target / "picture.py", SCRIPT.read_bytes())
    if not quiet:
        print(
            f"view: {count} instants; open {target / 'water.pvd'}, or start paraview --script={target / 'picture.py'}"
        )
