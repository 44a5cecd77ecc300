"""Versions of libraries and file formats; digests of settings."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from piv.files.errors import StageError
from piv.files.json_text import plain


def digest(value: Any) -> str:
    """Short SHA-256 of a JSON-able value."""
    text = json.dumps(value, sort_keys=True, default=plain)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def versions(*names: str) -> dict[str, str]:
    """Versions of the installed libraries among `names`, cached because a look-up is slow."""
    libraries = {}
    for name in names or ("numpy", "scipy", "xarray", "h5py", "gmsh", "pyvista", "pydantic"):
        with suppress(PackageNotFoundError):
            libraries[name] = version(name)
    return libraries


def check_version(
    attributes: Mapping[str, Any], path: Path | str, name: str, version: int, remedy: str
) -> None:
    """StageError where a file's attributes state another format or format_version."""
    if attributes.get("format") != name:
        raise StageError(f"{path}: format is {attributes.get('format')!r}, not {name!r}; {remedy}")
    file_version = attributes.get("format_version")
    if file_version != version:
        raise StageError(
            f"{path}: format_version of this {name} file is {file_version}, this program reads"
            f" {version}; {remedy}"
        )
