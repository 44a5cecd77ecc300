"""The trade on paper: table of results, figure of the front, and the page docs/tradeoff.md, for one scene."""

from __future__ import annotations

import json
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fileio.atomic import write_text
from fileio.provenance import versions
from postprocess.draw.quantity_text import number
from postprocess.draw.style import CFD, GREY, PIV, label_points, new_figure, save
from postprocess.evidence.dorsal_circulation import REACH
from postprocess.evidence.vortex_integral import CIRCLE

LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "numba")
# The axes of the study: run, what it is compared with, and what the comparison tells.
AXES = (
    ("draft_2d", "draft", "Model, 2-D against half"),
    ("draft_full", "draft", "Model, full against half"),
    ("draft_les", "draft", "Turbulence, WALE against laminar"),
    ("draft_euler", "draft", "Time scheme, Euler against backward"),
    ("coarse", "draft", "Level, coarse against draft"),
    ("medium", "coarse", "Level, medium against coarse"),
    ("medium_2ms", "medium", "Time step, 2 ms against 1 ms"),
    ("piv_fast", "piv", "Preset, fast against balanced"),
    ("piv_accurate", "piv", "Preset, accurate against balanced"),
    ("piv_window16", "piv", "Window, 16 against 32 px"),
    ("piv_window48", "piv", "Window, 48 against 32 px"),
    ("piv_spacing4", "piv", "Spacing, 4 against 8 px"),
    ("piv_spacing16", "piv", "Spacing, 16 against 8 px"),
    ("piv_frames3", "piv", "Frames of a set, three against two"),
    ("piv_frames5", "piv", "Frames of a set, five against two"),
)


GRIDS = """## The family of grids

The levels at one time step and to the time at which the best run ends: what the cells alone do (docs/verification.md has the
orders of circulation, centre and force). Nobody chooses these runs.

"""


def percent(value: Any) -> str:
    """A part in per cent, or a dash where it was not measured."""
    return "–" if pd.isna(value) else f"{100 * float(value):.1f}"


def results_text(table: pd.DataFrame, best: str, probe: dict[str, float]) -> str:
    """The table as CSV under one line of provenance."""
    head = {
        "format": "tradeoff",
        "format_version": 1,
        "best": best,
        "made": datetime.now(UTC).date().isoformat(),
        "probe": probe,
        "versions": {"python": platform.python_version()} | versions(*LIBRARIES),
    }
    rounded = table.copy()
    for name in rounded.select_dtypes("number"):
        rounded[name] = [float(f"{v:.5g}") if pd.notna(v) else v for v in rounded[name]]
    return f"# {json.dumps(head)}\n{rounded.to_csv(index=False)}"


def axis_sentence(table: pd.DataFrame, run: str, base: str, title: str) -> str | None:
    """One line about a pair of runs: what the change costs and what it does; None where one of them is missing."""
    rows = table.set_index("run")
    if run not in rows.index or base not in rows.index:
        return None
    a, b = rows.loc[run], rows.loc[base]
    if a["kind"] == "piv":
        cost = a["cpu_piv_per_field_s"] / b["cpu_piv_per_field_s"]
        return (
            f"**{title}**: {cost:.2f} × the time of a field, {a['vectors'] / b['vectors']:.2g} × the vectors; error of velocity"
            f" {percent(b['error_velocity'])} → {percent(a['error_velocity'])} %, of circulation"
            f" {percent(b['error_circulation'])} → {percent(a['error_circulation'])} %."
        )
    cost = a["cpu_flow_s"] / b["cpu_flow_s"]
    circulation = a["circulation_cfd_m2_per_s"] / b["circulation_cfd_m2_per_s"] - 1
    force = a["peak_force_N"] / b["peak_force_N"] - 1
    return (
        f"**{title}** (`{run}` against `{base}`): {cost:.2f} × the CPU time; tip circulation {circulation:+.1%},"
        f" largest force {force:+.1%}; error against the best run: dorsal circulation"
        f" {percent(b['error_dorsal'])} → {percent(a['error_dorsal'])} %, velocity {percent(b['error_velocity'])}"
        f" → {percent(a['error_velocity'])} %, force {percent(b['error_force'])} → {percent(a['error_force'])} %,"
        f" centre {b['error_centre_mm']:.2f} → {a['error_centre_mm']:.2f} mm."
    )


