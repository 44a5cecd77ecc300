"""Command `view`: a run as a time series for ParaView, with a script for a first picture."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fileio.atomic import whole, write_bytes, write_text
from fileio.errors import StageError
from fileio.formats.kinematics import read_kinematics
from fileio.formats.mesh_intervals import (
    Interval,
    NodeMotion,
    read_intervals,
    read_planform,
    read_sweep,
)
from fileio.lock import exclusive
from pipeline.openfoam.polymesh_files import read_faces
from pipeline.openfoam.ranks import Ranks
from pipeline.run.checkpoint import prepared_ranks, saved_field, saved_times
from pipeline.scene.predicted import view_size
from pipeline.scene.scene import Scene
from pipeline.view.grids import X, Z, topology, walls, water, with_mirror_image

_PARTS = ("water", "walls")
_SCRIPT = Path(__file__).with_name("first_picture.py")

_Instant = tuple[Interval, Ranks, float, str]  # with the name of the folder of its fields


def _instants(out: Path) -> list[_Instant]:
    """Instants of a run with all fields, ascending; an overlap belongs to the earlier interval."""
    written: list[_Instant] = []
    for interval in read_intervals(out):
        case = out / "case" / interval.name
        ranks = prepared_ranks(case)
        written += [
            (interval, ranks, time, name)
            for time, name in saved_times(case, ranks, ("U", "p"))
            if time > interval.start + 1e-9
        ]
    return written


def write_series(scene: Scene, target: Path, planes: tuple[int, ...], quiet: bool) -> int:
    """Write the missing files of a series to `target`; returns the number of instants."""
    out = scene.out
    shown = _instants(out) if (out / "planform.h5").exists() and (out / "case").exists() else []
    if not shown:
        raise StageError(
            f"{out}: no run has written its fields there yet; make {scene.folder.name}.view"
            f" LEVEL={scene.level} runs it first"
        )
    law = read_kinematics(out / "kinematics.h5").law
    files = {
        instant: [target / f"{part}_{k:05d}.vtu" for part in _PARTS]
        for k, instant in enumerate(shown)
    }
    with tqdm(total=len(shown), desc="view", disable=quiet or None) as bar:
        for interval, members in groupby(shown, lambda instant: instant[0]):
            case = out / "case" / interval.name
            wanted = []
            for instant in members:
                _, ranks, _, name = instant
                made = (ranks.folders(case)[-1] / name / "U").stat().st_mtime
                if all(p.exists() and p.stat().st_mtime >= made for p in files[instant]):
                    bar.update()
                else:
                    wanted.append(instant)
            if not wanted:
                continue
            planform, sweep = read_planform(out, interval.mesh), read_sweep(out, interval.name)
            motion = NodeMotion.of(law, planform)
            mesh = topology(planform, sweep, read_faces(case / "constant" / "polyMesh"))
            z = planform["levels"].values[sweep["level"].values]
            for instant in wanted:
                _, ranks, time, name = instant
                points = np.column_stack([motion.nodes(time)[sweep["node"].values], z])
                velocity, pressure = (
                    saved_field(case, f"{name}/{field}", ranks, len(mesh.types))
                    for field in ("U", "p")
                )
                pressure = scene.fluid.density * pressure
                pair = water(mesh, points, velocity, pressure), walls(mesh, points, pressure)
                for path, grid in zip(files[instant], pair, strict=True):
                    for plane in planes:
                        grid = with_mirror_image(grid, plane)
                    with whole(path, suffix=True, sync=False) as unfinished:
                        grid.save(unfinished)
                bar.update()
    for part, names in zip(_PARTS, zip(*files.values(), strict=True), strict=True):
        for stale in set(target.glob(f"{part}_*.vtu")) - set(names):
            stale.unlink()
        sets = "".join(
            f'<DataSet timestep="{time!r}" file="{path.name}"/>\n'
            for (_, _, time, _), path in zip(shown, names, strict=True)
        )
        write_text(
            target / f"{part}.pvd",
            '<VTKFile type="Collection" version="0.1">\n<Collection>\n'
            f"{sets}</Collection>\n</VTKFile>\n",
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
        width, height = view_size(scene.camera)
        assert scene.camera.centre is not None
        view = {"centre": list(scene.camera.centre), "height": height, "width": width}
        write_text(target / "picture.json", json.dumps(view | {"sheet": scene.sheet.z}) + "\n")
        write_bytes(target / "picture.py", _SCRIPT.read_bytes())
    if not quiet:
        print(
            f"view: {count} instants; open {target / 'water.pvd'}, or start paraview"
            f" --script={target / 'picture.py'}"
        )
