"""The report's pictures of a pinch: its pair of vortices, the flow between the fingers, the closing, the single finger beside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import read_kinematics
from postprocess.compare.pinch_summary import APPROACH
from postprocess.draw import animation
from postprocess.draw import flow as draw_flow
from postprocess.draw import pinch as draw_pinch
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.pair_integrals import DORSAL, LATE, VENTRAL, pair_of, vortex_of
from postprocess.evidence.time_windows import Clock, gap_reached
from postprocess.evidence.vortex_pairs import broken, of_finger
from postprocess.report.picture_index import Album
from postprocess.report.pinch_wording import OF_GAP, TO

APPROACHING = 0.010  # m: gap at which the dorsal pair is shown


def pinch_figures(
    album: Album,
    out: Path,
    plane: xr.Dataset,
    clock: Clock,
    numbers: dict[str, Any],
    single: dict[str, pd.DataFrame],
    absent: str,
    scale: float,
) -> None:
    """Draw the section "pinch" from the comparison's tables in `out`; `numbers` as `pinch_summary` gives them.

    `single`: vortices of the single finger by source; `absent`: why there are none; `scale`: velocity scale, m/s.
    """
    sources = [s for s in ("cfd", "piv") if (out / f"pairs_{s}.csv").exists()]
    pairs = {
        s: pd.read_csv(out / f"pairs_{s}.csv") for s in sources
    }  # nearer, the fitted cores overlap
    pairs = {
        s: table[clock.gap_at(table["time"].to_numpy()) >= APPROACH[1]]
        for s, table in pairs.items()
    }
    lines = {s: pd.read_csv(out / f"centreline_{s}.csv") for s in sources}
    integrals = {s: pd.read_csv(out / f"integrals_{s}.csv") for s in sources}
    halves = {s: pd.read_csv(out / f"halves_{s}.csv") for s in sources}
    met = numbers["contact_time"]
    both_pairs(album, plane, integrals["cfd"], clock, scale)
    alt = "Circulation of both pairs and of half the plane, the impulse of half the plane, and the jet below the tips, over time."
    caption = "By integrals of the vorticity, which hold where cores overlap across the plane between the fingers."
    album.add(draw_pinch.integrals(integrals, halves, met), "integrals.svg", "pinch", alt, caption)
    alt = f"Imbalance of circulation, mirror distance and place of the two tip vortices over time, to {TO} mm of gap."
    album.add(draw_pinch.pair(pairs), "pair.svg", "pinch", alt, format_pair(numbers))
    tips = plane["tip"].values[..., 1].mean(axis=1)
    alt = "Height of the line between the fingers at which the flow parts into up and down, and the speeds of both streams."
    caption = (
        "No line is drawn where one of the two streams is slower than 2 % of the tips' peak speed."
    )
    figure = draw_pinch.centreline(lines, clock.time, tips, met)
    album.add(figure, "centreline.svg", "pinch", alt, caption)
    gap = clock.gap_at(clock.time)
    free = free_gap(out / "kinematics.h5", clock.time)
    figure = draw_pinch.closing(clock.time, gap, free, lines["cfd"], met)
    alt = "Gap, closing speed, pressure between the tips and jet speed over time."
    caption = format_closing(numbers, clock.time, free) + (
        "" if single else f" Not shown: {absent}."
    )
    album.add(figure, "closing.svg", "pinch", alt, caption)
    if not single:
        return
    beside = {
        s: broken(_with_bend(of_finger(table, 0), clock), "track") for s, table in pairs.items()
    }
    alone = {s: _dominant(table) for s, table in single.items()}
    limits = (0.0, float(np.degrees(clock.progress.max())) + 2)
    alt = "Place of the tip vortex as seen from the tip over the bend angle, of the pinch and of the single finger."
    caption = "Left finger of the pinch. Lower panel: above zero is the dorsal side."
    figure = draw_pinch.beside_single(beside, alone, limits)
    album.add(figure, "beside_single.svg", "pinch", alt, caption)


def both_pairs(
    album: Album, plane: xr.Dataset, integrals: pd.DataFrame, clock: Clock, scale: float
) -> None:
    """Two pictures of the CFD's flow: the dorsal pair while the fingers approach, and the ventral pair at its strongest."""
    approaching = gap_reached(clock, max(APPROACHING, float(clock.gaps()[1].min())))
    ventral = pair_of(integrals, *VENTRAL)
    instants = {"dorsal": approaching}
    met = clock.met()
    if met is not None:
        ventral = ventral[ventral["time"] <= met + LATE]
    if len(ventral):
        instants["ventral"] = float(ventral.loc[ventral["circulation"].idxmax(), "time"])
    pairs = {"dorsal": DORSAL, "ventral": VENTRAL}
    limit = draw_flow.vorticity_limit(plane, np.array(list(instants.values())))
    for name, time in instants.items():
        marked = [
            vortex_of(integrals, *pair, finger) for pair in pairs.values() for finger in (0, 1)
        ]
        shown = {"cfd": [vortex for vortex in marked if len(vortex)]}
        figure, show = draw_flow.flow_figure({"cfd": plane}, shown, scale, limit, dpi=140)
        show(time)
        animation.write_picture(animation.pixels(figure), album.folder / f"pair_{name}.png")
        gap = f"{clock.gap_at(np.array([time]))[0] * 1e3:.1f} mm of gap"
        text = f"The {name} pair, {'flow between it downward' if name == 'dorsal' else 'flow between it upward'}, {time:.3f} s, {gap}"
        circles = "Circles: vortices by integrals, radius as the core's."
        album.add(
            None,
            f"pair_{name}.png",
            "pinch",
            f"Velocity vectors and vorticity of the CFD. {text}.",
            f"{text}. {circles}",
        )


