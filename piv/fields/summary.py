"""What a file of vectors holds, in a line."""

from pathlib import Path

import numpy as np
import xarray as xr

from piv.files.errors import as_flags
from piv.formats.plane_series import Planes, absent, read_plane, usable, vectors_of

_INSTANTS = 50  # of a longer series, evenly chosen: the line is to be there at once


def summary(plane: xr.Dataset) -> str:
    """Fields and vectors, share valid, median and largest speed, median standard uncertainty."""
    series = "time" in plane["u"].dims
    count = plane.sizes["time"] if series else 1
    present = np.flatnonzero(~np.atleast_1d(absent(plane)))
    chosen = present[np.unique(np.linspace(0, present.size - 1, _INSTANTS).astype(int))]
    used = vectors_of(plane)
    planes = Planes(used) if series else [used]
    valid, uncertain, speeds, stds = [], [], [], []
    for k in chosen:
        one = planes[int(k)]
        ok = usable(one).values
        valid.append((one["valid"].values != 0).mean())
        uncertain.append(ok.mean() - valid[-1])
        speeds.append(np.hypot(one["u"].values, one["v"].values)[ok])
        if "u_std" in one and "v_std" in one:
            std = np.concatenate([one[n].values[ok] for n in ("u_std", "v_std")])
            stds.append(std[np.isfinite(std)])
    speed = np.concatenate(speeds)
    std = np.concatenate(stds) if stds else np.empty(0)
    unit = str(plane["u"].attrs.get("units", "m/s"))
    text = f"{count} field{'s' * (count != 1)} of {plane.sizes['x']} x {plane.sizes['y']} vectors, "
    text += f"{count - present.size} absent, " if present.size < count else ""
    text += f"{np.mean(valid):.1%} valid"
    if any(uncertain):
        text += f", {np.mean(uncertain):.1%} uncertain"
    if speed.size:
        name = "displacement" if unit == "px" else "speed"
        text += f"; {name} median {np.median(speed):.3g}, largest {speed.max():.3g} {unit}"
    if std.size:
        text += f"; standard uncertainty median {np.median(std):.2g} {unit}"
    if "background=static" in str(plane.attrs.get("settings", "")):
        text += as_flags("; static background taken off (`preprocess = none` keeps it)")
    if chosen.size < present.size:
        text += f" (measured on {chosen.size} of them, evenly chosen)"
    return text


def summary_of(path: str | Path) -> str:
    """Return the name of a file of vectors and its `summary`."""
    with read_plane(path) as plane:
        return f"{path}: {summary(plane)}"