def markdown_table(rows: pd.DataFrame, columns: dict[str, str]) -> str:
    """A Markdown table of some columns; errors and parts in per cent."""
    lines = ["| " + " | ".join(columns.values()) + " |", "|" + "---|" * len(columns)]
    for _, row in rows.iterrows():
        cells = []
        for name in columns:
            value = row.get(name)
            if name == "run":
                cells.append(f"**{value}**" if row["front"] else str(value))
            elif name.endswith("_part") or (name.startswith("error") and not name.endswith("_mm")):
                cells.append(percent(value))
            elif isinstance(value, float):
                cells.append("–" if pd.isna(value) else number(value))
            else:
                cells.append(str(value))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def not_below(missing: dict[str, str]) -> str:
    """Which runs of the study the page has not, and why."""
    if not missing:
        return "Every run of the study is below."
    listed = "; ".join(f"{run} ({why})" for run, why in missing.items())
    return f"**Incomplete.** Not below, or of an earlier `make tradeoff` (PIV), until it has made them: {listed}."


def page(scene: str, table: pd.DataFrame, best: str, missing: dict[str, str]) -> str:
    """docs/tradeoff.md."""
    flow, grids, piv = (table[table["kind"] == kind].copy() for kind in ("flow", "grid", "piv"))
    for rows in (flow, grids):
        rows["cells"] = rows["cells"].astype(int).astype(str)
    reference = table[table["run"] == best].iloc[0]
    sentences = {
        kind: [s for run, base, title in AXES if run.startswith("piv") == (kind == "piv")
               if (s := axis_sentence(table, run, base, title))]
        for kind in ("flow", "piv")
    }  # fmt: skip
    flow_columns = {
        "run": "run", "cells": "cells", "time_step_s": "step, s", "cpu_flow_s": "CPU, s", "peak_memory_MB": "memory, MB",
        "error_dorsal": "dorsal circulation, %", "error_centre_mm": "centre, mm", "error_velocity": "velocity, %",
        "error_force": "force, %", "error": "worst, %", "error_circulation": "circulation in a circle, %",
        "error_circulation_fit": "circulation of the fit, %",
    }  # fmt: skip
    work_columns = {
        "run": "run", "end_time_s": "until, s", "work_J": "work, J", "kinetic_part": "kinetic energy, %", "viscous_part": "viscosity, %",
        "convection_part": "convection scheme, %", "coupling_part": "coupling, %", "unexplained_part": "unexplained, %",
    }  # fmt: skip
    piv_columns = {
        "run": "run", "vectors": "vectors", "cpu_piv_per_field_s": "CPU a field, s", "error_circulation": "circulation, %",
        "error_centre_mm": "centre, mm", "error_velocity": "velocity, %", "error": "worst, %",
    }  # fmt: skip
    return f"""# What accuracy costs: {scene}

Written by `make tradeoff SCENE={scene}` from the study `cases/{scene}/studies/tradeoff.csv`, which Snakemake runs; all its
numbers are in [`results/tradeoff.csv`](../cases/{scene}/studies/results/tradeoff.csv) with versions and date. OpenFOAM {reference["openfoam"]}.

![Error against CPU time, the front of those that nothing beats](tradeoff/{scene}.svg)

{not_below(missing)}

## The flow

The others are judged by `{best}` ({int(float(reference["cells"]))} cells, {reference["time_step_s"] * 1e3:g} ms, to
{reference["end_time_s"]:g} s, {reference["cpu_run_s"] / 60:.0f} CPU minutes of solver). It is the finest run, not the truth: an error below the
difference between it and a finer one means nothing (docs/verification.md has the orders). Its own errors are an estimate: those of the next two
grids of its family, extrapolated at the order at which they fall, held between first and second. Errors are over the middle half of the stroke
by bend, as far as `{best}` goes (the force: from the beginning): circulation of all water on the tip's dorsal side within {REACH:g} tip widths, RMS over that of its
part that is not prescribed (the finger's own surface gives the larger part, the same on every grid); distance of the tip vortex's centre, RMS, of which {flow["tip_width_mm"].max():.1f} mm, a tip's width, are 100 %;
velocity on the sheet, RMS over the largest speed of the tip; force on the finger, RMS over its RMS. The centre is that of the vorticity of the vortex's sense within
{CIRCLE:g} tip widths of its fitted centre. `worst` is the largest of the four and what `ACCURACY=` asks for. Bold: nothing is both cheaper and more accurate. CPU time is user and system time of
kinematics, mesh, case and solver on a machine shared with other work.

Two other circulations are shown beside them. Until 2026-11-23 the one *in a circle*, the same vorticity within {CIRCLE:g} widths and farther than 2 mm from the finger, was judged: it converges slowly or not at all,
since the wall's layers, which a coarse mesh widens, reach beyond the 2 mm (docs/mesh.md). `worst` with it would be its value, where that is larger. The one *of the fit* counts what belongs to a round core, which a coarse mesh widens.

{markdown_table(flow, flow_columns)}

{chr(10).join("- " + s for s in sentences["flow"])}

{GRIDS + markdown_table(grids, flow_columns) + chr(10) if len(grids) else ""}
## Where the finger's work on the water goes

Parts of the work ([schemes](schemes.md) says how they are told). What the convection scheme and the coupling of pressure and velocity take,
the water would not.

{markdown_table(table[table["kind"] != "piv"], work_columns)}

## PIV

A quarter of the camera's picture round the tip, rendered from the `draft` run's flow, against that flow.

{markdown_table(piv, piv_columns)}

{chr(10).join("- " + s for s in sentences["piv"])}

## Asking for accuracy

`make {scene} ACCURACY=12%` takes the cheapest of the runs above whose worst error is at most 12 %; `BUDGET=10min` the most accurate
that is done in ten minutes. A probe of a few seconds (`pipeline/study/machine_speed.py`) scales the CPU seconds of the table to the machine at hand; what it
took is compared with that afterwards. The settings run in `cases/{scene}/out/studies/asked/`.
"""


