"""Vectors and what is derived from them along a straight line."""

import numpy as np
import xarray as xr

from piv.fields.blocks import blocks, fields_of
from piv.formats.plane_series import usable
from piv.vortices.contour import bilinear

_SKIPPED = ("valid", "flag", "n")  # no quantities to interpolate


def along_line(
    plane: xr.Dataset,
    start: tuple[float, float],
    end: tuple[float, float],
    points: int | None = None,
) -> xr.Dataset:
    """Interpolate every field of a plane, or of a series, to points along a line.

    Bilinear between grid points; absent where one of the four is. Of standard uncertainties the
    interpolated value is an upper bound.

    Parameters
    ----------
    plane
        A plane, or a series, which is read block by block.
    start, end
        x and y of the line's ends, in the plane's unit.
    points
        How many; by default one per grid step.

    Returns
    -------
    xarray.Dataset
        The fields over (time, s), s the distance from the start, and the velocity in the line's
        direction, `along`, and to its left, `across`. Without time for a plane.

    Raises
    ------
    ValueError
        Where the line leaves the plane, or has no length.

    Examples
    --------
    >>> x = np.arange(0, 0.16, 0.008)
    >>> plane = piv.make_plane(x, x, *np.meshgrid(0.5 * x, -0.5 * x))
    >>> line = piv.along_line(plane, (0, 0.08), (0.08, 0.08), 3)
    >>> line["along"].values
    array([0.  , 0.02, 0.04])
    """
    (x0, y0), (x1, y1) = start, end
    length = float(np.hypot(x1 - x0, y1 - y0))
    step = min(float(plane[n][1] - plane[n][0]) for n in ("x", "y"))
    if not length > 0:
        raise ValueError("the line has no length: give two different points")
    for name, ends in (("x", (x0, x1)), ("y", (y0, y1))):
        low, high = float(plane[name][0]), float(plane[name][-1])
        if not all(low - 1e-9 * step <= e <= high + 1e-9 * step for e in ends):
            raise ValueError(f"the line leaves the plane: {name} runs from {low:g} to {high:g}")
    count = points or max(2, round(length / step) + 1)
    if count < 2:
        raise ValueError(f"a line has at least 2 points, got {count}")
    s = np.linspace(0, length, count)
    way = {"x": x0 + s / length * (x1 - x0), "y": y0 + s / length * (y1 - y0)}
    # rounding must not leave the plane
    x, y = (np.clip(c, *plane[name].values[[0, -1]]) for name, c in way.items())
    names = [n for n in fields_of(plane) if n not in _SKIPPED]
    parts = []
    for part in blocks(plane):
        ok = usable(part)
        samples = {n: bilinear(part[n].where(ok), x, y) for n in names}
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        samples["along"] = samples["u"] * ux + samples["v"] * uy
        samples["across"] = samples["v"] * ux - samples["u"] * uy
        parts.append(samples)
    units = {n: plane[n].attrs.get("units", "1") for n in names}
    units |= dict.fromkeys(("along", "across"), units["u"])
    line = xr.Dataset(
        {n: (("time", "s"), np.concatenate([p[n] for p in parts]), {"units": units[n]})
         for n in parts[0]},
        coords={"s": ("s", s, plane["x"].attrs), "x": ("s", x, plane["x"].attrs),
                "y": ("s", y, plane["y"].attrs)},
    )  # fmt: skip
    if "time" not in plane["u"].dims:
        return line.isel(time=0)
    return line.assign_coords(time=plane["time"])
