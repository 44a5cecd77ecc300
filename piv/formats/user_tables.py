"""Tables of numbers and text as users, laboratories and spreadsheets save them."""

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piv.files.errors import StageError, one_line, suggestion
from piv.files.regular import read_regular

# 10,000.5 and 10.000,5: separators of thousands, which follow no leading zero, and a decimal sign
_POINT = re.compile(r"[+-]?([1-9]\d{0,2}(,\d{3})+|\d+)?(\.\d*)?(e[+-]?\d+)?", re.IGNORECASE)
_COMMA = re.compile(r"[+-]?([1-9]\d{0,2}(\.\d{3})+|\d+)?(,\d*)?(e[+-]?\d+)?", re.IGNORECASE)
_SPACED = re.compile(r"(?<=\d)['’ \u00a0\u202f](?=\d{3}(\D|$))")  # 10'000, 10 000
# t [ms], t_ms, t/ms, u [m/s]
_UNIT = re.compile(r"([^\W\d_]+)\s*(?:[\[(_/ ]\s*([^\W\d_]+(?:/s)?)\s*[\])]?)?")


@dataclass(frozen=True)
class UserTable:
    """Cells of a table as text; `lines`: the line of each row in the file; `names`: its header."""

    path: Path
    names: list[str]
    rows: list[list[str]]
    lines: list[int]

    def text(self, name: str) -> list[str]:
        """The cells of a column."""
        k = self.names.index(name)
        return [row[k] for row in self.rows]

    def numbers(self, names: Sequence[str] = ()) -> NDArray[np.float64]:
        """Finite numbers (row, column) of some columns, or of all.

        StageError with file, line and column.
        """
        columns = [self.names.index(name) for name in names] or list(range(len(self.names)))
        names = names or self.names
        cells = self.plain([[row[k] for k in columns] for row in self.rows])
        try:
            values = np.array(cells, float)
            if np.isfinite(values).all():
                return values
        except ValueError:
            pass
        for line, row, given in zip(self.lines, cells, self.rows, strict=True):
            for k, name, cell in zip(columns, names, row, strict=True):
                if not _is_finite(cell):
                    raise StageError(
                        f"{self.path}, line {line}, column {name}: {given[k]!r} is not a finite"
                        " number; correct it"
                    )
        raise AssertionError(cells)

    def plain(self, cells: list[list[str]]) -> list[list[str]]:
        """Numbers in cells with a decimal point and no thousands, where they are unambiguous.

        StageError where a comma may be either. Other cells stay as they are.
        """
        found = [cell for row in cells for cell in row if "," in cell]
        if not found:
            return cells
        numbers = [c for row in cells for c in row if _POINT.fullmatch(c) or _COMMA.fullmatch(c)]
        point, comma = (all(map(kind.fullmatch, numbers)) for kind in (_POINT, _COMMA))
        commas = [cell for cell in numbers if "," in cell]
        if commas and point == comma:
            raise StageError(
                f"{self.path}: the comma of {commas[0]!r} may be a decimal comma or separate"
                " thousands; write its numbers with a decimal point, without thousands"
            )
        signs = str.maketrans({",": ""} if point else {".": "", ",": "."})
        known = set(numbers)
        return [[c.translate(signs) if c in known else c for c in row] for row in cells]


def read_table(
    path: Path, contents: str, ragged: bool = False, names: Sequence[str] = ()
) -> UserTable:
    """A table of columns apart by commas, semicolons or tabs; `contents` tells what to give.

    A BOM, quotes, empty lines and comments from # on are accepted; where `ragged`, rows without
    their last cells too. The names of its columns are the cells of its first row where one of them
    is no number, else `names`. StageError with file, line and remedy.
    """
    try:
        content = read_regular(path)
    except FileNotFoundError:
        raise StageError(f"{path}: no such file; give a table of {contents}") from None
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise StageError(f"{path}: is not UTF-8 text ({one_line(error)}); save it so") from None
    lines = [
        (number, line)
        for number, full in enumerate(text.splitlines(), 1)
        if (line := (full if '"' in full.split("#")[0] else full.split("#")[0]).strip(" \r\n"))
        and not re.fullmatch("sep=.", line)  # a spreadsheet's
    ]
    first = lines[0][1] if lines else ""
    sign = next((sign for sign in "\t;" if sign in first), ",")
    rows = []
    for number, line in lines:
        try:
            (cells,) = csv.reader([line], delimiter=sign, skipinitialspace=True, strict=True)
        except (csv.Error, ValueError) as error:
            raise StageError(f"{path}, line {number}: {one_line(error)}; correct it") from None
        rows.append([_SPACED.sub("", cell.strip()).replace("\u2212", "-") for cell in cells])
        if len(cells) > len(rows[0]) or (len(cells) < len(rows[0]) and not ragged):
            raise StageError(
                f"{path}, line {number}: {line[:80]!r} has {len(cells)} cells, the first row"
                f" {len(rows[0])}; a cell with a comma needs quotes, and decimal commas need"
                " semicolons between cells"
            )
        rows[-1] += [""] * (len(rows[0]) - len(cells))
    places = [number for number, _ in lines]
    if not rows or all(_POINT.fullmatch(c) or _COMMA.fullmatch(c) for c in rows[0]):
        return UserTable(path, list(names), rows, places)
    return UserTable(path, rows[0], rows[1:], places[1:])


