"""All pictures of the report: figures/*.png|svg, the frames of the slider, the film, and their index figures.json.

Command: python -m postprocess.figures cases/single_finger --level coarse
"""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from piv.film import write_film
from piv.plane import read_plane
from piv.whole_file import write_bytes
from postprocess import animation, draw_flow, draw_mesh, draw_series, pairs, tracks
from postprocess.album import Album
from postprocess.commandline import run_stage
from postprocess.draw_series import Tracks
from postprocess.loading import read_clock
from postprocess.pinch_figures import pinch_figures
from postprocess.stagefiles import (
    StageFiles,
    read_arrays,
    read_json,
    read_stages,
    read_table,
    scene_numbers,
    write_text,
)
from postprocess.strokes import peak_tip_speed, stroke_window, tip_speed
from postprocess.style import NAMES
from postprocess.windows import Clock

INSTANTS = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the stroke's bend; the last instant is added
AFTER_CONTACT = (0.0, 0.05, 0.15)  # s: instants shown of a pinch
DOCS_FEA = Path(__file__).resolve().parent.parent / "docs" / "fea"
STUDIES = {
    "theta": "wedge angles of 0 to 30°",
    "width": "widths of 12, 20 and 28 mm",
    "materials": "three pairs of materials",
}
FRAMES = 61  # in slider and film
FILM_HZ = 12.0
REQUIRED = (
    ("sheet.h5", "sheet"),
    ("vortices_cfd.csv", "vortices"),
    ("comparison.json", "compare"),
    ("comparison.csv", "compare"),
    ("kinematics.h5", "kinematics"),
    ("planform.h5", "mesh"),
    ("sweep.h5", "case"),
    ("mesh_quality.csv", "mesh"),
    ("run/run.json", "run"),
    ("run/forces.csv", "run"),
    ("run/power.csv", "run"),
    ("run/history.csv", "run"),
)
FORCE_COLUMNS = ("time", "fx", "fy", "fx_viscous", "fy_viscous")
POWER_COLUMNS = ("time", "finger_power", "kinetic_energy", "dissipation")
HISTORY_COLUMNS = ("time", "courant_mean", "courant_max", "continuity_local", "continuity_global")
QUALITY_COLUMNS = (
    "leg",
    "bend_deg",
    "max_non_orthogonality_deg",
    "mean_non_orthogonality_deg",
    "max_skewness",
    "min_area_ratio",
)


def make_figures(files: StageFiles) -> list[dict[str, Any]]:
    """Draw everything for one scene and level; returns the index that figures.json holds."""
    for name, stage in REQUIRED:  # before minutes of drawing, not after
        files.required(name, stage)
    comparison = read_json(files.out / "comparison.json")
    start, end = comparison["middle_of_stroke_s"]
    middle = (float(start), float(end))
    planes = {"cfd": read_plane(files.out / "sheet.h5")}
    tables = {"cfd": tracks.read_vortices(files.out / "vortices_cfd.csv")}
    if files.optional("piv.h5") is not None:
        planes["piv"] = read_plane(files.out / "piv.h5")
        tables["piv"] = tracks.read_vortices(files.required("vortices_piv.csv", "vortices"))
    clock = read_clock(files, planes["cfd"])
    dominant = tip_vortices(planes["cfd"], tables, middle)
    album = Album(files.figures)
    _flow(album, planes, dominant, comparison["scale"]["value"], clock)
    _vortex(album, files, planes["cfd"], dominant, middle, comparison["scale"]["value"])
    if planes["cfd"].sizes["finger"] > 1:
        pinch_figures(album, files, planes["cfd"], clock, comparison["summary"]["pinch"])
    _motion(album, files, planes["cfd"])
    _bending(album, files)
    _studies(album)
    _solver(album, files)
    _mesh(album, files, planes["cfd"])
    _camera(album, files, float(np.mean(middle)))
    for plane in planes.values():
        plane.close()
    write_text(files.figures / "figures.json", json.dumps(album.entries, indent=1, default=float))
    return album.entries


