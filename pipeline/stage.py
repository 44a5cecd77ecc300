"""What every stage's command line shares: arguments, one-sentence errors, cost record, whole-file writes."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import xarray as xr

from pipeline.costs import NOTHING, record_cost
from pipeline.errors import StageError
from pipeline.scene import Scene, load_scene
from piv import json_file
from piv.errors import sentence
from piv.exclusive import exclusive
from piv.netcdf import open_netcdf, whole_netcdf
from piv.whole_file import write_text as write_text  # the stages take it from here

LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "gmsh", "pyvista", "pydantic")


def parser(stage: str, doc: str | None) -> argparse.ArgumentParser:
    """Arguments that all stages take: the scene's folder and the level."""
    result = argparse.ArgumentParser(prog=f"python -m pipeline.{stage}", description=doc)
    result.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    result.add_argument("--level", default="coarse", help="level of the scene (default: %(default)s)")
    result.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return result


def run_stage(stage: str, doc: str | None, run: Callable[[Scene, bool], Any]) -> None:
    """Entry point of `python -m pipeline.<stage>`; exits 2 with one sentence on a StageError."""
    args = parser(stage, doc).parse_args()
    guarded(stage, lambda: timed(stage, args, run))


def guarded(stage: str, action: Callable[[], Any]) -> None:
    """Run `action`; a foreseeable failure becomes one sentence and exit code 2, an interrupt 130."""
    try:
        action()
    except StageError as error:
        print(f"{stage}: {error}", file=sys.stderr)
        sys.exit(2)
    except Exception as error:
        message = sentence(error) if isinstance(error, OSError | RuntimeError | MemoryError) else None
        if message is None:
            raise
        print(f"{stage}: {message}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"{stage}: interrupted; run make again to go on", file=sys.stderr)
        sys.exit(130)


def timed(stage: str, args: argparse.Namespace, run: Callable[[Scene, bool], Any]) -> None:
    """Load the scene, run the stage, record what it cost."""
    scene = load_scene(args.scene, args.level)
    scene.out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    with exclusive(scene.out / stage):
        earlier = run(scene, args.quiet) or NOTHING  # by runs that this one resumed
    record_cost(scene.out / "costs" / f"{stage}.json", stage, time.monotonic() - begin, earlier)


def versions() -> dict[str, str]:
    """Versions of the libraries that results depend on."""
    return {name: version(name) for name in LIBRARIES}


def read_json(path: Path, remedy: str) -> dict[str, Any]:
    """The JSON object in a file; StageError in one sentence that ends with `remedy` where it holds none."""
    try:
        return json_file.read_json(path, remedy)
    except ValueError as error:
        raise StageError(str(error)) from None


def write_dataset(dataset: xr.Dataset, path: Path, groups: Mapping[str, xr.Dataset] | None = None) -> None:
    """Write an HDF5 file, and its groups, whole or not at all, with the versions that made it."""
    whole_netcdf(dataset.assign_attrs(versions=json.dumps(versions())), path, groups)


def read_dataset(path: Path, file_format: str, group: str | None = None) -> xr.Dataset:
    """Open one of this project's HDF5 files, or a group of it, which then has the file's attributes as well.

    Raises StageError where the file is missing, damaged or another one, or has no such group.
    """
    if not path.exists():
        raise StageError(f"{path}: missing; run the stage that writes it first, or make")
    try:
        dataset = open_netcdf(path, load=True)  # damage shows here, not in the middle of a stage
    except ValueError as error:
        raise StageError(f"{error}; delete it and run make again") from None
    if dataset.attrs.get("format") != file_format:
        raise StageError(f"{path}: format is {dataset.attrs.get('format')!r}, expected {file_format!r}")
    if group is None:
        return dataset
    attributes = dataset.attrs
    dataset.close()
    try:
        dataset = open_netcdf(path, load=True, group=group)
    except ValueError:
        raise StageError(f"{path}: no group {group!r}; delete it and run make again") from None
    return dataset.assign_attrs(attributes | dataset.attrs)
