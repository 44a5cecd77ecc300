"""Pictures of the flow: vectors at some instants, the film and its frames, the tip vortices."""

import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray

from postprocess.draw import animation
from postprocess.draw import flow as draw_flow
from postprocess.draw.flow import EDGES
from postprocess.draw.series import Tracks
from postprocess.draw.style import NAMES, WIDTH
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence import vortex_pairs as pairs
from postprocess.evidence.fields import difference
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import MIDDLE, stroke_window
from postprocess.evidence.time_windows import Clock, Window, interval
from postprocess.report.picture_index import Album

FRAMES = 51  # of the slider
_INSTANTS = (0.5, 0.8)  # of the stroke's bend; the last instant is added
_AFTER_CONTACT = (0.0, 0.15)  # s: instants shown of a pinch


def tip_vortices(
    plane: xr.Dataset, tables: dict[str, pd.DataFrame], clock: Clock, judged: tuple[float, float]
) -> Tracks:
    """By source each finger's vortex: the dominant one of each stroke, or of a pinch the pair.

    `judged`: the instants (s) over which the dominant one of a single stroke is the strongest.
    """
    if plane.sizes["finger"] < 2:
        known = {}
        for k, start in enumerate(clock.starts if len(clock.starts) > 1 else ()):
            with suppress(ValueError):  # it begins after the end, or nothing moves
                known[start] = interval(Window("part", MIDDLE, k), clock)
        known = known or {-np.inf: judged}
        edges = [-np.inf, *[*known][1:], np.inf]  # each stroke's vortex until the next stroke
        found: Tracks = {}
        for window, first, last in zip(known.values(), edges[:-1], edges[1:], strict=True):
            for source, rows in tracks.dominant_tracks(tables, 0, window).items():
                during = rows[rows["time"].between(first, last, inclusive="left")]
                found.setdefault(source, []).append(during)
        return {source: [pd.concat(rows, ignore_index=True)] for source, rows in found.items()}
    window = clock.closing()
    paired = {source: pairs.pair_vortices(table, window) for source, table in tables.items()}
    return {
        s: [pairs.of_finger(p, finger) for finger in (0, 1)] for s, p in paired.items() if len(p)
    }


class Flow(NamedTuple):
    """What is drawn, by source: plane series, all vortices, and the vortices that are judged.

    `judged`: first and last instant (s) of what is compared.
    """

    files: StageFiles
    planes: dict[str, xr.Dataset]
    tables: dict[str, pd.DataFrame]
    dominant: Tracks
    scale: float  # m/s
    clock: Clock
    judged: tuple[float, float]

    def instants(self) -> ndarray:
        """Times of the pictures, s: through the stroke, of a pinch from contact on, the last.

        Those of the source that has the fewest.
        """
        clock, last = self.clock, min(float(p["time"][-1]) for p in self.planes.values())
        at = [stroke_window(clock.time, clock.progress, (part, 0.999))[0] for part in _INSTANTS]
        met = clock.met() if clock.gap is not None else None
        if met is not None:
            later = [t for after in _AFTER_CONTACT if (t := met + after) < last - 0.01]
            at = [t for t in at if t < met - 0.01] + later
        times = min((p["time"].values for p in self.planes.values()), key=len)
        return times[[int(np.abs(times - t).argmin()) for t in (*at, last)]]

    def film_times(self) -> ndarray:
        """Times of film and slider, s: no more of them than there are fields."""
        times = [p["time"].values for p in self.planes.values()]
        first, last = max(float(t[0]) for t in times), min(float(t[-1]) for t in times)
        return np.linspace(first, last, min(FRAMES, *(t.size for t in times)))

    def words(self) -> tuple[str, str]:
        """The body and the sources, for alternative texts."""
        body = "finger" if len(next(iter(self.dominant.values()), [0])) == 1 else "fingers"
        return body, " and ".join(NAMES[source] for source in self.planes)

    def region(self) -> tuple[float, float, float, float]:
        """x0, x1, y0, y1 (m) of what every picture shows."""
        return draw_flow.view_limits(self.planes, self.dominant)

    def images(self, planes: dict[str, xr.Dataset], **more: Any) -> Callable[[float], ndarray]:
        """As `flow_figure`, in this region and with one scale of colours for all."""
        limit = draw_flow.vorticity_limit(self.planes["cfd"], self.instants())
        outlines = json.loads(self.planes["cfd"].attrs.get("fixed_bodies", "[]"))
        options: dict[str, Any] = {"tables": self.tables, "fixed": [*map(np.array, outlines)]}
        return draw_flow.flow_figure(
            planes, self.dominant, self.scale, limit, self.region(), **options, **more
        )


def instant_figures(album: Album, flow: Flow) -> None:
    """Vectors of all sources at some instants as pictures."""
    body, sources = flow.words()
    x0, x1, y0, y1 = flow.region()
    rows = len(flow.planes) if x1 - x0 > y1 - y0 else 1  # side by side a wide region is small
    panel = (WIDTH - EDGES) * rows / len(flow.planes)
    show = flow.images(flow.planes, dpi=album.dpi, panel=panel, rows=rows)
    for number, time in enumerate(flow.instants()):
        instant = draw_flow.format_instant(flow.planes["cfd"], time)
        alt = f"Velocity vectors around the {body} at {instant}, {sources}."
        more = {"time": float(time), "layout": "beside" if rows == 1 else "stacked"}
        album.add(show(time), f"flow_{number}.webp", "flow", alt, instant, **more)


def slider_frames(album: Album, flow: Flow, source: str) -> None:
    """One source, or the "difference" of both, at the instants of the slider."""
    times, (body, _) = flow.film_times(), flow.words()
    planes = flow.planes
    plane = planes.get(source) or difference(planes["cfd"], planes["piv"], times)
    show = flow.images({source: plane}, panel=WIDTH - EDGES, dpi=100)
    animation.write_frames(map(show, times), album.folder / source)
    alt, name = f"Flow around the {body}, {NAMES[source]}", NAMES[source]
    album.add(None, source, "slider", alt, name, times=times.tolist())