def tip_vortices(plane: xr.Dataset, tables: dict[str, pd.DataFrame], middle: tuple[float, float]) -> Tracks:
    """By source, of every finger the vortex that is drawn: the dominant one of the stroke's middle, or of a pinch the paired ones."""
    if plane.sizes["finger"] < 2:
        return {source: [track] for source, track in tracks.dominant_tracks(tables, 0, middle).items()}
    paired = {source: pairs.pair_vortices(table) for source, table in tables.items()}
    return {s: [pairs.of_finger(p, finger) for finger in (0, 1)] for s, p in paired.items() if len(p)}


def _instants(clock: Clock, last: float) -> np.ndarray:
    """When the flow is shown, s: through the stroke, of a pinch at contact and after it, and at the end."""
    at = [stroke_window(clock.time, clock.bend, (part, 0.999))[0] for part in INSTANTS]
    met = clock.met() if clock.gap is not None else None
    if met is not None:
        at = [t for t in at if t < met - 0.01] + [t for a in AFTER_CONTACT if (t := met + a) < last - 0.01]
    return np.array([*at, last])


def _flow(album: Album, planes: dict[str, xr.Dataset], dominant: Tracks, scale: float, clock: Clock) -> None:
    stroke, bends = planes["cfd"]["time"].values, planes["cfd"]["bend"].values[:, 0]
    last = min(float(p["time"][-1]) for p in planes.values())
    first = max(float(p["time"][0]) for p in planes.values())
    instants = _instants(clock, last)
    body = "finger" if len(next(iter(dominant.values()), [0])) == 1 else "fingers"
    limit = draw_flow.vorticity_limit(planes["cfd"], instants)
    sides = " and ".join(NAMES[source] for source in planes)
    figure, show = draw_flow.flow_figure(planes, dominant, scale, limit, dpi=120)
    for number, time in enumerate(instants):
        show(time)
        bend = np.degrees(np.interp(time, stroke, bends))
        told = [_vortex_words(source, fingers, time) for source, fingers in dominant.items()]
        alt = f"Velocity vectors around the black {body} at {time:.3f} s, bent by {bend:.0f} degrees, {sides}. {' '.join(told)}"
        animation.write_picture(
            animation.pixels(figure), album.folder / f"flow_{number}.png"
        )  # no new layout
        album.add(None, f"flow_{number}.png", "flow", alt, f"{time:.3f} s, bent by {bend:.0f}°")
    figure, show = draw_flow.flow_figure(planes, dominant, scale, limit, dpi=88)
    times = np.linspace(first, last, FRAMES)

    def images():
        for time in times:
            show(time)
            yield animation.pixels(figure)

    write_film(
        animation.write_frames(images(), album.folder / "frames"), album.folder / "stroke.mp4", FILM_HZ
    )
    slower = ((FRAMES - 1) / FILM_HZ) / (last - first)
    caption = f"The whole stroke, slowed down {slower:.0f} times."
    album.add(None, "stroke.mp4", "film", f"Film of the flow around the bending {body}, {sides}", caption)
    album.entries.append(
        {
            "file": "frames",
            "section": "slider",
            "alt": f"Flow around the {body}, {sides}",
            "caption": "",
            "times": times.tolist(),
        }
    )


def _vortex_words(source: str, fingers: list[pd.DataFrame], time: float) -> str:
    said = []
    for finger, track in enumerate(fingers):
        name = draw_series.finger_name(source, finger, len(fingers))
        if not track["time"].iloc[0] <= time <= track["time"].iloc[-1]:
            said.append(f"{name}: no tip vortex yet or any more.")
            continue
        now = track.iloc[int(np.argmin(np.abs(track["time"].to_numpy() - time)))]
        sense = "counter-clockwise" if now["circulation"] > 0 else "clockwise"
        strength = abs(now["circulation"]) * 1e4
        said.append(
            f"{name}: tip vortex {sense} on the {now['side'] or 'undecided'} side, {strength:.0f} cm²/s."
        )
    return " ".join(said)


