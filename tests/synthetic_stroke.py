"""An analytic single-finger stroke with all stage files that the report reads.

A finger of constant curvature hangs from (0, 0.24) m and bends from 0 to `bend_end` towards +x by a
three-pole law. A Lamb–Oseen vortex grows on the dorsal side of its tip, clockwise (negative).
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import expit

from pipeline.formats.kinematics import write_kinematics
from pipeline.formats.mesh_intervals import SWEEP, Interval, write_planform
from piv.files.record import write_record
from piv.formats.plane_series import make_plane, write_plane
from piv.images.masks import inside_polygon
from tests.conftest import CASES

ROOT = np.array([0.0, 0.24])
LENGTH, THICKNESS, WIDTH = 0.070, 0.0145, 0.028
SCENE = f"""
title = "A single finger bends in the tank"
[finger]
root = {ROOT.tolist()}
length = {LENGTH}
thickness = {THICKNESS}
width = {WIDTH}
[motion]
strokes = [{{ pressure_kpa = 20.0, start = 0.02, duration = 0.3 }}]
end_time = 0.4
[mesh]
wall_cell = 3.5e-3
wall_first_layer = 1.2e-3
wall_layers = 2
tip_cell = 2.2e-3
near_cell = 5e-3
far_cell = 0.04
[numerics]
time_step = 5e-4
write_interval = 0.1
[camera]
columns = 640
rows = 512
scale_mm_per_px = 0.25
centre = [0.03, 0.2]
[levels.coarse]
"""
FILE_COLUMNS = ["time", "track", "bridged", "x", "y", "circulation", "radius", "peak_vorticity"]
FILE_COLUMNS += ["x_std", "y_std", "circulation_std", "radius_std", "peak_vorticity_std"]
FILE_COLUMNS += ["finger", "side", "tip_distance", "along_tip", "across_tip"]


def bend_law(
    time: np.ndarray, end: float, start: float = 0.02, duration: float = 0.3
) -> np.ndarray:
    """Bend angle (rad) over time (s): three equal poles, 2 % settled after `duration`."""
    q = np.clip(time - start, 0, None) / (duration / 7.52)
    return end * (1 - (1 + q + q**2 / 2) * np.exp(-q))


def finger_shape(bend: float, points: int = 60) -> dict[str, np.ndarray]:
    """Outline (point, axis) and tip frame of the finger at one bend angle."""
    s = np.linspace(0, 1, points)
    angle = bend * s
    step = LENGTH / (points - 1)
    middle = 0.5 * (angle[1:] + angle[:-1])
    x = ROOT[0] + np.concatenate([[0.0], np.cumsum(np.sin(middle)) * step])
    y = ROOT[1] - np.concatenate([[0.0], np.cumsum(np.cos(middle)) * step])
    ventral = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    line = np.stack([x, y], axis=-1)
    half = ventral * THICKNESS / 2
    tip = {"tip": line[-1], "tip_direction": np.array([np.sin(bend), -np.cos(bend)])}
    tip |= {"dorsal_direction": -ventral[-1]}
    return {"outline": np.concatenate([line + half, (line - half)[::-1]])} | tip


def finger_series(bend: np.ndarray) -> dict[str, np.ndarray]:
    """The shapes of all instants, with the axis `finger` (one) of the plane-series format."""
    shapes = [finger_shape(b) for b in bend]
    out = {k: np.stack([s[k] for s in shapes])[:, None] for k in shapes[0]}
    return out | {"bend": bend[:, None]}


def true_vortex(time: np.ndarray, bend_end: float) -> dict[str, np.ndarray]:
    """Circulation (m²/s), centre (m) and core radius (m) of the tip vortex over time."""
    bend = bend_law(time, bend_end)
    finger = finger_series(bend)
    grown = np.abs(bend / bend_end)
    offset = 0.010 + 0.004 * grown
    centre = finger["tip"][:, 0] + 0.003 * finger["tip_direction"][:, 0]
    centre = centre + offset[:, None] * finger["dorsal_direction"][:, 0] * np.sign(bend_end)
    own = {"circulation": -np.sign(bend_end) * 6e-3 * grown, "core_radius": 0.004 * (1 + grown)}
    return own | {"x": centre[:, 0], "y": centre[:, 1]}


def stroke_plane(
    time: np.ndarray, bend_end: float, spacing: float, noise: float = 0.0, seed: int = 1
) -> xr.Dataset:
    """The plane series of the stroke: the vortex and a drift that follows the tip upward."""
    x = np.arange(-0.05, 0.11 + spacing / 2, spacing)
    y = np.arange(0.135, 0.263 + spacing / 2, spacing)
    gx, gy = np.meshgrid(x, y)
    bend = bend_law(time, bend_end)
    finger, vortex = finger_series(bend), true_vortex(time, bend_end)
    rate = np.gradient(bend, time)
    rng = np.random.default_rng(seed)
    u, v, valid = (np.zeros((time.size, y.size, x.size)) for _ in range(3))
    for i in range(time.size):
        dx, dy = gx - vortex["x"][i], gy - vortex["y"][i]
        r2 = np.maximum(dx**2 + dy**2, 1e-12)
        swirl = vortex["circulation"][i] / (2 * np.pi * r2)
        swirl *= -np.expm1(-r2 / vortex["core_radius"][i] ** 2)
        tip_x, tip_y = finger["tip"][i, 0]
        pull = 0.02 * np.abs(rate[i]) * np.exp(-((gx - tip_x) ** 2 + (gy - tip_y) ** 2) / 0.03**2)
        u[i] = -swirl * dy + pull * np.sign(bend_end) + noise * rng.standard_normal(gx.shape)
        v[i] = swirl * dx + pull + noise * rng.standard_normal(gx.shape)
        valid[i] = ~inside_polygon(finger["outline"][i, 0], x, y)
    u[valid == 0], v[valid == 0] = np.nan, np.nan
    return make_plane(x, y, u, v, time=time, valid=valid, **finger)


def vortex_table(
    time: np.ndarray,
    bend_end: float,
    gain: float = 1.0,
    shift: float = 0.0,
    noise: float = 0.0,
    seed: int = 2,
) -> pd.DataFrame:
    """Rows of vortices.csv: tip vortex (track 3), far one (track 1); errors gain, shift (m)."""
    rng = np.random.default_rng(seed)
    finger, true = finger_series(bend_law(time, bend_end)), true_vortex(time, bend_end)
    rows = []
    for i, t in enumerate(time):
        if abs(true["circulation"][i]) < 2e-4:
            continue
        centre = np.array([true["x"][i] + shift, true["y"][i]])
        centre += noise * 1e-2 * rng.standard_normal(2)
        strength = gain * true["circulation"][i] * (1 + noise * rng.standard_normal())
        arm = centre - finger["tip"][i, 0]
        along = float(arm @ finger["tip_direction"][i, 0])
        across = float(arm @ finger["dorsal_direction"][i, 0])
        core, std = true["core_radius"][i], abs(strength) * (0.02 if noise else 0.0)
        side = "dorsal" if across > 0 else "ventral"
        peak = strength / (np.pi * core**2)
        strong = [t, 3, 0, *centre, strength, core, peak, 2e-4, 2e-4, std, 2e-4, 1e-2 * abs(peak)]
        rows.append([*strong, 0, side, np.hypot(*arm) / THICKNESS, along, across])
        weak = [t, 1, 0, -0.03, 0.15, 3e-4, 0.005, 4.0, 1e-3, 1e-3, 1e-4, 1e-3, 0.1]
        rows.append([*weak, 0, "dorsal", 4.0, 0.02, 0.06])
    return pd.DataFrame(rows, columns=FILE_COLUMNS)


def write_case(
    root: Path,
    scene: str = "single_finger",
    level: str = "coarse",
    *,
    bend_end: float = np.radians(100),
    spacing: float = 0.002,
    frames: int = 41,
    top: str = "",
    gain: float = 0.98,
    shift: float = 3e-4,
) -> Path:
    """Write all stage files below `root`/cases/<scene>/out/<level>; returns cases/<scene>.

    `top`: keys at the head of scene.toml.
    """
    case = root / "cases" / scene
    out = case / "out" / level
    (out / "run").mkdir(parents=True, exist_ok=True)
    (case / "scene.toml").write_text(top + SCENE)
    time = np.linspace(0.0, 0.4, frames)
    middle = 0.5 * (time[1:] + time[:-1])
    sheet = stroke_plane(time, bend_end, spacing)
    write_plane(sheet, out / "sheet.h5", source="cfd", tip_width=THICKNESS)
    _write_vortices(vortex_table(time, bend_end), out / "vortices_cfd.csv")
    piv = stroke_plane(middle, bend_end, 2 * spacing, noise=0.002)
    write_plane(piv, out / "piv.h5", source="piv", seed=2017, tip_width=THICKNESS)
    seen = vortex_table(middle, bend_end, gain, shift, 0.005)
    _write_vortices(seen, out / "vortices_piv.csv")
    _write_kinematics(time, bend_end, out / "kinematics.h5")
    _write_planform(bend_end, out)
    _write_run(time, bend_end, out, scene, level)
    seconds_of = {"kinematics": 1.2, "mesh": 14, "run": 161, "sheet": 6, "images": 20, "piv": 38}
    for stage, seconds in seconds_of.items():
        cost = {"wall_time": seconds, "cpu_time": seconds, "peak_memory": int(4e8)}
        about = {"digest": "0123abcd", "made_from": {"numbers": {}}}
        write_record(out, stage, about | cost, [])
    return case


def copy_findings(case: Path) -> Path:
    """Give a made-up case the real findings of the scene of its name; returns the case."""
    source = CASES / case.name / "reference" / "findings.toml"
    (case / "reference").mkdir(exist_ok=True)
    (case / "reference" / "findings.toml").write_text(source.read_text())
    return case


def _write_vortices(table: pd.DataFrame, path: Path) -> None:
    with path.open("w") as file:
        file.write("# " + json.dumps({"versions": {"numpy": np.__version__}}) + "\n")
        table.to_csv(file, index=False)


def _write_kinematics(time: np.ndarray, bend_end: float, path: Path) -> None:
    pressure = 2e4 * bend_law(time, bend_end) / abs(bend_end)
    knots = np.linspace(pressure.min(), pressure.max(), 9)
    shapes = finger_series(knots / 2e4 * abs(bend_end))
    states = np.linspace(-2e4, 2e4, 21)
    values = {"time": time, "pressure": pressure, "shape_parameter": knots, "source": "fea"}
    values |= {f"shape_{name}": shape[:, 0] for name, shape in shapes.items()}
    values |= {"root": ROOT, "length": LENGTH}
    values |= {"tip_thickness": THICKNESS, "state_pressure": states}
    values |= {"state_bend": 1.7 * states / 2e4, "state_bend_std": 0.1 * np.abs(states) / 2e4}
    write_kinematics(path, values | {"paper_bend": 1.6 * states / 2e4 - 0.05})


def _write_planform(bend_end: float, out: Path, rings: int = 14) -> None:
    bends = np.linspace(0.0, bend_end, 9)
    points = []
    for bend in bends:
        outline = finger_shape(bend, 24)["outline"]
        turn = np.linspace(0, 2 * np.pi, len(outline), endpoint=False) + 0.5
        far = np.c_[0.3 * np.cos(turn), 0.15 + 0.15 * np.sin(turn)]
        weight = np.linspace(0, 1, rings)[:, None, None] ** 2
        points.append((outline[None] * (1 - weight) + far[None] * weight).reshape(-1, 2))
    n = len(outline)
    ring, next_node = n * np.arange(rings - 1)[:, None], (np.arange(n) + 1) % n
    a, b = (ring + np.arange(n)).ravel(), (ring + next_node).ravel()
    mesh = {
        "shape_parameter": bends, "points": np.stack(points), "bend": bends,
        "quads": np.column_stack([a, b, b + n, a + n]), "triangles": np.array([[0, 1, n - 1]]),
        "body": np.array([1], np.uint8), "body_name": np.array(["water", "finger"], object),
        "body_half_width": np.array([0, WIDTH / 2]), "levels": np.arange(2.0),
        "wall": np.arange(n), "material": np.arange(float(n)), "outer": np.arange(4),
        "corners": np.zeros(4),
    }  # fmt: skip
    attributes = {"model": "half", "mirror": 0}
    write_planform(out / "planform.h5", [Interval(0, 0.0, 0.0, 0.4, 0)], attributes, [mesh])
    SWEEP.write(out / "sweep.h5", {}, {})


def _write_run(time: np.ndarray, bend_end: float, out: Path, scene: str, level: str) -> None:
    t = np.arange(0, 0.4, 5e-4)
    rate = np.gradient(bend_law(t, bend_end), t)
    force = -0.02 * np.gradient(rate, t) / 50
    parts = {"fx": 1.0, "fy": 0.3, "fz": 0.0, "fx_pressure": 0.97, "fy_pressure": 0.29}
    parts |= {"fx_viscous": 0.03, "fy_viscous": 0.01}
    energy = 2e-4 * expit((t - 0.12) / 0.02) * np.exp(-t)
    loss = 1e-4 * energy / energy.max()
    power = {"finger_power": np.gradient(energy, t) + loss * 1.03, "kinetic_energy": energy}
    terms = {"viscous": 0.5 * loss, "convection": 0.3 * loss, "coupling": 0.2 * loss}
    for name, columns in {
        "forces": {name: part * force for name, part in parts.items()},
        "power": power | {"dissipation": loss},
        "power_terms": terms,
    }.items():
        pd.DataFrame({"time": t} | columns).to_csv(out / "run" / f"{name}.csv", index=False)
    balance = {
        "work": 2.3e-4, "kinetic_energy": 2.0e-4, "dissipated": 2.4e-5, "closure": 6e-6,
        "closure_fraction": 0.026, "unexplained": 1e-6, "unexplained_fraction": 0.004,
        "taken": {"viscous": 2.5e-5, "convection": 3e-6, "coupling": 1e-6},
    }  # fmt: skip
    run = {
        "format": "run", "format_version": 1, "versions": {"openfoam": "v1912"}, "scene": scene,
        "level": level, "model": "half", "ranks": 2, "cells": 63500, "time_step": 5e-4,
        "end_time": 0.4, "steps": 800, "wall_time": 161.0, "resumed": [], "courant_max": 0.7,
        "power_balance": balance,
        "mesh_quality": {"max_non_orthogonality_deg": 45.0, "max_skewness": 0.8},
        "intervals": [{"start": 0.0, "end": 0.2}, {"start": 0.2, "end": 0.4}],
    }  # fmt: skip
    (out / "run/run.json").write_text(json.dumps(run))
