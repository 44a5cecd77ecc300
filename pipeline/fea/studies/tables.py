"""Tables of the studies: CSV for tests and other programs, Markdown for the reader."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fileio.atomic import write_text
from fileio.formats.bending_states import BendingStates
from pipeline.fea.paper_equations import bend as paper_bend

FloatArray = NDArray[np.float64]
SHOWN_KPA = (-40, -30, -20, -10, 10, 20, 30, 40)


@dataclass(frozen=True)
class Bends:
    """Pressure (Pa), radius (m) and wall gap (m) of the states that converged."""

    pressure: FloatArray
    radius: FloatArray
    wall_gap: FloatArray


def provenance() -> str:
    """Versions of what solved."""
    return f"FElupe {version('felupe')}, NumPy {version('numpy')}, SciPy {version('scipy')}, Python {platform.python_version()}"


def write_table(path: Path, bends: dict[str, Bends], last: str = "wall_gap_mm") -> None:
    """CSV: case, pressure_kpa, radius_mm and the third column, one row per state."""
    rows = [f"# {provenance()}", f"case,pressure_kpa,radius_mm,{last}"]
    for name, b in bends.items():
        rows += [
            f"{name},{p / 1e3:g},{r * 1e3:.3f},{g * 1e3:.4f}"
            for p, r, g in zip(b.pressure, b.radius, b.wall_gap, strict=True)
        ]
    write_text(path, "\n".join(rows) + "\n")


def read_table(path: Path) -> dict[str, Bends]:
    """The same back, in SI."""
    table = pd.read_csv(path, comment="#")
    return {
        str(name): Bends(*(rows.iloc[:, 1:].to_numpy(float) * [1e3, 1e-3, 1e-3]).T)
        for name, rows in table.groupby("case", sort=False)
    }


def at(bends: Bends, pressure_kpa: float) -> float:
    """Radius (mm) at one of the pressures solved; not a number where that one did not converge."""
    at = np.flatnonzero(np.abs(bends.pressure - 1e3 * pressure_kpa) < 1e-6)
    return float(bends.radius[at[0]] * 1e3) if len(at) else float("nan")


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.1f}"


def write_results(
    path: Path, bends: dict[str, Bends], states: BendingStates, calculix: Path
) -> None:
    """results.md: R over pressure of every case, equations (1)–(6), uncertainty by source, comparison in 3-D."""
    default = Bends(states.pressure, states.radius, states.radius)
    paper = dict(zip(SHOWN_KPA, paper_bend(1e3 * np.array(SHOWN_KPA))[1] * 1e3, strict=True))
    head = ["R (mm) at kPa", *(str(p) for p in SHOWN_KPA)]
    rows = [["default", *(_number(at(default, p)) for p in SHOWN_KPA)]]
    rows += [["equations (1)–(6)", *(_number(float(paper[p])) for p in SHOWN_KPA)]]
    rows += [[name, *(_number(at(b, p)) for p in SHOWN_KPA)] for name, b in bends.items()]
    text = [
        "# Results of the bending studies",
        "",
        "Written by `make fea-studies`; –: not converged.",
        "",
    ]
    text += [provenance() + ".", "", _markdown(head, rows)]
    note = states.about.get("uncertainty")
    if isinstance(note, dict):
        text += ["## Standard uncertainty of the default's R, in per cent, by source", ""]
        pressures = np.array(note["pressures_kpa"])
        curvature = np.interp(pressures * 1e3, states.pressure, 1 / states.radius)
        lines = {name: np.array(v) for name, v in note["curvature_std"].items()}
        lines["together"] = np.sqrt(np.sum([v**2 for v in lines.values()], axis=0))
        percent = [
            [n, *(f"{q:.1f}" for q in 100 * v / np.abs(curvature))] for n, v in lines.items()
        ]
        text += [_markdown(["kPa", *(f"{p:g}" for p in pressures)], percent)]
    if calculix.exists():
        text += ["## Against the whole finger in 3-D", ""]
        compared = []
        for name, b in read_table(calculix).items():
            for p, r, residual in zip(b.pressure, b.radius, b.wall_gap, strict=True):
                own = at(default, p / 1e3)
                off = 100 * (own / (r * 1e3) - 1)
                compared.append(
                    [
                        name,
                        f"{p / 1e3:g}",
                        f"{r * 1e3:.2f}",
                        f"{own:.2f}",
                        f"{off:+.1f}",
                        f"{residual * 1e3:.3f}",
                    ]
                )
        columns = [
            "solver",
            "kPa",
            "R in 3-D (mm)",
            "R of the unit cell (mm)",
            "difference (%)",
            "fit residual in 3-D (mm)",
        ]
        text += [_markdown(columns, compared)]
    write_text(path, "\n".join(text))
