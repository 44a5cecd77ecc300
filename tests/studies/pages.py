"""What benchmarks write into the docs: a text between two marks, and the machine that they ran on."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

PIV = Path(__file__).resolve().parents[2] / "docs" / "piv_benchmarks.md"


def write_between(page: Path, mark: str, text: str) -> None:
    """Put a text between the comments `<!-- mark -->` and `<!-- end of mark -->` of a page."""
    head, rest = page.read_text(encoding="utf-8").split(f"<!-- {mark} -->\n")
    _, tail = rest.split(f"<!-- end of {mark} -->")
    page.write_text(
        f"{head}<!-- {mark} -->\n{text}\n<!-- end of {mark} -->{tail}", encoding="utf-8"
    )


def between(page: Path, mark: str) -> str:
    """The text between the two comments of `write_between`."""
    _, rest = page.read_text(encoding="utf-8").split(f"<!-- {mark} -->\n")
    return rest.split(f"<!-- end of {mark} -->")[0]


def machine() -> str:
    """Processor, system, versions and date."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    return f"{cpu} ({os.cpu_count()} cores), {platform.system()}, Python {platform.python_version()}, {libraries()}"


def libraries() -> str:
    """Versions that results depend on, and the date."""
    names = ("numpy", "scipy", "numba", "opencv-python-headless")
    return ", ".join(f"{n} {version(n)}" for n in names) + f"; {time.strftime('%Y-%m-%d')}"
