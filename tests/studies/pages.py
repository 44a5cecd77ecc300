"""Texts and tables that studies write into the docs, and the machine that they ran on."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import time
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fileio.atomic import write_text

PIV = Path(__file__).resolve().parents[2] / "docs" / "piv_benchmarks.md"


def _parts(page: Path, mark: str) -> tuple[str, str, str]:
    """Text before, between and after the comments `<!-- mark -->` and `<!-- end of mark -->`."""
    head, rest = page.read_text(encoding="utf-8").split(f"<!-- {mark} -->\n")
    text, tail = rest.split(f"<!-- end of {mark} -->")
    return head, text, tail


def write_between(page: Path, mark: str, text: str) -> None:
    """Replace the text between the two comments of a page."""
    head, _, tail = _parts(page, mark)
    page.write_text(
        f"{head}<!-- {mark} -->\n{text}\n<!-- end of {mark} -->{tail}", encoding="utf-8"
    )


def between(page: Path, mark: str) -> str:
    """The text between the two comments of `write_between`."""
    return _parts(page, mark)[1]


def write_table(
    path: Path, columns: Iterable[str], rows: Iterable[dict[str, Any]], made: Any = None
) -> None:
    """Write a CSV; keys that are no column are left out. `made`: JSON of a first `#` line."""
    text = io.StringIO()
    if made is not None:
        text.write(f"# {json.dumps(made)}\n")
    writer = csv.DictWriter(text, list(columns), "", "ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def machine() -> str:
    """Processor, system, versions and date."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    system = f"{platform.system()}, Python {platform.python_version()}"
    return f"{cpu} ({os.cpu_count()} cores), {system}, {libraries()}"


def libraries() -> str:
    """Versions that results depend on, and the date."""
    names = ("numpy", "scipy", "numba", "opencv-python-headless")
    return ", ".join(f"{n} {version(n)}" for n in names) + f"; {time.strftime('%Y-%m-%d')}"
