"""The report's pictures of a pinch: both pairs of vortices, and the closing."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.formats.kinematics import read_kinematics
from postprocess.draw import flow as draw_flow
from postprocess.draw import pinch as draw_pinch
from postprocess.draw.flow import EDGES
from postprocess.draw.style import WIDTH
from postprocess.evidence.pair_integrals import DORSAL, LATE, VENTRAL, pair_of, vortex_of
from postprocess.evidence.time_windows import gap_reached
from postprocess.report.flow_figures import Flow
from postprocess.report.picture_index import Album
from postprocess.words import quantity

_APPROACHING = 0.010  # m: gap at which the dorsal pair is shown


def pinch_figures(album: Album, flow: Flow) -> None:
    """Draw the section "pinch" from the comparison's tables."""
    clock, met, out = flow.clock, flow.clock.met(), flow.files.out
    motion = flow.files.numbers.motion_folder
    lines, integrals = (
        {s: pd.read_csv(out / f"{name}_{s}.csv") for s in flow.planes}
        for name in ("centreline", "integrals")
    )
    _both_pairs(album, flow, integrals["cfd"])
    free, gap = _free_gap(motion / "kinematics.h5", clock.time), clock.gap_at(clock.time)
    figure = draw_pinch.closing(clock.time, gap, free, integrals, lines, met)
    alt = "Gap, circulation of both pairs, flow and pressure between the tips over time."
    caption = (
        "Dotted: contact. Good: the curves of CFD and PIV lie on each other; PIV's windows miss"
        " the upward flow in a gap that is narrower than they are."
        " Vortices: vorticity within half a tip's width of their centres."
        f" {_format_closing(met, clock.time, free)}"
    )
    album.add(figure, "closing.svg", "pinch", alt, caption)


def _both_pairs(album: Album, flow: Flow, integrals: pd.DataFrame) -> None:
    """The CFD's dorsal pair while the fingers approach, and the ventral pair at its strongest."""
    clock, plane = flow.clock, flow.planes["cfd"]
    approaching = gap_reached(clock, max(_APPROACHING, float(clock.gaps()[1].min())))
    ventral, met = pair_of(integrals, *VENTRAL), clock.met()
    instants = {"dorsal": approaching}
    if met is not None:
        ventral = ventral[ventral["time"] <= met + LATE]
    if len(ventral):
        instants["ventral"] = float(ventral.loc[ventral["circulation"].idxmax(), "time"])
    limit = draw_flow.vorticity_limit(plane, np.array(list(instants.values())))
    marked = [
        vortex_of(integrals, *pair, finger) for pair in (DORSAL, VENTRAL) for finger in (0, 1)
    ]
    shown = {"cfd": [vortex for vortex in marked if len(vortex)]}
    for name, time in instants.items():
        size: dict[str, Any] = {"dpi": album.dpi, "panel": WIDTH - EDGES}
        show = draw_flow.flow_figure(
            {"cfd": plane}, shown, flow.scale, limit, flow.region(), **size
        )
        gap = f"{clock.gap_at(np.array([time]))[0] * 1e3:.1f} mm of gap"
        between = "downward" if name == "dorsal" else "upward"
        text = f"The {name} pair, flow between it {between}, {time:.3f} s, {gap}"
        alt = f"Velocity vectors and vorticity of the CFD. {text}."
        caption = f"{text}. Circles: as wide as the region that turns."
        album.add(show(time), f"pair_{name}.webp", "pinch", alt, caption, time=float(time))


def _free_gap(path: Path, time: ndarray) -> ndarray:
    """Gap (m) over `time` by the chambers' pressure alone, NaN once the pinch's shapes end."""
    kinematics = read_kinematics(path)
    free = kinematics.values("free_pressure")
    if free is None:
        return np.full(time.size, np.nan)
    pressure = np.interp(time, kinematics.law.x, free)
    known, gaps = kinematics.data["shape_parameter"].values, kinematics.data["shape_gap"].values
    passed = np.maximum.accumulate(pressure > known[-1])
    return np.where(passed, np.nan, np.interp(pressure, known, gaps))


def _format_closing(met: float | None, time: ndarray, free: ndarray) -> str:
    """When and how fast the tips would meet without the closing law."""
    known = np.flatnonzero(np.isfinite(free))
    if met is None or not 1 < known.size < time.size:
        return ""
    end = int(known[-1])
    speed = (free[end - 1] - free[end]) / (time[end] - time[end - 1])
    return (
        f"Unhindered the tips would meet at {time[end]:.3f} s with {quantity(speed, 'm/s')} each."
    )