def read_columns(
    path: Path, needed: Sequence[str], more: Sequence[str] | None = (), ragged: bool = False
) -> UserTable:
    """A table with a header of the columns `needed`, and perhaps `more` (None: any); StageError."""
    table = read_table(path, f"the columns {', '.join(needed)}", ragged)
    known = [*needed, *(more or ())]
    if missing := [name for name in needed if name not in table.names]:
        raise StageError(f"{path}: no column {missing[0]} in its header; give {', '.join(needed)}")
    unknown = [name for name in table.names if name not in known] if more is not None else []
    if unknown:
        raise StageError(
            f"{path}: unknown column {unknown[0]}{suggestion(unknown[0], known)};"
            f" the columns are {', '.join(known)}"
        )
    if twice := next((name for name in table.names if table.names.count(name) > 1), None):
        raise StageError(f"{path}: column {twice!r} occurs twice; remove one")
    if not table.rows:
        raise StageError(f"{path}: no rows below its header; add some")
    return table


# factors of the units that a header may state; the first is that of a column without one
_TIME = {"s": 1.0, "ms": 1e-3}
_KINDS = {
    "pressure": (("t", "time"), _TIME, ("p", "pressure"),
                 {"pa": 1.0, "hpa": 100.0, "kpa": 1e3, "mbar": 100.0, "bar": 1e5}),
    "place": (("t", "time"), _TIME, ("x", "position"), {"m": 1.0, "cm": 0.01, "mm": 1e-3}),
    "speed": (("t", "time"), _TIME, ("u", "speed"), {"m/s": 1.0, "cm/s": 0.01, "mm/s": 1e-3}),
}  # fmt: skip


def read_history(path: Path, kind: str, least: int) -> tuple[NDArray[np.float64], ...]:
    """Increasing times (s) and values (SI) of a table with two columns and `least` rows or more.

    kind: `pressure` (t, p), `place` (t, x) or `speed` (t, u). The header may be absent, or state
    other units, as t [ms]. StageError with file, line, column and remedy.
    """
    times, of_time, values, of_value = _KINDS[kind]
    units = f"{next(iter(of_time))} and {next(iter(of_value)).replace('pa', 'Pa')}"
    contents = f"{times[0]},{values[0]} in {units}"
    table = read_table(path, contents, names=(times[0], values[0]))
    width = len((table.rows or [table.names])[0])
    if width != 2 or len(table.rows) < least:
        raise StageError(
            f"{path}: has {len(table.rows)} rows of {width} numbers; give two columns"
            f" {times[0]},{values[0]} and at least {least} rows below their names"
        )
    factors = [1.0, 1.0]
    for k, name in enumerate(table.names):
        stated = _UNIT.fullmatch(name.lower())
        words, known = ((times, of_time), (values, of_value))[k]
        unit = (stated and stated.group(2)) or next(iter(known))
        if stated is None or stated.group(1) not in words or unit not in known:
            raise StageError(
                f"{path}: its first line is {','.join(table.names)[:80]!r}; name the columns"
                f" {contents}, or with units, as {times[0]} [ms]"
            )
        factors[k] = known[unit]
    numbers = table.numbers() * factors
    later = np.diff(numbers[:, 0]) > 0
    if not later.all():
        raise StageError(
            f"{path}: times must increase; line {table.lines[int(later.argmin()) + 1]} does not"
        )
    return numbers[:, 0], numbers[:, 1]


def _is_finite(cell: str) -> bool:
    try:
        return bool(np.isfinite(np.array(cell, dtype=str).astype(float)))
    except ValueError:
        return False
