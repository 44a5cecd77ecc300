"""The circulation of the finger's tip on its family of grids, counted in several ways: which converges, and why the others do not.

python -m tests.studies.circulation   (make convergence): of the runs that are there, into docs/mesh.md
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from fileio.command import guarded
from fileio.errors import StageError
from fileio.formats.plane_series import read_plane
from fileio.formats.records import RUN
from pipeline.scene.scene import Scene
from piv.vortices.circulation import distance_to_invalid
from piv.vortices.criteria import gradients, vorticity
from postprocess.evidence.dorsal_circulation import dorsal_circulation, instants
from postprocess.evidence.fields import frame
from postprocess.evidence.tip_vortex import dominant_track, read_vortices
from postprocess.evidence.vortex_integral import CIRCLE, CLEAR, vortex_integrals
from postprocess.studies.tradeoff import vortex_errors
from tests.studies.pages import libraries, write_between
from tests.studies.validation.convergence import estimate
from tests.studies.validation.finger import JUDGED, family

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "mesh.md"
REACHES = (1.5, 2.0, 2.5)  # tip widths from the tip
MARGINS = (0.06, 0.2)  # tip widths from the finger besides CLEAR: 1 and 3.3 mm
REGIONS = [(reach, CLEAR) for reach in REACHES] + [(REACHES[1], margin) for margin in MARGINS]


def beyond_margin(
    plane: xr.Dataset, window: tuple[float, float], regions: list[tuple[float, float]]
) -> list[pd.DataFrame]:
    """Vorticity of both senses on the dorsal side of the first tip, by region: within its reach, farther than its margin of the body.

    Reach and margin in tip widths. Columns time, circulation (m²/s), x, y (m; centroid), a row per instant of `plane` in the window (s).
    """
    x, y, width = plane["x"].values, plane["y"].values, float(plane.attrs["tip_width"])
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    rows: list[list[list[float]]] = [[] for _ in regions]
    for index in instants(plane, window):
        (u, v), valid = frame(plane, int(index))
        tip, dorsal = plane["tip"].values[index, 0], plane["dorsal_direction"].values[index, 0]
        off_x, off_y = x - tip[0], (y - tip[1])[:, None]
        on_side, off = off_x * dorsal[0] + off_y * dorsal[1] > 0, np.hypot(off_x, off_y)
        omega = vorticity(gradients(u, v, valid, dx, dy, "least-squares"))
        away = distance_to_invalid(valid, dx, dy)
        for (reach, margin), found in zip(regions, rows, strict=True):
            amount = np.where(
                on_side & (off <= reach * width) & (away > margin * width), omega, 0.0
            )
            total = amount.sum()
            centroid = (amount.sum(axis=0) @ x / total, amount.sum(axis=1) @ y / total)
            found.append([plane["time"].values[index], total * abs(dx * dy), *centroid])
    return [pd.DataFrame(found, columns=["time", "circulation", "x", "y"]) for found in rows]


def measures(scenes: list[Scene], window: tuple[float, float]) -> dict[str, list[pd.DataFrame]]:
    """Every way of counting, and what it finds on each grid, from coarse to fine."""
    tracks = [
        dominant_track(read_vortices(s.out / "vortices_cfd.csv"), 0, window, s.level)
        for s in scenes
    ]
    found: dict[str, list[pd.DataFrame]] = {}
    for scene, track in zip(scenes, tracks, strict=True):
        with read_plane(scene.out / "sheet.h5") as plane:
            radius = CIRCLE * float(plane.attrs["tip_width"])
            ways = {
                f"vortex's sense, {CIRCLE:g} widths round each grid's own fit": vortex_integrals(
                    plane, track, radius, window
                ),
                f"vortex's sense, {CIRCLE:g} widths round the finest grid's fit": vortex_integrals(
                    plane, tracks[-1], radius, window
                ),
            }
            for (reach, margin), rows in zip(
                REGIONS, beyond_margin(plane, window, REGIONS), strict=True
            ):
                ways[f"dorsal side, {reach:g} widths round the tip, {margin:g} from the finger"] = (
                    rows
                )
            for reach in REACHES:
                way = f"dorsal side, {reach:g} widths round the tip, all water"
                ways[way] = rows = dorsal_circulation(plane, window, reach)
                # the finger's surface gives the rest on every grid, which would make errors look smaller
                ways[f"{way}: what is not prescribed"] = rows.assign(circulation=rows["of_water"])
        for name, rows in ways.items():
            found.setdefault(name, []).append(rows)
    return found


def table(found: dict[str, list[pd.DataFrame]], scenes: list[Scene]) -> str:
    """Markdown: mean circulation on each grid, how far each is from the finest, and the mean's uncertainty (docs/verification.md)."""
    levels = [scene.level for scene in scenes]
    cells = [RUN.read(scene.out / "run" / "run.json")["cells"] for scene in scenes]
    known = [level for level in JUDGED if level in levels]
    judged = [levels.index(level) for level in known]
    heads = [f"{level}, cm²/s" for level in levels] + [f"{level}: %; mm" for level in levels[:-1]]
    heads += ["order", *(f"uncertainty at {level}, %" for level in known)]
    lines = ["| vorticity counted | " + " | ".join(heads) + " |", "|" + "---|" * (len(heads) + 1)]
    for name, grids in found.items():
        mean = np.array([abs(rows["circulation"].mean()) for rows in grids])
        apart = [vortex_errors(grids[-1], rows, (-np.inf, np.inf), 1.0) for rows in grids[:-1]]
        fit = estimate(np.array(cells, float) ** (-1 / 3), mean)
        row = [name, *(f"{1e4 * m:.1f}" for m in mean)]
        row += [f"{100 * e['error_circulation']:.1f}; {e['error_centre_mm']:.2f}" for e in apart]
        row += ["none" if fit.order is None else f"{fit.order:.2g}"]
        row += [f"{100 * fit.uncertainty[k] / abs(fit.extrapolated):.1f}" for k in judged]
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""

    def action() -> None:
        found = family(ROOT / "cases" / "single_finger")
        if found is None:
            raise StageError(
                "circulation: fewer than three grids have been run; make convergence runs them"
            )
        scenes, window = found
        text = table(measures(scenes, window), scenes)
        about = f"Means, and RMS differences from the finest of these grids, {window[0]:.3f} to {window[1]:.3f} s; {libraries()}."
        write_between(PAGE, "circulation", f"{text}\n\n{about}")

    sys.exit(guarded("circulation", action))


if __name__ == "__main__":
    main()
