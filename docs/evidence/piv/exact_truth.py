"""Scores of `make benchmark`'s recordings: this project beside its peers.

Bodies are black in the pictures. OpenPIV and PIVtools get the bodies of both pictures of a pair as
one mask, since neither takes two; fluidimage has no masks. Vectors in bodies are taken off for all.
"""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import xarray as xr

from docs.evidence.benchmark import SCENES, main
from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.with_peers import OURS, Pair, with_peers
from docs.evidence.small_scene import ROOT
from piv.formats.plane_series import make_plane, read_plane
from piv.synthetic.score import score

FOLDER = ROOT / "benchmark"


def ours(folder: Path, truth: xr.Dataset, pairing: str) -> xr.Dataset:
    """Vectors by `piv correlate` with its defaults."""
    rate = 1 / float(np.diff(truth["time"].values[:2])[0])
    options = ["--scale-mm-per-px", f"{truth.attrs['scale_mm_per_px']}", "--rate", f"{rate}"]
    options += ["--pairing", pairing, "--quiet"]
    if pairing == "1-2,3-4":
        options += ["--interval", f"{truth.attrs['interval']}"]
    if (folder / "masks").exists():
        options += ["--mask", str(folder / "masks")]
    file = folder.parent / f"{folder.name}.h5"
    command = ["correlate", str(folder / "frames"), "-o", str(file)]
    subprocess.run([sys.executable, "-m", "piv", *command, *options], check=True)
    with read_plane(file) as vectors:
        vectors.load()
    file.unlink()
    return vectors


def regular(plane: xr.Dataset) -> xr.Dataset:
    """Interpolate vectors whose axes are not evenly spaced, as fluidimage's, to even ones."""
    axes = {n: plane[n].values for n in "xy"}
    steps = {n: np.median(np.diff(axis)) for n, axis in axes.items()}
    even = {n: np.arange(axis[0], axis[-1] + 1e-6, steps[n]) for n, axis in axes.items()}
    alike = all(even[n].shape == axes[n].shape and np.allclose(even[n], axes[n]) for n in "xy")
    return plane if alike else plane.interp(even)


def table_of(folder: Path) -> pd.DataFrame:
    """A row of each program, a column of each measure."""
    with read_plane(folder / "truth.nc") as truth:
        truth.load()
    frames, masks = (
        [np.asarray(cv2.imread(str(p), cv2.IMREAD_UNCHANGED)) for p in sorted(folder.glob(files))]
        for files in ("frames/*", "masks/*")
    )
    film = folder.name in SCENES
    first = range(0, len(frames) - 1, 1 if film else 2)
    pairs = [
        Pair(
            f"{k:03d}", (frames[k], frames[k + 1]), {}, {},
            (masks[k] > 0) | (masks[k + 1] > 0) if masks else None,
        )
        for k in first
    ]  # fmt: skip
    series: dict[str, list[xr.Dataset]] = {}
    for _, found in with_peers(f"exact_{folder.name}", pairs):
        for name, vectors in found.items():
            series.setdefault(name, []).append(vectors)
    rows = {OURS: score(ours(folder, truth, "1-2,2-3" if film else "1-2,3-4"), truth)}
    pixel = truth.attrs["scale_mm_per_px"] * 1e-3
    speed = pixel / truth.attrs["interval"]
    for name, several in series.items():
        planes = [regular(plane) for plane in several]
        u, v = (speed * np.stack([p[n].values for p in planes]) for n in "uv")
        x, y = (pixel * planes[0][n].values for n in "xy")
        rows[name] = score(make_plane(x, y, u, v, time=truth["time"].values), truth)
    table = pd.DataFrame(rows).round(4)
    return table.reset_index(names="measure")


def study() -> None:
    """A table of each recording."""
    if not FOLDER.exists():
        main(FOLDER)
    folders = [path.parent for path in sorted(FOLDER.glob("*/truth.nc"))]
    note = ", ".join(f"{k}: {f.name}" for k, f in enumerate(folders, 1))
    write_study("exact_truth", [table_of(f) for f in folders], f"Tables {note}; {libraries()}.")
