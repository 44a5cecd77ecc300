"""Formats declared once, checked at every reading and writing, listed in docs/reference."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from piv.files.atomic import write_text
from piv.files.errors import StageError, one_line
from piv.files.hdf5 import open_netcdf, whole_netcdf
from piv.files.json_text import plain, read_json
from piv.files.provenance import check_version, versions
from piv.files.record import REMEDY, check_whole


@dataclass(frozen=True)
class _Variable:
    """A variable over `dims` ("time, axis"), or an attribute where they are "-".

    A dimension with a question mark ("time?, y, x") may be absent. Where `finite`, NaN and ∞ are
    damage.
    """

    name: str
    dims: str
    units: str
    meaning: str
    optional: bool = False
    finite: bool = True

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of all dimensions."""
        return tuple(self.dims.replace("?", "").split(", "))

    @property
    def least_axes(self) -> tuple[str, ...]:
        """Names of the dimensions that are never absent."""
        return tuple(axis for axis in self.dims.split(", ") if not axis.endswith("?"))

    def fault(self, dataset: xr.Dataset) -> str | None:
        """The first fault of this variable in a dataset; None without one."""
        attribute = self.dims == "-"
        if self.name not in (dataset.attrs if attribute else dataset.variables):
            kind = "attribute" if attribute else "variable"
            return None if self.optional else f"{kind} {self.name!r} is missing"
        if attribute:
            return None
        variable = dataset[self.name]
        if variable.dims not in (self.axes, self.least_axes):
            dims = ", ".join(map(str, variable.dims))
            return f"{self.name!r} is over ({dims}), not ({self.dims})"
        if self.finite and variable.dtype.kind == "f" and not np.isfinite(variable.values).all():
            return f"{self.name!r} holds NaN or infinite values"
        return None


def variables(table: str) -> tuple[_Variable, ...]:
    """Variables from rows of name, dimensions, units ("-": none) and meaning, two spaces apart.

    `?` after a name: optional; `~`: NaN and ∞ are allowed. An indented line continues its row.
    """
    rows = [
        re.split(r" {2,}", row, maxsplit=3)
        for row in re.sub(r"\n +", " ", table.strip()).split("\n")
    ]
    return tuple(
        _Variable(name.rstrip("?~"), dims, units.strip("-"), meaning, "?" in name, "~" not in name)
        for name, dims, units, meaning in rows
    )


@dataclass(frozen=True)
class Schema:
    """An HDF5 format: name, variables of its root and groups, remedy for an unusable file."""

    format: str
    root: tuple[_Variable, ...]
    group: tuple[_Variable, ...] = ()
    remedy: str = REMEDY
    version: int = 1

    @property
    def label(self) -> dict[str, Any]:
        """The attributes that name format and version."""
        return {"format": self.format, "format_version": self.version}

    def check(self, dataset: xr.Dataset, path: Path, group: bool = False) -> None:
        """StageError where format or version differ, or a variable is missing or wrong."""
        check_version(dataset.attrs, path, self.format, self.version, self.remedy)
        for variable in self.group if group else self.root:
            fault = variable.fault(dataset)
            if fault:
                raise StageError(f"{path}: {fault}; {self.remedy}")

    def read(self, path: Path, group: str | None = None) -> xr.Dataset:
        """A file's root, or a group with the root's attributes, loaded and checked.

        StageError where the file is missing, damaged, incomplete or of another format or version.
        """
        if not path.exists():
            raise StageError(f"{path}: missing; {self.remedy}")
        try:
            dataset = open_netcdf(path, load=True)
            self.check(dataset, path)
            dataset.close()
            if group is None:
                return dataset
            part = open_netcdf(path, load=True, group=group)
        except StageError:
            raise
        except ValueError as error:
            raise StageError(f"{error}; {self.remedy}") from None
        part = part.assign_attrs(dataset.attrs | part.attrs)
        self.check(part, path, group=True)
        part.close()
        return part

    def write(
        self,
        path: Path,
        values: Mapping[str, Any],
        groups: Mapping[str, Mapping[str, Any]] | None = None,
        *,
        units: Mapping[str, str] | None = None,
    ) -> None:
        """Write variables and attributes by name, and those of `groups`, whole or not at all.

        `units` of variables by name replace the declared ones.
        """
        root = _dataset(self.root, values, units or {})
        root.attrs = {"versions": json.dumps(versions())} | root.attrs
        root.attrs |= self.label
        self.check(root, path)
        parts = {
            name: _dataset(self.group, part, units or {}) for name, part in (groups or {}).items()
        }
        for part in parts.values():
            self.check(part.assign_attrs(root.attrs | part.attrs), path, group=True)
        whole_netcdf(root, path, parts)


def _dataset(
    declared: tuple[_Variable, ...], values: Mapping[str, Any], units: Mapping[str, str]
) -> xr.Dataset:
    known = {variable.name: variable for variable in declared}
    arrays = {
        name: (v.axes, value, {"units": units.get(name, v.units), "long_name": v.meaning})
        for name, value in values.items()
        if (v := known[name]).dims != "-"
    }
    return xr.Dataset(arrays, attrs={n: v for n, v in values.items() if n not in arrays})


@dataclass(frozen=True)
class JsonFormat:
    """A JSON object that names its format and version; `remedy` for an unusable file."""

    format: str
    remedy: str = REMEDY
    version: int = 1

    def write(self, path: Path, content: Mapping[str, Any]) -> None:
        """Write a file whole or not at all; ValueError for a NaN or infinite number."""
        whole = {"format": self.format, "format_version": self.version, **content}
        try:
            text = json.dumps(whole, indent=1, allow_nan=False, default=plain)
        except ValueError as error:
            raise ValueError(f"{path} cannot hold a result that is no number: {error}") from error
        write_text(path, text + "\n")

    def read(self, path: Path) -> dict[str, Any]:
        """The object; StageError where it is damaged, or of another format or version."""
        content = read_json(path, self.remedy)
        check_version(content, path, self.format, self.version, self.remedy)
        return content


@dataclass(frozen=True)
class Table:
    """A CSV of numbers; `header`: names of columns, ", " between; `remedy` for an unusable file."""

    header: str
    remedy: str = REMEDY
    digits: int = 12

    @property
    def columns(self) -> list[str]:
        """The names of the columns."""
        return self.header.split(", ")

    def write(self, path: Path, rows: Iterable[Iterable[float]]) -> None:
        """Write a file whole or not at all."""
        cells = [self.columns, *([f"{v:.{self.digits}g}" for v in row] for row in rows)]
        write_text(path, "".join(",".join(row) + "\n" for row in cells))

    def read(self, path: Path) -> pd.DataFrame:
        """All columns; StageError where the file is missing or another kind."""
        if not path.exists():
            raise StageError(f"{path}: missing; {self.remedy}")
        check_whole(path)
        try:
            table = pd.read_csv(path)
        except ValueError as error:  # an empty file among them
            raise StageError(
                f"{path}: not a readable table ({one_line(error)}); {self.remedy}"
            ) from None
        missing = [name for name in self.columns if name not in table]
        if missing:
            raise StageError(f"{path}: column {missing[0]!r} is missing; {self.remedy}")
        return table