def _vortex(
    album: Album,
    files: StageFiles,
    plane: xr.Dataset,
    dominant: Tracks,
    middle: tuple[float, float],
    scale: float,
) -> None:
    if dominant:
        bands = draw_series.has_band(dominant)
        caption = (
            f"Bands: 95 % of {', '.join(NAMES[s] for s in bands)}."
            if bands
            else "The tables carry no uncertainty, so no band is drawn."
        )
        alt = "Circulation and core radius of the tip vortex over time, CFD and PIV where run."
        album.add(draw_series.circulation(dominant, middle), "circulation.svg", "vortex", alt, caption)
        alt = "Paths of the vortex centre and of the finger's tip over the finger's outline."
        album.add(
            draw_series.paths(dominant, plane, middle),
            "paths.svg",
            "vortex",
            alt,
            "Outline at the first, middle and last instant.",
        )
    series = pd.read_csv(files.out / "comparison.csv")
    if "velocity_rms_difference" in series:
        alt = "RMS velocity difference, correlation and distance of vortex centres between PIV and CFD over time."
        caption = "No correlation is given while the water is at rest. The middle of the stroke is shaded."
        album.add(draw_series.agreement(series, scale, middle), "agreement.svg", "vortex", alt, caption)


def _motion(album: Album, files: StageFiles, plane: xr.Dataset) -> None:
    drive = read_arrays(files.out / "kinematics.h5", ("time", "pressure"))
    times = plane["time"].values
    speed = tip_speed(times, plane["tip"].values)[:, 0]
    figure = draw_series.motion(drive["time"], drive["pressure"], times, plane["bend"].values[:, 0], speed)
    peak, at = peak_tip_speed(times, plane["tip"].values)
    album.add(
        figure,
        "motion.svg",
        "motion",
        "Pressure, bend angle and tip speed over time.",
        f"Peak tip speed {peak:.3f} m/s at {at:.3f} s.",
    )


def _bending(album: Album, files: StageFiles) -> None:
    names = ("state_pressure", "state_bend", "paper_bend")
    states = read_arrays(files.out / "kinematics.h5", names, optional=("state_bend_std",))
    std = states.get("state_bend_std")
    length = scene_numbers(files)["finger"]["length"]
    band = (
        "The band is the standard uncertainty from roof and channel heights, the split of the material's stiffness, the mesh"
        " and ±0.2 kPa (docs/fea.md)."
        if std is not None
        else "These states carry no uncertainty, so no band is drawn."
    )
    album.add(
        draw_series.bending(
            states["state_pressure"], states["state_bend"], std, states["paper_bend"], length
        ),
        "bending.svg",
        "motion",
        "Bending radius over pressure from the states that drive the motion, with the paper's equations.",
        f"R from the states that drive the motion; the paper's equations (1)–(6) dashed. {band}",
    )


def _studies(album: Album) -> None:
    """The actuator's studies as `make fea-studies` left them; they belong to the project, not to one scene."""
    for name, varied in STUDIES.items():
        source = DOCS_FEA / f"{name}.svg"
        if source.exists():
            write_bytes(album.folder / f"fea_{source.name}", source.read_bytes())
            alt = f"Bending radius over pressure for {varied}, from the FEA."
            caption = f"What the FEA gives for {varied}; all numbers and versions in docs/fea/results.md."
            album.add(None, f"fea_{source.name}", "motion", alt, caption)


