"""Blind comparisons: recordings by the second renderer, with motion and water that are known.

    python -m docs.evidence.laboratory [FIRST LAST] [--coupled --rate 250]

One row per seed goes to docs/record/laboratory_blind.csv, or _coupled.csv. Faults follow from the
seed alone. At the end, or without seeds at once, the counts of the whole table are printed.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import shapely
import xarray as xr

from docs.evidence.lab_renderer import Faults, Filmed
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import LAB_COMPARISON
from pipeline.runs.run import Run, coupled_out, open_run
from piv.files.errors import StageError
from piv.formats.plane_series import read_plane
from piv.formats.recording import RecordingWriter
from piv.vortices.find import VortexSettings
from piv.vortices.table import tabulate_vortices
from postprocess.evidence.tip_vortex import dominant_track
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.virtual_experiment import WIDE
from softfinger.laboratory import compare_with
from softfinger.make import Machine, make, make_sheet

TABLES = {False: Path("docs/record/laboratory_blind.csv")}
TABLES[True] = Path("docs/record/laboratory_coupled.csv")
VIEW = (-0.085, 0.125, 0.10, 0.285)  # m
SHAPE, SCALE = (512, 640), 0.25  # px, mm/px
RATE, INTERVAL = 50.0, 0.002
NAMES = ("x_px", "y_px", "turn", "scale", "factor", "delay")
# kPa, s, viscosity over water's, gain of the flow away from the wall
WATERS = {
    "none": (20.0, 0.4, 1.0, 0.0),
    "pressure +4 %": (20.8, 0.4, 1.0, 0.0),
    "pressure -4 %": (19.2, 0.4, 1.0, 0.0),
    "duration -6 %": (20.0, 0.376, 1.0, 0.0),
    "water +25 %": (20.0, 0.4, 1.0, 0.25),
    "water -25 %": (20.0, 0.4, 1.0, -0.25),
    "viscosity x 3": (20.0, 0.4, 3.0, 0.0),
    "three at once": (20.8, 0.376, 1.0, 0.25),
}
PLAN = ["none", "none", "none", *list(WATERS)[1:]]  # ten seeds
BESIDE = (0.5, 0.7, 1.6, 2.5)  # every second ten seeds: density within 2 mm of the wall
BLEND = 6e-3  # m from the wall over which a gain sets in: water sticks to it
TOML = """format = "dpiv"
format_version = 4
title = "blind {seed}"
kind = "pictures"
files = "recording.h5"
frame_rate_hz = {rate}
start = "from motion"
finger_geometry = "measured"
finger_length_std_mm = 0.05
scale = {{ scale_mm_per_px = {scale}, std_percent = 0.5 }}
axes = {{ y = "up", root_px = [{x:.1f}, {y:.1f}] }}
piv = {{ window = 24, spacing = 8, pairing = "1-2,3-4", interval_s = {interval} }}
"""


def flow_of(nominal: Run, fault: str, folder: Path) -> tuple[Run, xr.Dataset, xr.Dataset]:
    """Run of a fault's motion, its flow without and with a gain (tank frame, loaded)."""
    pressure, duration, viscosity, gain = WATERS[fault]
    overrides = {
        "motion.strokes": [{"pressure_kpa": pressure, "start": 0.005, "duration": duration}],
        "fluid.kinematic_viscosity": viscosity * 1.004e-6,
    }
    name = f"{pressure:g}_{duration:g}_{viscosity:g}"
    overrides = dict(nominal.overrides) | overrides
    run = nominal if name == "20_0.4_1" else open_run(
        nominal.scene.folder, nominal.scene.level, overrides, nominal.out / "blind" / name
    )  # fmt: skip
    make(run, "run", Machine(), quiet=True)
    make_sheet(run, VIEW, folder / f"{name}.h5", quiet=True)
    with read_plane(folder / f"{name}.h5") as sheet:
        base = sheet.load()
    if not gain:
        return run, base, base
    points = shapely.points(*np.meshgrid(base["x"].values, base["y"].values))
    bodies = (shapely.Polygon(o[0]) for o in base["outline"].values)
    away = np.stack([shapely.distance(body, points) for body in bodies])
    factor = 1 + gain * (1 - np.exp(-((away / BLEND) ** 2)))
    return run, base, base.assign({n: base[n] * factor for n in ("u", "v")})


def circulation(flow: xr.Dataset, pose: Pose, like: xr.Dataset, tip_width: float) -> pd.Series:
    """Circulation (m²/s) of a flow on the grid and at the instants of a comparison."""
    plane = camera_series(flow, pose, *(like[n].values for n in ("x", "y", "time")))
    table = tabulate_vortices(plane, VortexSettings(WIDE * tip_width, correlation_length=6e-3))
    times = plane["time"].values
    track = dominant_track(table[table["bridged"] == 0], 0, (times[0], times[-1]), "flow")
    return track.set_index("time")["circulation"].reindex(times)


