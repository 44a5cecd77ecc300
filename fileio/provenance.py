"""What a result was made with: versions of libraries, digests of files and settings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import h5py

from fileio import json_text
from fileio.errors import StageError
from fileio.json_text import AGAIN


def digest(value: Any) -> str:
    """Short SHA-256 of a JSON-able value."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


@cache
def versions(*names: str) -> dict[str, str]:
    """Versions of the libraries `names` that are installed: looking them up takes as long as a Newton step of PIV."""
    libraries = {}
    for name in names or ("numpy", "scipy", "xarray", "h5py", "gmsh", "pyvista", "pydantic"):
        with suppress(PackageNotFoundError):
            libraries[name] = version(name)
    return libraries


def recorded(settings: dict[str, Any]) -> dict[str, str]:
    """Attributes that say with which settings a stage made a file: themselves, and their digest."""
    return {"settings": json.dumps(settings), "settings_digest": digest(settings)}


def check_version(
    attributes: Mapping[str, Any], path: Path | str, name: str, version: int, remedy: str
) -> None:
    """StageError where what a file says of itself is not this `format` and `format_version`."""
    if attributes.get("format") != name:
        raise StageError(f"{path}: format is {attributes.get('format')!r}, not {name!r}; {remedy}")
    file_version = attributes.get("format_version")
    if file_version != version:
        raise StageError(
            f"{path}: format_version of this {name} file is {file_version}, this program reads {version}; {remedy}"
        )


def settings_in(attributes: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The scene's sections that a stage recorded among the attributes of its file `path`; StageError where it has none."""
    if "settings" not in attributes:
        raise StageError(f"{path}: attribute 'settings' is missing; {AGAIN}")
    return json_text.parse_json(attributes["settings"], f"{path}: attribute 'settings'", AGAIN)


def read_settings(path: Path) -> dict[str, Any]:
    """`settings_in` an HDF5 file."""
    with h5py.File(path, "r") as file:
        return settings_in(file.attrs, path)
