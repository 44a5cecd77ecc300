"""What the slider is linked to, the vortex's way, and the same over several levels."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import FORCES
from pipeline.runs.run import open_run
from piv.files.errors import StageError
from postprocess.draw import series as draw_series
from postprocess.draw.flow import EDGES
from postprocess.draw.series import Curve, Panels, over_time
from postprocess.draw.style import CFD, FIRST, PIV, SECOND, WIDTH
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import REST
from postprocess.report.flow_figures import Flow
from postprocess.report.picture_index import Album
from postprocess.words import minus

_LEVELS = ("draft", "coarse", "medium", "fine", "reference")
_TONES = ("#9ecae9", "#4d9bd0", CFD, "#0b3c6d", FIRST)  # light to dark as the grid is refined


def timeline(album: Album, flow: Flow) -> None:
    """Motion, circulation, force and agreement over time, with their values at each instant."""
    files = flow.files
    series = pd.read_csv(files.out / "comparison.csv")
    panels = _motion(flow)
    if flow.dominant:
        panels.append(("circulation,\ncm²/s", draw_series.circulations(flow.dominant)))
    panels.append(("force of the\nwater, mN", _forces(files.out / "run" / "forces.csv")))
    for path in sorted((files.out / "run").glob("forces_obstacle_*.csv")):
        number = path.stem.rpartition("_")[2]
        panels.append((f"force on\nobstacle {number}, mN", _forces(path)))
    if "velocity_rms_difference" in series:
        strays = series["velocity_rms_difference"].to_numpy() / flow.scale * 100
        panels.append(("PIV less CFD,\n% of tip speed", [Curve(series["time"], strays, "", PIV)]))
    texts = [_values(panels, time) for time in flow.film_times()]
    alt = "Motion, circulation of the tip vortex, force and difference of PIV and CFD over time."
    not_judged = "What lies outside it, or has a band (95 %) of more than ±10 %, is not judged. "
    good = "Good: in it the two curves of the circulation lie on each other."
    caption = f"Shaded: what is compared. {not_judged * (flow.clock.gap is None)}{good}"
    if "piv" not in flow.planes:
        caption = "Shaded: the middle of the stroke, over which the page averages."
    x0, x1, y0, y1 = flow.region()
    beside = (WIDTH - EDGES) * (y1 - y0) / (x1 - x0) + 1.2  # as high as the slider's pictures
    height = float(np.clip(max(beside, 1.15 * len(panels)), 4.8, 7.5))
    figure = over_time(panels, height, middle=flow.judged)
    album.add(figure, "timeline.svg", "timeline", alt, caption, texts=texts)


def _motion(flow: Flow) -> Panels:
    """What drives the flow: pressure and bend, or of a rigid body its path or turn."""
    kinematics, plane = (
        read_kinematics(flow.files.numbers.motion_folder / "kinematics.h5"),
        flow.planes["cfd"],
    )
    clock, drive = kinematics.law.x, kinematics.data["pressure"].values
    turn = np.degrees(plane["bend"].values[:, 0])
    if flow.files.numbers.body is None:
        return [
            ("pressure,\nkPa", [Curve(clock, drive / 1e3)]),
            ("bend, °", [Curve(plane["time"].values, turn)]),
        ]
    turns = bool(np.ptp(turn) > REST)
    shown = (np.degrees(drive), "turn, °") if turns else (drive * 1e3, "distance, mm")
    return [(shown[1], [Curve(clock, shown[0])])]


def series(flow: Flow) -> pd.DataFrame:
    """What the page draws over time, as one table at the instants of the sheet, in SI and degrees.

    Circulations are empty where the tip vortex is not followed; of a pinch by finger.
    """
    files, plane = flow.files, flow.planes["cfd"]
    time = plane["time"].values
    table = {"time_s": time}
    kinematics = read_kinematics(files.numbers.motion_folder / "kinematics.h5")
    if files.numbers.body is None:
        pressure = kinematics.data["pressure"].values
        table["pressure_Pa"] = np.interp(time, kinematics.law.x, pressure)
    table["bend_deg"] = np.degrees(plane["bend"].values[:, 0])
    table |= {f"tip_{axis}_m": plane["tip"].values[:, 0, k] for k, axis in enumerate("xy")}
    forces = FORCES.read(files.out / "run" / "forces.csv")
    for axis in "xyz":
        table[f"force_{axis}_N"] = np.interp(time, forces["time"], forces[f"f{axis}"])
    for source, tracks in flow.dominant.items():
        for finger, track in enumerate(tracks):
            name = f"circulation_{source}{f'_{finger}' * (len(tracks) > 1)}_m2_per_s"
            values = track["circulation"].astype(float)
            table[name] = np.interp(time, track["time"], values, np.nan, np.nan)
    return pd.DataFrame(table)


def _forces(path: Path) -> list[Curve]:
    table = FORCES.read(path)
    time = table["time"].to_numpy()
    return [
        Curve(time, table[f"f{axis}"].to_numpy() * 1e3, f"along {axis}", colour)
        for axis, colour in (("x", FIRST), ("y", SECOND))
    ]


def _values(panels: Panels, time: float) -> str:
    """All curves at an instant (s) as text."""
    parts = []
    for label, curves in panels:
        name, unit = label.replace("\n", " ").rsplit(", ", 1)
        known = [
            (curve.label, float(np.interp(time, curve.time, curve.values, np.nan, np.nan)))
            for curve in curves
        ]
        texts = [f"{text} {minus(f'{v:.3g}')}".strip() for text, v in known if np.isfinite(v)]
        if texts:
            parts.append(f"{name} {', '.join(texts)}{'' if unit == '°' else ' '}{unit}")
    return "; ".join(parts)


def vortex_figures(album: Album, flow: Flow) -> None:
    """The way of the tip vortices, and circulation and force of the levels that were run."""
    files, middle = flow.files, flow.judged
    if flow.dominant:
        alt = "Paths of the vortex centre and of the finger's tip over the finger's outline."
        caption = "The finger at the first, middle and last instant."
        if "piv" in flow.planes:
            caption += (
                " Good: the paths of CFD and PIV cover each other; bars hold 95 % where they are"
                " compared."
            )
        figure = draw_series.paths(flow.dominant, flow.planes["cfd"], middle)
        album.add(figure, "paths.svg", "vortex", alt, caption)
    if files.out.resolve() != (files.scene_folder / "out" / files.level).resolve():
        return  # a variation or a coupled run: other levels are of another motion or scene
    circulation, force = [], []
    for level, tone in zip(_LEVELS, _TONES, strict=True):
        out = files.out if level == files.level else _made(files, level)
        if out is None:
            continue
        series, forces = pd.read_csv(out / "comparison.csv"), FORCES.read(out / "run/forces.csv")
        if "circulation_cfd" in series:
            values = {n: series[n].to_numpy() * 1e4 for n in series if n.startswith("circulation")}
            std = values.get("circulation_std_cfd")
            band = None if std is None else draw_series.BAND * std
            time = series["time"].to_numpy()
            circulation.append(Curve(time, values["circulation_cfd"], level, tone, band=band))
        size = np.hypot(forces["fx"], forces["fy"]).to_numpy() * 1e3
        force.append(Curve(forces["time"].to_numpy(), size, level, tone))
    if len(force) < 2:
        return
    alt = "Circulation of the tip vortex and force on the finger over time, of each level."
    caption = (
        "The same scene on finer and finer grids (darker). Good: the curves close up towards the"
        " finest; what is left between the last two is the grid's error."
    )
    panels = [("circulation,\ncm²/s", circulation), ("size of the\nforce, mN", force)]
    figure = over_time([panel for panel in panels if panel[1]], middle=middle)
    album.add(figure, "levels.svg", "vortex", alt, caption)


def _made(files: StageFiles, level: str) -> Path | None:
    """Folder of another level's results; None where they are not those of today's scene."""
    if not (files.scene_folder / "out" / level).exists():
        return None
    try:
        run = open_run(files.scene_folder, level)
    except StageError:
        return None  # the scene has no such level
    stale = any(run.why_stale(stage) for stage in ("solve", "sheet", "vortices_cfd", "compare"))
    return None if stale else run.out
