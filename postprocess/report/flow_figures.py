"""Pictures of the flow: vectors at some instants, the film and its frames, the tip vortices."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from piv.plots.film import write_film
from postprocess.draw import animation
from postprocess.draw import flow as draw_flow
from postprocess.draw import series as draw_series
from postprocess.draw.series import Tracks
from postprocess.draw.style import NAMES
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence import vortex_pairs as pairs
from postprocess.evidence.strokes import stroke_window
from postprocess.evidence.time_windows import Clock
from postprocess.report.picture_index import Album
from postprocess.words import quantity

FRAMES = 61  # in slider and film
_INSTANTS = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the stroke's bend; the last instant is added
_AFTER_CONTACT = (0.0, 0.05, 0.15)  # s: instants shown of a pinch
_FILM_HZ = 12.0


def tip_vortices(
    plane: xr.Dataset, tables: dict[str, pd.DataFrame], middle: tuple[float, float]
) -> Tracks:
    """By source each finger's vortex: the dominant one of mid-stroke, or of a pinch the pair."""
    if plane.sizes["finger"] < 2:
        dominant = tracks.dominant_tracks(tables, 0, middle)
        return {source: [track] for source, track in dominant.items()}
    paired = {source: pairs.pair_vortices(table) for source, table in tables.items()}
    return {
        s: [pairs.of_finger(p, finger) for finger in (0, 1)] for s, p in paired.items() if len(p)
    }


class Flow(NamedTuple):
    """What is drawn, by source: plane series, all vortices, and the vortices that are judged."""

    planes: dict[str, xr.Dataset]
    tables: dict[str, pd.DataFrame]
    dominant: Tracks
    scale: float  # m/s
    clock: Clock

    def instants(self) -> np.ndarray:
        """Times of the pictures, s: through the stroke, of a pinch from contact on, the last."""
        clock, last = self.clock, min(float(p["time"][-1]) for p in self.planes.values())
        at = [stroke_window(clock.time, clock.progress, (part, 0.999))[0] for part in _INSTANTS]
        met = clock.met() if clock.gap is not None else None
        if met is not None:
            later = [t for after in _AFTER_CONTACT if (t := met + after) < last - 0.01]
            at = [t for t in at if t < met - 0.01] + later
        return np.array([*at, last])

    def film_times(self) -> np.ndarray:
        """Times of film and slider, s: no more of them than there are fields."""
        times = [p["time"].values for p in self.planes.values()]
        first, last = max(float(t[0]) for t in times), min(float(t[-1]) for t in times)
        return np.linspace(first, last, min(FRAMES, *(t.size for t in times)))

    def words(self) -> tuple[str, str]:
        """The body and the sources, for alternative texts."""
        body = "finger" if len(next(iter(self.dominant.values()), [0])) == 1 else "fingers"
        return body, " and ".join(NAMES[source] for source in self.planes)

    def figure(self, **more: float) -> tuple[Figure, Callable[[float], None]]:
        """As `flow_figure`."""
        limit = draw_flow.vorticity_limit(self.planes["cfd"], self.instants())
        return draw_flow.flow_figure(
            self.planes, self.dominant, self.scale, limit, tables=self.tables, **more
        )


def instant_figures(album: Album, flow: Flow) -> None:
    """Vectors at some instants as pictures."""
    body, sources = flow.words()
    figure, show = flow.figure(dpi=170, panel=3.5)
    for number, time in enumerate(flow.instants()):
        show(time)
        instant = draw_flow.format_instant(flow.planes["cfd"], time)
        vortices = " ".join(
            _format_vortices(source, fingers, time) for source, fingers in flow.dominant.items()
        )
        alt = f"Velocity vectors around the black {body} at {instant}, {sources}. {vortices}"
        # not `save`, which would lay the figure out anew
        animation.write_picture(animation.pixels(figure), album.folder / f"flow_{number}.png")
        album.add(None, f"flow_{number}.png", "flow", alt, instant)


def film_frames(flow: Flow, times: np.ndarray) -> list[np.ndarray]:
    """Frames of film and slider at some instants (s)."""
    figure, show = flow.figure(dpi=88)
    images = []
    for time in times:
        show(time)
        images.append(animation.pixels(figure))
    return images


def film(album: Album, flow: Flow, images: Iterable[np.ndarray]) -> None:
    """The stroke as a film and as the frames of the slider, from the frames at `film_times`."""
    times, (body, sources) = flow.film_times(), flow.words()
    first, last = times[0], times[-1]
    frames = animation.write_frames(images, album.folder / "frames")
    write_film(frames, album.folder / "stroke.mp4", _FILM_HZ)
    caption = f"One instant, {first:g} s: there is a single field."
    if last > first:
        slower = (len(times) - 1) / _FILM_HZ / (last - first)
        caption = f"The whole stroke, slowed down {slower:.0f} times."
    alt = f"Film of the flow around the bending {body}, {sources}"
    album.add(None, "stroke.mp4", "film", alt, caption)
    album.add(None, "frames", "slider", f"Flow around the {body}, {sources}", times=times.tolist())


def _format_vortices(source: str, fingers: list[pd.DataFrame], time: float) -> str:
    sentences = []
    for finger, track in enumerate(fingers):
        name = draw_series.finger_name(source, finger, len(fingers))
        if not track["time"].iloc[0] <= time <= track["time"].iloc[-1]:
            sentences.append(f"{name}: no tip vortex yet or any more.")
            continue
        now = track.iloc[int(np.argmin(np.abs(track["time"].to_numpy() - time)))]
        sense = "counter-clockwise" if now["circulation"] > 0 else "clockwise"
        strength = quantity(abs(now["circulation"]), "m²/s")
        side = now["side"] or "undecided"
        sentences.append(f"{name}: tip vortex {sense} on the {side} side, {strength}.")
    return " ".join(sentences)


def vortex_figures(
    album: Album, series: pd.DataFrame, flow: Flow, middle: tuple[float, float]
) -> None:
    """Circulation and paths of the tip vortices, and the agreement of PIV and CFD over time.

    `series`: comparison.csv; `middle`: of the stroke, s.
    """
    dominant = flow.dominant
    if dominant:
        bands = ", ".join(NAMES[s] for s in draw_series.has_band(dominant))
        caption = (
            f"Bands: 95 % of {bands}."
            if bands
            else "The tables carry no uncertainty, so no band is drawn."
        )
        alt = "Circulation and radius of the tip vortex over time, CFD and PIV where run."
        figure = draw_series.circulation(dominant, middle)
        album.add(figure, "circulation.svg", "vortex", alt, caption)
        alt = "Paths of the vortex centre and of the finger's tip over the finger's outline."
        caption = "Outline at the first, middle and last instant."
        figure = draw_series.paths(dominant, flow.planes["cfd"], middle)
        album.add(figure, "paths.svg", "vortex", alt, caption)
    if "velocity_rms_difference" in series:
        alt = (
            "RMS velocity difference, correlation and distance of vortex centres between PIV and"
            " CFD over time."
        )
        caption = (
            "No correlation is given while the water is at rest."
            " The middle of the stroke is shaded."
        )
        figure = draw_series.agreement(series, flow.scale, middle)
        album.add(figure, "agreement.svg", "vortex", alt, caption)
