"""Texts and tables that studies write into the docs, and the machine that they ran on."""

import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from docs.evidence.small_scene import ROOT
from piv.files.atomic import write_text
from postprocess.tables import write_table

PIV = ROOT / "docs" / "piv_benchmarks"


def write_study(name: str, tables: list[pd.DataFrame], *notes: str) -> None:
    """Print the tables and notes of a study, and write them as `<name>_<k>.csv`, `<name>.txt`."""
    for k, table in enumerate(tables, 1):
        print(table.to_string(index=False), end="\n\n")
        write_table(PIV / f"{name}_{k}.csv", table)
    print(*notes, sep="\n", flush=True)
    write_text(PIV / f"{name}.txt", "\n".join(notes) + "\n")


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
