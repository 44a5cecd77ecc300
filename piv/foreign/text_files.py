"""Text files of vectors: OpenPIV, PIVlab, DaVis, and Tecplot as of MicroVec and TSI Insight.

The head of a file tells its program. Numbers are separated by blanks, tabs, semicolons or commas; a
comma is decimal where another of them separates, without a comma beside it.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from piv.foreign.vectors import Vectors, on_grid, spelled

_ROW = re.compile(r"\s*[-+]?(\d|[.,]\d|nan\b)", re.IGNORECASE)
_VARIABLES = re.compile(
    r"variables\s*=\s*(.*?)(?=\s*(?:\bzone\b|datasetauxdata|\n\s*[-+\d.]))", re.I | re.DOTALL
)
_COLUMNS = {"x": ("x",), "y": ("y",), "u": ("u", "vx"), "v": ("v", "vy")}
_MEASURED = ("chc", "isvalid", "valid")  # columns that are above 0 where a vector is measured


def read_text(path: Path) -> Iterator[Vectors]:
    """Every instant of a text file; ValueError where it holds no table of x, y, u and v."""
    text = path.read_text(encoding="utf-8", errors="replace")
    if names := _VARIABLES.search(text):
        yield from _tecplot(path, text, names)
        return
    lines = text.splitlines()
    start = next((k for k, line in enumerate(lines) if _ROW.match(line)), None)
    if start is None:
        raise ValueError(f"{path}: no rows of numbers")
    rows = _numbers(path, lines[start:])
    if text.startswith("#DaVis"):
        yield _davis(path, rows, re.findall(r'"([^"]*)"', lines[0])[1::2])
        return
    titles = _titles(lines[start - 1]) if start else []
    if len(titles) != rows.shape[1] or not {"x", "y"} <= set(map(_short, titles)):
        titles = ["x", "y", "u", "v", *["?"] * (rows.shape[1] - 4)]
    yield _named(path, rows, titles)


def _numbers(path: Path, lines: list[str]) -> ndarray:
    """Rows of numbers (row, column), at least four columns."""
    sample = "\n".join(line.strip() for line in lines[:1000])
    decimal = re.search(r"[^,\s][\t; ]+[^,\s]", sample) and not re.search(r",\s", sample)
    comma = "." if decimal else " "
    table = str.maketrans({",": comma, ";": " "})
    try:
        rows = np.loadtxt([ln.translate(table) for ln in lines if _ROW.match(ln)], ndmin=2)
    except ValueError:
        raise ValueError(
            f"{path}: lines differ in their number of columns, or hold other than numbers"
        ) from None
    if rows.size == 0 or rows.shape[1] < 4:
        raise ValueError(f"{path}: expected at least the four columns x, y, u, v")
    return rows


def _titles(line: str) -> list[str]:
    """Titles of columns, such as `x [mm]`, from the line above the numbers."""
    line = line.strip().lstrip("# ")
    parts = [part.strip(' "') for part in re.split(r"[,;\t]", line)]
    # apart by blanks, as units in brackets are
    return parts if len(parts) >= 4 else re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", line)


def _short(title: str) -> str:
    """Last word of a title before its unit, lower case: u of `Velocity u [m/s]` and of `U m/s`."""
    before = re.split(r"[(\[]|\s(?=\S*(?:/|m$|pixel$|px$))", title.strip().lower())[0]
    return before.split()[-1] if before.split() else ""


def _unit(title: str) -> str | None:
    """Unit in brackets, or in TSI's way behind a blank: `X mm`."""
    match = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]", title) or re.fullmatch(r"\w+ (\S+)", title)
    return spelled(match.group(1)) if match else None


