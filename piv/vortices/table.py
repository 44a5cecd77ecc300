"""Vortices of a plane series over time: found, tracked, and placed in the tip's frame."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import asdict
from itertools import islice

import numpy as np
import pandas as pd
import xarray as xr
from tqdm import tqdm

from piv.files.child_process import worker_pool
from piv.formats.plane_series import VECTORS, Planes, absent, check_vectors, units_of, usable
from piv.formats.vortex_table import COLUMNS
from piv.images.file_names import PAIRINGS
from piv.vortices.find import VortexSettings, find_vortices
from piv.vortices.tip_frame import place_at_tip
from piv.vortices.tracking import Tracker, TrackingSettings
from piv.vortices.vortex import Vortex

USED = (*VECTORS, "outline", "tip", "tip_direction", "dorsal_direction", "bend")


def tabulate_vortices(
    series: xr.Dataset,
    settings: VortexSettings | None = None,
    tracking: TrackingSettings | None = None,
    *,
    processes: int = 1,
    quiet: bool = True,
) -> pd.DataFrame:
    """Tabulate the vortices of every instant, and track them.

    Parameters
    ----------
    series
        A plane series, or one plane.
    settings, tracking
        How vortices are found and tracked.
    processes
        That share out the planes; the result does not depend on their number.
    quiet
        Whether no bar of progress is shown.

    Returns
    -------
    pandas.DataFrame
        One row per vortex and instant, columns `COLUMNS`. `lifetime` is the time from a track's
        first to its last detection; instants without one between are `bridged`: linear in time.

    Raises
    ------
    ValueError
        Where the series has no usable vector.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(-0.05, 0.051, 0.002), np.arange(-0.04, 0.041, 0.002))
    >>> r2 = x**2 + y**2 + 1e-12
    >>> swirl = 0.006 / (2 * np.pi * r2) * (1 - np.exp(-r2 / 0.01**2))
    >>> u, v = (np.stack([f] * 3) for f in (-swirl * y, swirl * x))
    >>> series = piv.make_plane(x[0], y[:, 0], u, v, time=np.arange(3) * 0.01)
    >>> piv.tabulate_vortices(series)["track"].nunique()
    1
    """
    tracker = Tracker(tracking)
    if processes < 1:
        raise ValueError(f"threads must be at least 1, got {processes}")
    rows, times = [], list[float]()
    empty = True
    for plane, vortices in _planes_with_vortices(series, settings, processes, quiet):
        empty &= not usable(plane).any()
        time = float(plane["time"]) if "time" in plane.coords else None
        times.append(0.0 if time is None else time)
        if absent(plane):
            tracker.skip()
            continue
        tracks = tracker.update(0.0 if time is None else time, vortices, fastest(plane))
        for vortex, track in zip(vortices, tracks, strict=True):
            place = place_at_tip(vortex.x, vortex.y, plane)
            rows.append(
                {"time": time, "track": track, "bridged": 0}
                | asdict(vortex)
                | {"at_edge": int(vortex.at_edge)}
                | (place._asdict() if place else {})
            )
    if empty:
        raise ValueError("there is no usable vector to find vortices in")
    table = pd.DataFrame(rows, columns=[c for c in COLUMNS if c != "lifetime"])
    if len(table) and "time" in series.coords:
        table = pd.concat([_bridged(rows, times) for _, rows in table.groupby("track")])
        table = table.sort_values(["time", "track"], ignore_index=True)
    span = table.groupby("track")["time"].agg(lambda t: t.max() - t.min()) if len(table) else None
    table["lifetime"] = table["track"].map(span) if span is not None else []
    table["finger"] = table["finger"].astype("Int64")
    return table


def fastest(plane: xr.Dataset) -> float:
    """Largest speed of a plane's usable vectors, in its length over its time; inf if not known.

    Vectors in px are displacements over the time between two exposures. Where the file counts
    frames, that time is known of the pairing of neighbours alone.
    """
    length, velocity = units_of(plane)
    known, apart = usable(plane), 1.0
    if velocity != f"{length}/s":
        made = json.loads(plane.attrs.get("settings", "{}"))
        neighbours = 1 + made.get("skip", 0) if made.get("pairing") == PAIRINGS[0] else np.nan
        in_seconds = "time" in plane.coords and plane["time"].attrs.get("units") == "s"
        apart = float(plane.attrs.get("interval", np.nan)) if in_seconds else neighbours
    if not (known.any() and np.isfinite(apart)):
        return float("inf")
    return float(np.nanmax(np.where(known, np.hypot(plane["u"], plane["v"]), np.nan))) / apart


def _bridged(track: pd.DataFrame, times: list[float]) -> pd.DataFrame:
    """The rows of a track, and between them one for each of the `times` at which it was missed."""
    inside = [t for t in times if track["time"].iloc[0] <= t <= track["time"].iloc[-1]]
    if len(inside) == len(track):
        return track
    whole = track.set_index("time").reindex(pd.Index(inside, name="time"))
    numbers = whole.select_dtypes("number").columns
    gap = whole["track"].isna()
    between = whole[numbers].interpolate("index", limit_area="inside").where(gap, whole[numbers])
    whole[numbers] = between
    words = whole.columns.difference(numbers)
    whole[words] = whole[words].ffill()
    return whole.assign(bridged=gap.astype(int), finger=whole["finger"].round()).reset_index()


def _planes_with_vortices(
    series: xr.Dataset, settings: VortexSettings | None, processes: int, quiet: bool
) -> Iterator[tuple[xr.Dataset, list[Vortex]]]:
    """Each plane of the series, in order, with its vortices."""
    series = series[[name for name in USED if name in series]]
    single = "time" not in series["u"].dims
    planes = (
        iter([series.load()])
        if single
        else map(Planes(series).__getitem__, range(series.sizes["time"]))
    )
    count = 1 if single else series.sizes["time"]
    bar = iter(
        tqdm(_checked(planes), total=count, unit="plane", desc="vortices", disable=quiet or None)
    )
    # the first in this process: what it loads, its workers have
    for plane in bar if processes <= 1 else islice(bar, 1):
        yield plane, find_vortices(plane, settings)
    if processes <= 1 or count <= 1:
        return
    with worker_pool(processes, forked=True) as pool:
        waiting: deque[tuple[xr.Dataset, Future[list[Vortex]]]] = deque()
        for plane in bar:
            waiting.append((plane, pool.submit(find_vortices, plane, settings)))
            # enough to keep all busy, few enough to keep memory flat
            if len(waiting) > 2 * processes:
                plane, future = waiting.popleft()
                yield plane, future.result()
        for plane, future in waiting:
            yield plane, future.result()


def _checked(planes: Iterator[xr.Dataset]) -> Iterator[xr.Dataset]:
    for plane in planes:
        check_vectors(plane)
        yield plane
