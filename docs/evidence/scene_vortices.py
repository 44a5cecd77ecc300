"""Print the main vortex of each scene in the flow and in PIV, from the runs of a level.

python -m docs.evidence.scene_vortices LEVEL [SCENE ...]
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from docs.evidence.small_scene import ROOT
from piv.formats.plane_series import read_plane
from piv.formats.vortex_table import read_vortices
from postprocess.evidence.tip_vortex import KNOWN

SCENES = ("single_finger", "single_deflate", "cycle", "pinch")


def main_track(
    folder: Path, table: str, series: str, like: pd.DataFrame | None = None
) -> tuple[pd.DataFrame, str]:
    """Select the strongest track over time without bridges; tell at how many instants it is.

    `like`: rows of a track whose sense it has. A pinch has two mirrored vortices.
    """
    rows = read_vortices(folder / table)
    if like is not None:
        rows = rows[rows["circulation_disc"] * like["circulation_disc"].median() > 0]
    track = rows["circulation_disc"].abs().groupby(rows["track"]).sum().idxmax()
    rows = rows[(rows["track"] == track) & (rows["bridged"] == 0)].sort_values("time")
    with read_plane(folder / series) as planes:
        inside = planes["time"].values
    first, last = rows["time"].iloc[[0, -1]]
    count = int(np.count_nonzero((inside >= first - 1e-9) & (inside <= last + 1e-9)))
    return rows, f"{len(rows)} of {count}"


def row_of(scene: str, level: str) -> dict[str, object]:
    """Compare the flow's main vortex with PIV's, as in the table of docs/vortices.md."""
    folder = ROOT / "cases" / scene / "out" / level
    if not (folder / "vortices_piv.csv").exists():
        raise SystemExit(f"{scene} has no vortices at level {level}: make {scene} LEVEL={level}")
    flow, followed = main_track(folder, "vortices_cfd.csv", "sheet.h5")
    piv, in_piv = main_track(folder, "vortices_piv.csv", "piv.h5", flow)
    piv = piv[piv["time"].between(*flow["time"].iloc[[0, -1]])]
    true = np.interp(piv["time"], flow["time"], flow["circulation_disc"])
    known = piv["circulation_disc_std"] < KNOWN * piv["circulation_disc"].abs()
    off = 100 * (piv["circulation_disc"] / true - 1)[known]
    difference = f"{np.sqrt(np.mean(off**2)):.1f}" if known.any() else ""
    return {
        "scene, level": f"{scene}, {level}",
        "followed, flow": followed,
        "followed, PIV": in_piv,
        "difference, %": difference,
        "known instants": f"{known.sum()} of {len(piv)}",
    }


if __name__ == "__main__":
    level = sys.argv[1] if len(sys.argv) > 1 else "coarse"
    rows = [row_of(scene, level) for scene in sys.argv[2:] or SCENES]
    print(pd.DataFrame(rows).to_string(index=False))