def free_gap(path: Path, time: np.ndarray) -> np.ndarray:
    """Gap (m) over `time` that the chambers' pressure alone would give, NaN once the shapes of the pinch end."""
    kinematics = read_kinematics(path)
    free = kinematics.values("free_pressure")
    if free is None:
        return np.full(time.size, np.nan)
    pressure = np.interp(time, kinematics.law.x, free)
    known, gaps = kinematics.data["shape_parameter"].values, kinematics.data["shape_gap"].values
    passed = np.maximum.accumulate(pressure > known[-1])
    return np.where(passed, np.nan, np.interp(pressure, known, gaps))


def format_closing(numbers: dict[str, Any], time: np.ndarray, free: np.ndarray) -> str:
    """What the closing law did, in sentences."""
    cfd = numbers["cfd"]
    if numbers["contact_time"] is None:
        return f"The tips do not meet: the least gap to the plane is {numbers['least_gap'] * 1e3:.2f} mm."
    text = (
        f"The tips stop {numbers['residual_gap'] * 1e3:g} mm before the plane, so {2e3 * numbers['residual_gap']:g} mm"
        f" between them stay open; they are within 0.1 mm of that at {numbers['contact_time']:.3f} s."
    )
    known = np.flatnonzero(np.isfinite(free))
    if 1 < known.size < time.size:
        end = int(known[-1])
        speed = (free[end - 1] - free[end]) / (time[end] - time[end - 1])
        text += f" Unhindered they would get there at {time[end]:.3f} s with {speed:.2f} m/s each."
    text += (
        f" The jet is fastest, {cfd['jet_peak']:.2f} m/s, at {cfd['jet_peak_time']:.3f} s with"
        f" {cfd['jet_peak_gap'] * 1e3:.2f} mm of gap"
    )
    if cfd.get("pressure_gap_peak") is not None:
        text += (
            f"; the pressure between the tips reaches {cfd['pressure_gap_peak']:.0f} Pa at"
            f" {cfd['pressure_gap_peak_time']:.3f} s ({cfd['pressure_gap_peak_gap'] * 1e3:.2f} mm)"
        )
    return text + "."


def format_pair(numbers: dict[str, Any]) -> str:
    parts = []
    for source, name in (("cfd", "CFD"), ("piv", "PIV")):
        rows = numbers.get(source)
        if rows and rows["imbalance_rms"] is not None:
            parts.append(
                f"{name}: imbalance {rows['imbalance_rms'] * 100:.2g} %, mirror distance"
                f" {rows['mirror_distance_rms'] * 1e3:.2g} mm"
            )
    return f"RMS from {OF_GAP}: {'; '.join(parts)}." if parts else ""


def _with_bend(table: pd.DataFrame, clock: Clock) -> pd.DataFrame:
    return table.assign(bend=np.interp(table["time"], clock.time, clock.progress))


def _dominant(table: pd.DataFrame) -> pd.DataFrame:
    span = (float(table["time"].min()), float(table["time"].max()))
    return tracks.dominant_track(table, 0, span, "single finger")