def _solver(album: Album, files: StageFiles) -> None:
    tables: tuple[tuple[str, str, tuple[str, ...], Callable[[pd.DataFrame], Figure], str, str], ...] = (
        (
            "run/forces.csv",
            "forces",
            FORCE_COLUMNS,
            draw_series.forces,
            "run",
            "Force of the water on the finger over time.",
        ),
        (
            "run/power.csv",
            "power",
            POWER_COLUMNS,
            draw_series.power,
            "run",
            "Power balance over time and its closure error.",
        ),
        (
            "run/history.csv",
            "history",
            HISTORY_COLUMNS,
            draw_series.history,
            "run",
            "Courant number and continuity error over time.",
        ),
        (
            "mesh_quality.csv",
            "mesh_quality",
            QUALITY_COLUMNS,
            draw_series.mesh_quality,
            "mesh",
            "Non-orthogonality, skewness and area ratio over the bend angle.",
        ),
    )
    for file, name, columns, draw, section, alt in tables:
        album.add(draw(read_table(files.out / file, columns)), f"{name}.svg", section, alt)


def _mesh(album: Album, files: StageFiles, plane: xr.Dataset) -> None:
    stages = read_stages(files.out / "planform.h5")
    outline, bend = plane["outline"].values, plane["bend"].values[:, 0]
    low, high = outline.min(axis=(0, 1, 2)) - 0.02, outline.max(axis=(0, 1, 2)) + 0.02
    limits = (low[0], high[0], low[1], high[1])
    end = bend[np.argmax(np.abs(bend - bend[0]))]
    drawn = [_nearest_shape(stages, b) for b in (bend[0], 0.5 * (bend[0] + end), end)]
    shapes = [stage["points"][knot] for stage, knot in drawn]
    at = np.degrees([stage["bend"][knot] for stage, knot in drawn])
    lines = [draw_mesh.edges([stage["triangles"][stage["body"] == 0], stage["quads"]]) for stage, _ in drawn]
    alt = "The planform of the mesh around the finger at the start, middle and end of the stroke."
    album.add(draw_mesh.planform(shapes, at, lines, limits), "planform.png", "mesh", alt)
    scene = scene_numbers(files)
    bodies = outline[int(np.argmin(np.abs(np.degrees(bend) - at[1])))]
    data = files.figures / "view3d.npz"
    content = io.BytesIO()
    np.savez(
        content,
        points=shapes[1],
        lines=lines[1],
        outline=bodies,
        width=scene["finger"]["width"],
        tank=np.array(scene["tank"]["size"]),
    )
    write_bytes(data, content.getbuffer())
    drawn_by = draw_mesh.view_in_space(data, files.figures / "view3d.png")
    data.unlink()
    alt = "The finger and the mesh on the laser sheet inside the tank, seen in space."
    album.add(None, "view3d.png", "mesh", alt, f"Half-way through the stroke (drawn by {drawn_by}).")


def _nearest_shape(stages: list[dict[str, np.ndarray]], bend: float) -> tuple[dict[str, np.ndarray], int]:
    """The stage and its knot whose bend (rad) is nearest."""
    found = [(stage, int(np.argmin(np.abs(stage["bend"] - bend)))) for stage in stages]
    return min(found, key=lambda pair: abs(pair[0]["bend"][pair[1]] - bend))


def _camera(album: Album, files: StageFiles, time: float) -> None:
    path = files.optional("images.h5")
    if path is None:
        return
    with h5py.File(path, "r") as file:
        index = int(np.argmin(np.abs(file["time"][:] - time)))
        image, at = file["frames"][index].astype(float), float(file["time"][index])
    grey = np.clip(image / np.percentile(image, 99.7), 0, 1) * 255
    animation.write_picture(grey.astype(np.uint8), album.folder / "camera.webp", quality=80)
    alt = f"A synthetic camera picture of the seeded water at {at:.3f} s; the finger is black."
    album.add(
        None,
        "camera.webp",
        "camera",
        alt,
        f"What the virtual camera sees at {at:.3f} s; PIV is done on such pictures.",
    )


def _tell(files: StageFiles, entries: list[dict[str, Any]]) -> None:
    print(f"{len(entries)} pictures in {files.figures}")


def main(argv: list[str] | None = None) -> int:
    """Command line; returns 0 good, 2 bad input."""
    return run_stage("figures", __doc__, make_figures, _tell, argv)


if __name__ == "__main__":
    sys.exit(main())