def draw(table: pd.DataFrame, path: Path) -> Path:
    """Error against CPU time, flow on the left and PIV on the right; the front joined by a line."""
    figure, axes = new_figure(11, 4.6, 1, 2)
    panels = (
        ("flow", "cpu_flow_s", "CPU time of the flow, s", CFD),
        ("piv", "cpu_piv_per_field_s", "CPU time of a field, s", PIV),
    )
    for axis, (kind, cost, label, colour) in zip(axes, panels, strict=True):
        rows = table[(table["kind"] == kind) & table["error"].notna()]
        title = {"flow": "Flow", "piv": "PIV"}[kind]
        axis.set(xscale="log", yscale="log", xlabel=label, ylabel="worst error, %", title=title)
        _panel(axis, rows, cost, colour)
    return save(figure, path)


def _panel(axis: Axes, rows: pd.DataFrame, cost: str, colour: str) -> None:
    if rows.empty:
        axis.text(0.5, 0.5, "not run yet", transform=axis.transAxes, ha="center")
        return
    ahead = rows[rows["front"]].sort_values(cost)
    axis.plot(ahead[cost], 100 * ahead["error"], color=colour, lw=1.2, zorder=1)
    axis.scatter(
        rows[cost],
        100 * rows["error"],
        c=[colour if f else GREY for f in rows["front"]],
        s=28,
        zorder=2,
    )
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        side.set_minor_formatter(NullFormatter())
    axis.margins(x=0.2, y=0.1)
    points = list(zip(rows[cost], 100 * rows["error"], strict=True))
    label_points(axis, points, [str(run).removeprefix("piv_") for run in rows["run"]])


def results_path(folder: Path) -> Path:
    """The table of results of a scene's folder."""
    return folder / "studies" / "results" / "tradeoff.csv"


def write_results(
    folder: Path,
    table: pd.DataFrame,
    best: str,
    probe: dict[str, float],
    docs: Path,
    missing: dict[str, str],
) -> None:
    """Write studies/results/tradeoff.csv of a scene's folder, docs/tradeoff/<scene>.svg and docs/tradeoff.md."""
    write_text(results_path(folder), results_text(table, best, probe))
    draw(table, docs / "tradeoff" / f"{folder.name}.svg")
    write_text(docs / "tradeoff.md", page(folder.name, table, best, missing))