def compared(nominal: Run, seed: int, folder: Path, rate: float) -> dict[str, object]:
    """One recording of so many pairs a second rendered and compared; a row of the table."""
    rng, ten = np.random.default_rng(seed), (seed - 201) // 10
    fault = PLAN[(seed - 201) % 10]
    beside = float(rng.choice(BESIDE)) if ten % 2 else 1.0
    run, base, flow = flow_of(nominal, fault, folder)
    kinematics = read_kinematics(run.scene.motion_folder / "kinematics.h5")
    stated = Pose(SCALE, 0.0, kinematics.root, (220.0, 430.0))
    x, y = (float(v) for v in stated.at_px + rng.uniform(-4, 4, 2))
    scale, turn = SCALE * (1 + rng.normal(0, 0.005)), np.radians(rng.uniform(-2, 2))
    true, start = Pose(scale, turn, kinematics.root, (x, y)), rng.uniform(0.002, 0.010)
    begin = start + np.arange(round(0.42 * rate)) / rate
    begin = begin[begin + INTERVAL < kinematics.time[1]]
    times = np.column_stack([begin, begin + INTERVAL]).ravel()
    seen = kinematics, true, kinematics.law(times), SHAPE, Faults(beside=beside), seed
    film, place = Filmed(*seen, flow=flow, times=times), folder / f"blind_{seed}"
    place.mkdir(exist_ok=True)
    where = place / "recording.h5", SHAPE, np.uint8, len(film), {"bits": 8}
    with RecordingWriter(*where, times=times - times[0]) as out:
        for k in range(len(film)):
            out.write(k, film.frame(k))
        out.finish()
    x, y = stated.at_px
    values = {"seed": seed, "rate": rate, "scale": SCALE, "x": x, "y": y, "interval": INTERVAL}
    (place / "dpiv.toml").write_text(TOML.format(**values))
    row: dict[str, object] = {"seed": seed, "fault": fault, "beside": beside}
    lab = nominal.out / "lab" / place.name
    try:
        compare_with(nominal, place, Machine(), inputs=True, quick=False, quiet=True)
    except StageError as error:
        return row | {"refused": str(error)}
    result = LAB_COMPARISON.read(lab / "comparison.json")
    judged = {q["name"]: q for q in result["quantities"]}
    # of a coupled motion the factor is that of the bend, which no setting tells
    found = result["registration"]
    factor = np.nan if run.scene.coupled else WATERS[fault][0] / 20.0
    truth = [*true.at_px, true.angle, -np.log(true.pixel), factor, -start]
    mm, turn = found["scale_mm_per_px"], np.radians(found["turn_deg"])
    known = [*found["root_px"], turn, -np.log(1e-3 * mm), found["pressure_factor"]]
    known.append(1e-3 * found["delay_ms"])
    std = [*np.array(found["root_std_mm"]) / mm, np.radians(found["turn_std_deg"])]
    std += [found["scale_std_percent"] / 100, found["pressure_factor_std"]]
    std.append(1e-3 * found["delay_std_ms"])
    for name, one, other, s in zip(NAMES, known, truth, std, strict=True):
        row |= {f"{name}_error": one - float(other), f"{name}_std": s}
    row |= {"stretch": found["stretch"], "stretch_std": found["stretch_std"]}
    with read_plane(lab / "direct.h5") as direct:
        like = direct.load()
    window = np.add(judged["circulation"]["window"], (-1e-6, 1e-6))
    if fault == "viscosity x 3":
        base = flow_of(nominal, "none", folder)[1]
    ours, theirs = (
        circulation(f, true, like, kinematics.tip_width).loc[slice(*window)].mean()
        for f in (base, flow)
    )
    row |= {"true_difference": (ours - theirs) / abs(theirs)}
    for name, q in judged.items():
        size = abs(q["scale"])
        row |= {f"{name}_verdict": q["verdict"], f"{name}_found_above": q["detectable"] / size}
        if name != "centre":
            row |= {f"{name}_E": q["error"][0] / size, f"{name}_u": q["u_val"][0] / size}
            row |= {f"{name}_u_D": q["u_D"][0] / size}
    row |= {"finer": judged["circulation"]["finer"][0] / abs(theirs), "begin_s": window[0]}
    row |= {"motion": result["motion"], "flow": result["flow"], "refused": ""}
    shutil.rmtree(lab)
    return row


def counts(table: pd.DataFrame) -> str:
    """Verdicts by fault, errors within 1.96 standard uncertainties, least error that is found."""
    verdicts = table.assign(refused=table["refused"].notna())
    verdicts = verdicts[["fault", "motion", "flow", "refused"]]
    lines = [verdicts.value_counts(sort=False, dropna=False).to_string()]
    off = table["circulation_E"] - table["true_difference"]
    errors = {name: (off, table[name]) for name in ("circulation_u_D", "circulation_u")}
    errors |= {n: (table[f"{n}_error"], table[f"{n}_std"]) for n in NAMES}
    for name, (error, std) in errors.items():
        ratio = (error / std).abs().dropna()
        lines.append(f"{name}: {(ratio < 1.96).sum()} of {ratio.size}, worst {ratio.max():.1f}")
    least = table["circulation_found_above"]
    lines.append(f"circulation_found_above: median {least.median():.1%}, worst {least.max():.1%}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="A row for each seed, and the counts of all.")
    parser.add_argument("first", type=int, nargs="?", default=1)
    parser.add_argument("last", type=int, nargs="?", default=0)
    parser.add_argument("--scene", default="cases/single_finger")
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--rate", type=float, default=RATE, help="pairs of pictures in a second")
    parser.add_argument("--coupled", action="store_true", help="motions that water changes, too")
    asked = parser.parse_args()
    nominal, table = open_run(asked.scene, asked.level), TABLES[asked.coupled]
    if asked.coupled:
        moved = {"motion.source": "structure"}
        nominal = open_run(asked.scene, asked.level, moved, coupled_out(nominal.out))
    folder = nominal.out / "blind"
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(asked.first, asked.last + 1):
        rows = pd.DataFrame([compared(nominal, seed, folder, asked.rate)])
        if table.exists():
            old = pd.read_csv(table)
            rows = pd.concat([old[old["seed"] != seed], rows])
        rows.to_csv(table, index=False, float_format="%.5g")
        print(json.dumps(rows.iloc[-1].to_dict(), default=str), flush=True)
        shutil.rmtree(folder / f"blind_{seed}", ignore_errors=True)
    print(counts(pd.read_csv(table)))


if __name__ == "__main__":
    main()