def _named(path: Path, rows: ndarray, titles: list[str]) -> Vectors:
    """Vectors of columns with titles; without them OpenPIV's: x, y, u, v, flag, mask.

    A fifth column without a title that holds more than 0 and 1 is the signal-to-noise ratio.
    """
    short = [_short(title) for title in titles]
    column = {}
    for key, names in _COLUMNS.items():
        found = [short.index(name) for name in names if name in short]
        if not found:
            known = " ".join(", ".join(titles).split())[:200]
            raise ValueError(f"{path}: no column {' or '.join(names)} among {known}; name it so")
        column[key] = found[0]
    flag = np.zeros(len(rows), np.uint8)
    of_pivlab = "type" in short
    for name, values in zip(short, rows.T, strict=True):
        if name in _MEASURED:
            flag[values <= 0] = 1
        elif name == "type":  # of PIVlab: 0 masked, 1 measured, 2 interpolated
            flag = np.select([values == 1, values == 0], [0, 2], 1)
        elif name == "flags":
            flag[values != 0] = 1
        elif name == "mask":
            flag[values != 0] = 2
    for k, name in enumerate(short[4:6]):
        if name == "?" and (k == 1 or np.isin(rows[:, 4], (0, 1)).all()):
            flag[rows[:, 4 + k] != 0] = 1 + k
    grid = on_grid(path, [rows[:, column[key]] for key in "xyuv"], flag)
    length, velocity = _unit(titles[column["x"]]), _unit(titles[column["u"]])
    return Vectors(*grid, length, velocity, "down" if of_pivlab and length == "px" else None)


def _davis(path: Path, rows: ndarray, units: list[str]) -> Vectors:
    """DaVis lists its rows from the top of the picture: y points up where it falls along them.

    It writes (0, 0) where it has no vector.
    """
    if len(units) < 3:
        raise ValueError(f"{path}: its first line names no units of position and velocity")
    up = rows[-1, 1] < rows[0, 1]
    grid = on_grid(path, rows[:, :4].T, np.where((rows[:, 2:4] == 0).all(axis=1), 2, 0))
    velocity = "px/frame" if spelled(units[2]) == "px" else spelled(units[2])
    return Vectors(*grid, spelled(units[0]), velocity, "up" if up else "down")


def _tecplot(path: Path, text: str, names: re.Match[str]) -> Iterator[Vectors]:
    """Zones of Tecplot, POINT packing: each is an instant; its SOLUTIONTIME is taken as s.

    TSI Insight states units, clock, picture and origin in the head; its y points up.
    """
    titles = [a or b for a, b in re.findall(r'"([^"]*)"|([^\s,"]+)', names.group(1))]
    if re.search(r"(datapacking|\bf)\s*=\s*block", text, re.IGNORECASE):
        raise ValueError(f"{path}: BLOCK packing; write the file with POINT packing")
    told = dict(re.findall(r'DATASETAUXDATA\s+(\w+)="([^"]*)"', text[:8192], re.IGNORECASE))
    zones = re.split(r"\bzone\b", text[names.end() :], flags=re.IGNORECASE)
    for zone in zones[1:] or zones:
        rows = _numbers(path, [line for line in zone.splitlines() if _ROW.match(line)])
        if rows.shape[1] != len(titles):
            raise ValueError(f"{path}: {len(titles)} variables but {rows.shape[1]} columns")
        time = re.search(r"solutiontime\s*=\s*([-+.\deE]+)", zone, re.IGNORECASE)
        found = _named(path, rows, titles)
        if told.get("Application") == "PIV":
            found = _of_insight(found, told)
        yield replace(found, time=float(time.group(1)) if time else None)


def _of_insight(found: Vectors, told: dict[str, str]) -> Vectors:
    """Vectors with what the head of a TSI file states; px counted from the lower left corner."""
    known = {name: float(v) for name, v in told.items() if re.fullmatch(r"[-+.\deE]*\d", v)}
    rows, scale = known.get("SourceImageHeight"), known.get("MicrometersPerPixelX")
    interval = known.get("MicrosecondsPerDeltaT")
    if found.length_unit == "px" and rows is not None:
        left, row = known.get("OriginInImageX", 0.0), known.get("OriginInImageY", rows - 1)
        found = replace(found, x=found.x + left, y=found.y + (rows - 1 - row))
    return replace(
        found, y_axis="up",
        velocity_unit="px/frame" if found.velocity_unit == "px" else found.velocity_unit,
        scale_mm_per_px=None if not scale else scale * 1e-3,
        interval=None if not interval else interval * 1e-6,
    )  # fmt: skip
