"""What a result was made with: versions of libraries, digests of files and settings."""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import xarray as xr

from fileio import json_text
from fileio.json_text import AGAIN


def digest(value: Any) -> str:
    """Short SHA-256 of a JSON-able value."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "gmsh", "pyvista", "pydantic")


def versions() -> dict[str, str]:
    """Versions of the libraries that results depend on."""
    return {name: version(name) for name in LIBRARIES}


def settings_in(file: h5py.File | xr.Dataset, path: Path) -> dict[str, Any]:
    """The scene's sections that a stage recorded in its file `path`; ValueError where it has none."""
    if "settings" not in file.attrs:
        raise ValueError(f"{path}: attribute 'settings' is missing; {AGAIN}")
    return json_text.parse_json(file.attrs["settings"], f"{path}: attribute 'settings'", AGAIN)


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
