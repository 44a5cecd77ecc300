"""`python -m docs.evidence.piv.vortex_row`: how closely vortices may follow each other in a layer.

Stuart's row of vortices (J. Fluid Mech. 29, 417, 1967), an exact flow of a shear layer that has
rolled up, is rendered as the scene's camera sees it and evaluated. Writes
docs/record/vortex_row.csv: which part of the vortices is found.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from docs.evidence.piv.flows import vortex_row
from docs.evidence.piv.pairs import render_pair
from piv.correlation.pair import correlate_pair
from piv.vortices.find import plane_of
from piv.vortices.regions import find_regions
from piv.vortices.settings import VortexSettings
from postprocess.tables import write_table

SHAPE = (384, 768)
SIDE = 64  # px left out at either end
WINDOW, MM = 32, 0.125  # px; mm per px, both of single_finger
JUMP = 4.8  # px per frame across the layer: 0.3 m/s at 500 Hz, as fast as the tip
SPACINGS = (96, 64, 48, 40, 32, 24)  # px
CONCENTRATIONS = (0.5, 0.8)  # 0: a smooth layer, 1: point vortices
# px, of the Gaussian: the scene's, a sixth of the tip's width, and one step of the vectors
SCALES = {"scene": 19.0, "vectors": 8.0}
PAIRS, FIRST = 3, 4101


def seen(plane: xr.Dataset, scale: float, spacing: float) -> tuple[float, float]:
    """Shares of the row's vortices that are found, and of false ones, at a scale (px)."""
    settings = VortexSettings(min_circulation=0.05 * JUMP * spacing)
    regions = find_regions(plane_of(plane, settings), scale, settings)
    places = [region.measures for region in regions]
    most = (0.5 * SHAPE[1] - SIDE) // spacing
    centres = 0.5 * SHAPE[1] + spacing * np.arange(-most, most + 1)
    at = np.array([(m.x, m.y - 0.5 * (SHAPE[0] - 1)) for m in places]).reshape(-1, 2)
    at = at[np.abs(at[:, 0] - 0.5 * SHAPE[1]) < (most + 0.5) * spacing]
    near = np.hypot(centres[:, None] - at[:, 0], at[:, 1]) < 0.25 * spacing
    hit = near.any(axis=1).sum()
    return hit / len(centres), (len(at) - hit) / len(centres)


def rows(concentration: float, spacing: float) -> list[dict[str, object]]:
    """What is seen in the vectors and in the flow itself, by smoothing length."""
    flow = vortex_row(spacing, JUMP, concentration, SHAPE)
    seen_as = {"noise": 0.02, "background": 8.0}
    pairs = [render_pair(flow, SHAPE, seed=FIRST + k, **seen_as) for k in range(PAIRS)]
    planes = [correlate_pair(*pair, window=WINDOW) for pair in pairs]
    u, v = flow(*np.meshgrid(planes[0]["x"], planes[0]["y"]))
    exact = planes[0][["u", "v"]].copy(data={"u": u, "v": v})
    table: list[dict[str, object]] = []
    for name, scale in SCALES.items():
        piv, false = np.mean([seen(plane, scale, spacing) for plane in planes], axis=0)
        row = {"concentration": concentration, "spacing_mm": spacing * MM, "smoothing": name}
        row |= {"smoothing_mm": scale * MM, "seen_flow": seen(exact, scale, spacing)[0]}
        table.append(row | {"seen_piv": piv, "false_piv": false})
    return table


if __name__ == "__main__":
    table = [row for c in CONCENTRATIONS for spacing in SPACINGS for row in rows(c, spacing)]
    record = Path(__file__).resolve().parents[3] / "docs" / "record"
    write_table(record / "vortex_row.csv", pd.DataFrame(table).round(2))
