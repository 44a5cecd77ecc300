"""Command `view`: a run as a time series for ParaView, with a script for a first picture."""

import json
from pathlib import Path

from tqdm import tqdm

from pipeline.paraview.fields import RunFields
from pipeline.paraview.grids import mirror_planes, with_mirror_image
from pipeline.scene.predicted import view_size
from pipeline.scene.scene import Scene
from piv.files.atomic import whole, write_bytes, write_text
from piv.files.errors import StageError
from piv.files.lock import exclusive

_PARTS = ("water", "walls")
_SCRIPT = Path(__file__).with_name("first_picture.py")


def write_series(scene: Scene, target: Path, planes: tuple[int, ...], quiet: bool) -> int:
    """Write the missing files of a series to `target`; returns the number of instants."""
    fields = RunFields(scene)
    shown = fields.instants
    if not shown:
        raise StageError(
            f"{scene.out}: no run has written its fields there yet; make {scene.folder.name}.view"
            f" LEVEL={scene.level} runs it first"
        )
    files = {
        instant: [target / f"{part}_{k:05d}.vtu" for part in _PARTS]
        for k, instant in enumerate(shown)
    }
    for instant, paths in tqdm(files.items(), desc="view", disable=quiet or None):
        made = instant.file.stat().st_mtime
        if all(path.exists() and path.stat().st_mtime >= made for path in paths):
            continue
        for path, grid in zip(paths, fields.grids(instant.time), strict=True):
            for plane in planes:
                grid = with_mirror_image(grid, plane)
            with whole(path, suffix=True, sync=False) as unfinished:
                grid.save(unfinished)
    for part, names in zip(_PARTS, zip(*files.values(), strict=True), strict=True):
        for stale in set(target.glob(f"{part}_*.vtu")) - set(names):
            stale.unlink()
        sets = "".join(
            f'<DataSet timestep="{time!r}" file="{path.name}"/>\n'
            for (time, *_), path in zip(shown, names, strict=True)
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
    planes = mirror_planes(scene) if whole else ()
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
