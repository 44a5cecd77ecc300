"""Vorticity, divergence, strain, swirling strength and Q with propagated uncertainty."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.fields.blocks import blocks
from piv.formats.plane_series import usable
from piv.formats.recording import window_of
from piv.vortices.criteria import (
    SCHEMES,
    Gradients,
    derivative,
    gradients,
    q_criterion,
    swirling_strength,
    vorticity,
)

QUANTITIES = ("vorticity", "divergence", "strain", "swirling_strength", "q")
REACH = 2  # grid points that a derivative looks at on either side


def derived(
    plane: xr.Dataset,
    quantities: tuple[str, ...] = QUANTITIES,
    *,
    correlation_length: float | None = None,
) -> xr.Dataset:
    """Add vorticity and other derivatives to a plane or series, with their standard uncertainties.

    vorticity dv/dx - du/dy, divergence du/dx + dv/dy, strain: largest in-plane shear strain rate
    sqrt((du/dx - dv/dy)²/4 + (du/dy + dv/dx)²/4), swirling_strength and q as of
    `piv.vortices.criteria`; in 1/s (q: 1/s²), or per frame. Uncertainty to first order, errors of u
    and v independent of one another, those of neighbours d apart correlated by exp(-2
    (d/correlation_length)²). All in memory: `derived_blocks` for more.

    Parameters
    ----------
    plane
        A plane or series.
    quantities
        Names of what is added; `<name>_std` goes with each where u_std and v_std are known.
    correlation_length
        In the plane's unit, by default the side of the PIV window.

    Returns
    -------
    xarray.Dataset
        The plane with the quantities.

    Raises
    ------
    ValueError
        For an unknown quantity.

    Examples
    --------
    >>> x = np.arange(0, 0.16, 0.008)
    >>> rotation = piv.make_plane(x, x, *np.meshgrid(-2 * x, 2 * x)[::-1])  # solid body, 2 rad/s
    >>> float(piv.derived(rotation)["vorticity"][5, 5].round(3))
    -4.0
    """
    parts = list(derived_blocks(plane, quantities, correlation_length=correlation_length))
    whole = xr.concat(parts, "time") if len(parts) > 1 else parts[0]
    if "time" not in plane["u"].dims:
        whole = whole.isel(time=0, drop="time" not in plane.coords)
    made = {n: whole[n] for n in whole.data_vars if str(n).removesuffix("_std") in quantities}
    return _without_uncertainty(plane, quantities).assign(made)


def _without_uncertainty(plane: xr.Dataset, quantities: tuple[str, ...]) -> xr.Dataset:
    """The plane without the quantities and uncertainties of an earlier derivation."""
    return plane.drop_vars([f"{name}_std" for name in quantities], errors="ignore")


def derived_blocks(
    plane: xr.Dataset,
    quantities: tuple[str, ...] = QUANTITIES,
    *,
    correlation_length: float | None = None,
) -> Iterator[xr.Dataset]:
    """As `derived`, in parts along time."""
    if unknown := sorted(set(quantities) - set(QUANTITIES)):
        raise ValueError(f"unknown quantity {unknown[0]!r}; known are {', '.join(QUANTITIES)}")
    length = window_of(plane) if correlation_length is None else correlation_length
    if not (np.isfinite(length) and length >= 0):
        raise ValueError(f"correlation_length must not be negative, got {length}")
    dx, dy = (float(plane[n][1] - plane[n][0]) for n in ("x", "y"))
    rate = "1/frame" if plane["x"].attrs.get("units") == "px" else "1/s"
    for part in blocks(plane):
        stacks: dict[str, list[ndarray]] = {}
        for k in range(part.sizes["time"]):
            found = _of_instant(part.isel(time=k), quantities, dx, dy, length)
            for name, values in found.items():
                stacks.setdefault(name, []).append(values)
        new = {n: (("time", "y", "x"), np.stack(a).astype(np.float32)) for n, a in stacks.items()}
        part = _without_uncertainty(part, quantities).assign(new)
        for name in new:
            part[name].attrs = {"units": f"{rate}²" if name.startswith("q") else rate}
            if name.endswith("_std"):
                part[name].attrs["correlation_length"] = float(length)
        yield part


def _of_instant(
    plane: xr.Dataset, quantities: tuple[str, ...], dx: float, dy: float, length: float
) -> dict[str, ndarray]:
    u, v, ok = plane["u"].values, plane["v"].values, usable(plane).values
    g = gradients(u, v, ok, dx, dy)
    normal, shear = (g.dudx - g.dvdy) / 2, (g.dudy + g.dvdx) / 2
    strain, swirl = np.hypot(normal, shear), swirling_strength(g)
    values = dict(
        zip(QUANTITIES, (vorticity(g), g.dudx + g.dvdy, strain, swirl, q_criterion(g)), strict=True)
    )
    out = {name: values[name] for name in quantities}
    if "u_std" not in plane or "v_std" not in plane:
        return out
    var = Gradients(
        *(
            variance(plane[f"{n}_std"].values, ok, step, axis, length)
            for n in ("u", "v")
            for step, axis in ((dx, 1), (dy, 0))
        )
    )
    # sensitivities to dudx, dudy, dvdx, dvdy
    with np.errstate(divide="ignore", invalid="ignore"):
        normal_part, shear_part = normal / strain / 2, shear / strain / 2
        half = np.where(swirl != 0, -0.5 / np.abs(swirl), np.nan)
        s = {
            "vorticity": (0, 1, 1, 0),
            "divergence": (1, 0, 0, 1),
            "strain": (normal_part, shear_part, shear_part, normal_part),
            "swirling_strength": (half * normal, half * g.dvdx, half * g.dudy, half * normal),
            "q": (g.dudx, g.dvdx, g.dudy, g.dvdy),
        }
        for name in quantities:
            out[f"{name}_std"] = np.sqrt(
                sum(np.square(a) * b for a, b in zip(s[name], var, strict=True))
            )
    return out


def variance(std: ndarray, ok: ndarray, step: float, axis: int, length: float) -> ndarray:
    """Variance of `criteria.derivative` for errors d apart correlated by exp(-2 (d/length)²).

    A derivative is linear in the values. Of five neighbours in a row each has another index modulo
    5: the derivative of a field that is 1 at one remainder and 0 at the others is the weight of
    that neighbour.
    """
    n, width = ok.shape[axis], 2 * REACH + 1
    index = np.arange(n)
    reshape = (1, n) if axis == 1 else (n, 1)
    good = np.where(ok & np.isfinite(std), std, np.nan)
    weights, offsets = [], []
    for r in range(width):
        only = np.broadcast_to((index % width == r).astype(float).reshape(reshape), ok.shape)
        offset = (r - index + REACH) % width - REACH
        neighbour = np.take(good, np.clip(index + offset, 0, n - 1), axis=axis)
        weight = derivative(only, ok, step, axis, SCHEMES[0])
        weights.append(np.where(weight == 0, 0.0, weight * neighbour))
        offsets.append(offset)
    total = np.zeros(ok.shape)
    for a, i in zip(weights, offsets, strict=True):
        for b, j in zip(weights, offsets, strict=True):
            apart = (np.abs(i - j) * step).reshape(reshape)
            rho = np.exp(-2 * (apart / length) ** 2) if length else (apart == 0).astype(float)
            total += rho * a * b
    return total
