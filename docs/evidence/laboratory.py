"""Blind comparisons: recordings by the second renderer, with motion, water and faults known.

    python -m docs.evidence.laboratory [FIRST LAST] [--level draft] [--scene …] [--coupled]

One row per seed goes to docs/record/laboratory_blind.csv; without seeds its counts are printed.
What is wrong follows from the seed: the scenarios of PLAN in turn. Waters are runs of the level.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely
import xarray as xr
from scipy.spatial import cKDTree

from docs.evidence.lab_renderer import Faults, Filmed
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import LAB_COMPARISON
from pipeline.runs.run import Run, coupled_out, open_run
from piv.formats.plane_series import read_plane
from piv.formats.recording import RecordingWriter
from piv.vortices.find import VortexSettings
from piv.vortices.table import tabulate_vortices
from postprocess.evidence.tip_vortex import dominant_track, of_disc
from postprocess.lab.inputs import EMPTY
from postprocess.lab.page import answer
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.validation import AGREES, DIFFERS, ERROR
from postprocess.lab.virtual_experiment import WIDE
from softfinger import laboratory as command
from softfinger.make import Machine, make
from softfinger.sheets import make_sheet

TABLE = Path("docs/record/laboratory_blind.csv")
SHAPE, SCALE = (512, 640), 0.25  # px, mm/px
RATE, INTERVAL = 50.0, 0.002
COMMIT = subprocess.check_output(["git", "describe", "--always", "--dirty"], text=True).strip()
KEYS = ["seed", "scene", "level", "coupled"]  # of a row
NAMES = ("x_px", "y_px", "turn", "scale", "factor", "delay")
WALL = 2e-4  # m between points of the wall
BLEND = 6e-3  # m from the wall over which a gain sets in: water sticks to it
TOML = """format = "dpiv"
format_version = 4
title = "blind {seed}"
kind = "pictures"
files = "recording.h5"
frame_rate_hz = {rate!r}
start = "from motion"
finger_geometry = "measured"
finger_length_std_mm = 0.05
scale = {{ scale_mm_per_px = {scale!r}, std_percent = {std!r} }}
axes = {{ y = "up", root_px = [{x:.1f}, {y:.1f}] }}
piv = {{ window = 24, spacing = 8, pairing = "1-2,3-4", interval_s = {interval!r} }}
"""


@dataclass(frozen=True)
class Scenario:
    """What is wrong, and what must come out.

    `pressure`, `duration`, `viscosity`: factors of the truth's; `gain`: of its water beyond the
    wall, less 1. `stated`: factors of what dpiv.toml states (rate, interval, scale), shifts of the
    root (px). `refused`: words of the first cause. `motion`: verdicts that are right; `says`: words
    of the answer. `dropped`: pairs that are missing; `until`: of the recording, s.
    """

    name: str
    pressure: float = 1.0
    duration: float = 1.0
    viscosity: float = 1.0
    gain: float = 0.0
    faults: Faults = field(default_factory=Faults)
    stated: dict[str, float] = field(default_factory=dict)
    refused: str = ""
    motion: tuple[str, ...] = (AGREES,)
    says: str = ""
    dropped: int = 0
    until: float = 0.42
    repeats: int = 1


WIDER, STRONGER = (DIFFERS, ERROR), (ERROR,)
SHADOW, BUMP = Faults(shadow=1.0), Faults(bump=(3.4, -3.4, 0.0))
PLAN = [
    Scenario("sound"),
    Scenario("seeding 0.5 beside the wall", faults=Faults(beside=0.5)),
    Scenario("seeding 2.5 beside the wall", faults=Faults(beside=2.5)),
    Scenario("flicker", faults=Faults(flicker=0.3)),
    Scenario("a fourth of the particles lost", faults=Faults(lost=0.25)),
    Scenario("ends early", until=0.30),
    Scenario("stroke 10 % shorter", duration=0.9, motion=WIDER),
    Scenario("stroke 10 % longer", duration=1.1, motion=WIDER),
    Scenario("stroke 15 % shorter", duration=0.85, motion=WIDER),
    Scenario("stroke 15 % longer", duration=1.15, motion=WIDER),
    Scenario("pressure +7.5 %", pressure=1.075, motion=STRONGER),
    Scenario("pressure -5.5 %", pressure=0.945, motion=STRONGER),
    Scenario("viscosity x 3", viscosity=3.0),
    Scenario("water +25 %", gain=0.25),
    Scenario("water -20 %", gain=-0.2),
    Scenario("rate x 1.3", stated={"rate": 1.3}, refused="frame_rate_hz is about 1.3"),
    Scenario("rate x 1.1", stated={"rate": 1.1}, refused="frame_rate_hz is about 1.1"),
    Scenario("rate / 1.15", stated={"rate": 1 / 1.15}, refused="frame_rate_hz is about 0.8"),
    Scenario("rate x 2", stated={"rate": 2.0}, refused="frame_rate_hz to 0.5"),
    Scenario("interval x 1.2", stated={"interval": 1.2}, says="check piv.interval_s first"),
    Scenario("interval / 1.2", stated={"interval": 1 / 1.2}, says="check piv.interval_s first"),
    Scenario("scale 3 %", stated={"scale": 1.03, "std": 0.3}, refused="scale is wrong"),
    Scenario("scale -3 %", stated={"scale": 0.97, "std": 0.3}, refused="scale is wrong"),
    Scenario("root 6 mm", stated={"x": 20.0, "y": -13.0}, refused="root is wrong"),
    Scenario("turned 7 degrees", stated={"turn": 7.0}, refused="axes.turn_deg"),
    Scenario("camera bumped 1.2 mm", faults=BUMP, refused="camera moved"),
    Scenario("camera turned on the way", faults=Faults(bump=(0, 0, 0.03)), refused="camera moved"),
    Scenario("20 ms of pictures lost", dropped=1, refused="clock jumps"),
    Scenario("40 ms of pictures lost", dropped=2, refused="clock jumps"),
    Scenario("shadow from the side", faults=SHADOW, refused="outline"),
    Scenario("reflection", faults=Faults(reflection=1.0), refused="outline"),
    Scenario("holder", faults=Faults(holder=0.008), refused="outline"),
    Scenario("mirrored", faults=Faults(mirrored=True), refused="axes.x"),
    Scenario("dim and thin", faults=Faults(light=0.12, density=0.15), refused="too dim"),
    # two at once
    Scenario("rate x 1.1, pressure -5.5 %", pressure=0.945, stated={"rate": 1.1},
             refused="frame_rate_hz is about 1.1"),
    Scenario("stroke 10 % shorter, water +25 %", duration=0.9, gain=0.25, motion=WIDER),
    Scenario("pressure +7.5 %, seeding 0.5", pressure=1.075, faults=Faults(beside=0.5),
             motion=STRONGER),
    Scenario("scale 3 %, seeding 2.5", stated={"scale": 1.03, "std": 0.3},
             faults=Faults(beside=2.5), refused="scale is wrong"),
    Scenario("root 6 mm, pressure +7.5 %", pressure=1.075, stated={"x": -18.0, "y": 16.0},
             refused="root is wrong"),
    Scenario("camera bumped, flicker", faults=replace(BUMP, flicker=0.3), refused="camera moved"),
    Scenario("interval x 1.2, stroke 10 % longer", duration=1.1, stated={"interval": 1.2},
             motion=WIDER, says="check piv.interval_s first"),
    Scenario("lost particles, flicker", faults=Faults(lost=0.25, flicker=0.2)),
    Scenario("scale 3 %, shadow", stated={"scale": 1.03, "std": 0.3}, faults=SHADOW,
             refused="outline"),
    Scenario("viscosity x 3, stroke 10 % shorter", viscosity=3.0, duration=0.9, motion=WIDER),
    Scenario("three repeats", repeats=3),
    Scenario("three repeats, pressure +7.5 %", pressure=1.075, motion=STRONGER, repeats=3),
    Scenario("three repeats, water +25 %", gain=0.25, repeats=3),
]  # fmt: skip


def flow_of(nominal: Run, of: Scenario) -> tuple[Run, xr.Dataset]:
    """Run of a scenario's motion and water, and its flow without the gain (tank frame)."""
    run, factors = nominal, (of.pressure, of.duration, of.viscosity)
    if factors != (1.0, 1.0, 1.0):
        stroke = nominal.scene.motion.strokes[0]
        pressure = round(stroke.pressure_kpa * of.pressure, 6)
        lasts = round(stroke.duration * of.duration, 6)
        strokes = [{"pressure_kpa": pressure, "start": stroke.start, "duration": lasts}]
        viscosity = of.viscosity * nominal.scene.fluid.kinematic_viscosity
        more = {"motion.strokes": strokes, "fluid.kinematic_viscosity": viscosity}
        name = f"{pressure:g}_{lasts:g}_{of.viscosity:g}"
        values, out = dict(nominal.overrides) | more, nominal.out / "blind" / name
        run = open_run(nominal.scene.folder, nominal.scene.level, values, out)
    make(run, "solve", Machine(), quiet=True)
    path = run.out / "blind_sheet.h5"
    x, y = nominal.scene.finger.root
    make_sheet(run, (x - 0.085, x + 0.125, y - 0.145, y + 0.04), path, quiet=True)
    with read_plane(path) as sheet:
        return run, sheet.load()


def stronger(flow: xr.Dataset, gain: float) -> xr.Dataset:
    """A flow with a gain away from the wall."""
    points = np.stack(np.meshgrid(flow["x"].values, flow["y"].values), axis=-1)
    walls = [shapely.segmentize(shapely.linearrings(o), WALL) for o in flow["outline"].values]
    away = np.stack([cKDTree(shapely.get_coordinates(one)).query(points)[0] for one in walls])
    factor = 1 + gain * (1 - np.exp(-((away / BLEND) ** 2)))
    return flow.assign({n: flow[n] * factor for n in ("u", "v")})


def circulation(flow: xr.Dataset, pose: Pose, like: xr.Dataset, tip_width: float) -> pd.Series:
    """Circulation (m²/s) of a flow on the grid and at the instants of a comparison."""
    x, y, at = (like[n].values for n in ("x", "y", "time"))
    plane = camera_series(flow, pose, x, y, at)
    settings = VortexSettings(WIDE * tip_width, correlation_length=6e-3)
    table = of_disc(tabulate_vortices(plane, settings))
    times = plane["time"].values
    track = dominant_track(table[table["bridged"] == 0], 0, (times[0], times[-1]), "flow")
    return track.set_index("time")["circulation"].reindex(times)


def recorded(
    nominal: Run, of: Scenario, seed: int, place: Path
) -> tuple[Pose, float, xr.Dataset, xr.Dataset]:
    """Render one recording with its dpiv.toml; true pose and start, flow without and with gain."""
    rng, (run, base) = np.random.default_rng(seed), flow_of(nominal, of)
    flow = stronger(base, of.gain) if of.gain else base
    kinematics = read_kinematics(run.scene.motion_folder / "kinematics.h5")
    stated = of.stated
    about = np.array([220.0, 430.0]) + rng.uniform(-4, 4, 2)
    std = stated.get("std", 0.5)
    scale = SCALE * (1 + rng.normal(0, std / 100 if "scale" not in stated else 0.001))
    turn = np.radians(rng.uniform(-2, 2) + stated.get("turn", 0.0))
    start = rng.uniform(0.002, 0.010)
    true = Pose(scale, turn, kinematics.root, (float(about[0]), float(about[1])))
    begin = start + np.arange(round(of.until * RATE)) / RATE
    begin += np.where(np.arange(begin.size) > begin.size // 3, of.dropped / RATE, 0.0)
    begin = begin[begin + INTERVAL < kinematics.time[1]]
    times = np.column_stack([begin, begin + INTERVAL]).ravel()
    seen = kinematics, true, kinematics.law(times), SHAPE, of.faults, seed
    film = Filmed(*seen, flow=flow, times=times)
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    where = place / "recording.h5", SHAPE, np.uint8, len(film), {"bits": 8}
    with RecordingWriter(*where, times=times - times[0]) as out:
        for k in range(len(film)):
            out.write(k, film.frame(k))
        out.finish()
    text = {"seed": seed, "rate": RATE * stated.get("rate", 1.0), "std": std}
    text |= {"scale": SCALE * stated.get("scale", 1.0)}
    text |= {"interval": INTERVAL * stated.get("interval", 1.0)}
    x, y = 220.0 + stated.get("x", 0.0), 430.0 + stated.get("y", 0.0)
    x = SHAPE[1] - 1 - x if of.faults.mirrored else x
    (place / "dpiv.toml").write_text(TOML.format(x=x, y=y, **text))
    return true, start, base, flow


def compared(nominal: Run, seed: int, folder: Path) -> dict[str, Any]:
    """One scenario rendered and compared; a row of the table."""
    of = PLAN[seed % len(PLAN)]
    row: dict[str, Any] = {"seed": seed, "scene": nominal.scene.name, "level": nominal.scene.level}
    row |= {"coupled": nominal.scene.coupled, "scenario": of.name, "commit": COMMIT, "error": ""}
    places = [folder / f"blind_{seed}_{k}" for k in range(of.repeats)]
    made = [recorded(nominal, of, 1000 * k + seed, p) for k, p in enumerate(places)]
    lab = nominal.out / "lab" / "+".join(place.name for place in places)
    options = {"inputs": not nominal.scene.coupled, "quick": False, "quiet": True}
    begin = time.process_time()
    try:
        command.compare_with(nominal, places, Machine(), **options)
    except Exception as error:  # a traceback is a result, too
        text = str(error)
        kind = "refused" if type(error).__name__ == "StageError" else "traceback"
        first = text.split("; also, ")[0]
        right = bool(of.refused) and of.refused in first and kind == "refused"
        return row | {"result": kind, "right": right, "error": text}
    row["cpu_s"] = round(time.process_time() - begin, 1)
    result = LAB_COMPARISON.read(lab / "comparison.json")
    row |= {"result": f"{result['motion']}, {result['flow']}", "error": answer(result)}
    row |= checked(nominal, of, made[0], lab.parent / places[0].name, result)
    return row


def checked(
    nominal: Run, of: Scenario, made: tuple, lab: Path, result: dict[str, Any]
) -> dict[str, Any]:
    """Whether a verdict is right, and its numbers against the truth."""
    true, start, base, flow = made
    row: dict[str, Any] = {}
    judged = {q["name"]: q for q in result["quantities"]}
    found = result["registration"]
    # of a coupled motion the factor is that of the bend, which no setting tells
    factor = np.nan if nominal.scene.coupled else of.pressure
    truth = [*true.at_px, true.angle, -np.log(true.pixel), factor, -start]
    mm, turn = found["scale_mm_per_px"], np.radians(found["turn_deg"])
    known = [*found["root_px"], turn, -np.log(1e-3 * mm), found["pressure_factor"]]
    known.append(1e-3 * found["delay_ms"])
    std = [*np.array(found["root_std_mm"]) / mm, np.radians(found["turn_std_deg"])]
    std += [found["scale_std_percent"] / 100, found["pressure_factor_std"]]
    std.append(1e-3 * found["delay_std_ms"])
    for name, one, other, s in zip(NAMES, known, truth, std, strict=True):
        row[f"{name}_z"] = (one - float(other)) / s
    lasts = judged["duration"]
    row["stretch_z"] = (1 - of.duration / found["stretch"]) * lasts["scale"] / lasts["u_D"][0]
    row["water_speed"] = result["water_speed"]
    with read_plane(lab / "direct.h5") as direct:
        like = direct.load()
    q = judged["circulation"]
    window, size = np.add(q["window"], (-1e-6, 1e-6)), abs(q["scale"])
    width = read_kinematics(nominal.path("kinematics")).tip_width
    if nominal.scene.coupled:  # without runs that tell what a motion changes
        base = flow_of(nominal, Scenario("nominal"))[1]
    elif of.viscosity != 1.0:
        base = flow_of(nominal, replace(of, viscosity=1.0))[1]
    both = {id(f): circulation(f, true, like, width).loc[slice(*window)] for f in (base, flow)}
    ours, theirs = (both[id(f)].mean() for f in (base, flow))
    wrong = of.stated.get("interval", 1.0)  # the recording's vectors are slower by this
    row["true_E"] = (ours - theirs / wrong) / size
    row |= {"E": q["error"][0] / size, "u": q["u_val"][0] / size, "u_D": q["u_D"][0] / size}
    row |= {"moved": (q["moved"] or [0.0])[0] / size, "found_above": q["detectable"] / size}
    row["centre_z"] = judged["centre"]["significance"] if not of.gain else np.nan
    differs = abs(row["true_E"]) > q["detectable"] / size
    agrees = abs(row["true_E"]) < q["k"] * q["u_val"][0] / size
    flows = {ERROR} if differs else {AGREES} if agrees and row["true_E"] == 0 else {AGREES, ERROR}
    right = result["motion"] in of.motion and result["flow"] in flows and of.says in answer(result)
    unseen = AGREES not in of.motion and result["motion"] == AGREES
    green = (of.refused and result["verdict"] == AGREES) or unseen
    green = bool(green or (differs and result["flow"] == AGREES))
    return row | {"right": right and not of.refused, "wrong_green": green}


def counts(table: pd.DataFrame) -> str:
    """Right, refused and wrong by level, and how often the truth lies within 95 %."""
    lines = [table.groupby(KEYS[1:])["right"].agg(["sum", "size"]).to_string()]
    for _, row in table[~table["right"].astype(bool)].iterrows():
        lines.append(f"wrong: {row['seed']} {row['scenario']}: {row['result']}")
    # a recording that should have been refused has no truth to be compared with
    table = table[~table["scenario"].isin([of.name for of in PLAN if of.refused])]
    if "E" not in table:
        return "\n".join(lines)
    ratios = {name: table[f"{name}_z"] for name in (*NAMES, "stretch")}
    off = table["E"] - table["true_E"]
    ratios |= {"circulation by u_D": off / table["u_D"], "circulation by u_val": off / table["u"]}
    for name, ratio in ratios.items():
        seen = ratio.abs().dropna()
        if len(seen):
            lines.append(f"{name}: {(seen < 1.96).sum()} of {seen.size}, worst {seen.max():.1f}")
    inside = pd.concat([ratio.abs().dropna() for ratio in list(ratios.values())[:-1]]) < 1.96
    lines.append(f"all: {inside.sum()} of {inside.size}")
    # what postprocess.lab assumes: flow.LINEAR (beyond the data's own error) and motion.SPEED_STD
    far = table["moved"].abs() > 0.02
    rest = ((off**2 - table["u_D"] ** 2) / table["moved"] ** 2)[far].mean()
    lines.append(f"correction: {np.sqrt(max(rest, 0.0)):.3f} of it, by {far.sum()}")
    speeds = np.log(table["water_speed"])[table["true_E"].abs() < 0.02].dropna()
    lines.append(f"speed at equal phase: {np.sqrt((speeds**2).mean()):.3f}, by {speeds.size}")
    return "\n".join(lines)


def others(path: Path, mine: list[Any]) -> pd.DataFrame:
    """The rows of a table but that of `mine` (KEYS)."""
    table = pd.read_csv(path) if path.exists() else pd.DataFrame(columns=KEYS)
    return table[~(table[KEYS] == mine).all(axis=1)] if mine else table


def main() -> None:
    parser = argparse.ArgumentParser(description="A row for each seed, and the counts of all.")
    parser.add_argument("first", type=int, nargs="?", default=1)
    parser.add_argument("last", type=int, nargs="?", default=0)
    parser.add_argument("--scene", default="cases/single_finger")
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--coupled", action="store_true", help="motions that water changes, too")
    parser.add_argument("--keep", action="store_true", help="recordings and pages")
    parser.add_argument("--again", action="store_true", help="seeds that have a row, too")
    parser.add_argument("--table", type=Path, default=TABLE)
    asked = parser.parse_args()
    nominal = open_run(asked.scene, asked.level)
    if asked.coupled:
        moved = {"motion.source": "structure"}
        nominal = open_run(asked.scene, asked.level, moved, coupled_out(nominal.out))
    command.level_windows = lambda *_: EMPTY
    make(nominal, "kinematics", Machine(), quiet=True)
    folder = nominal.out / "blind"
    for seed in range(asked.first, asked.last + 1):
        mine = [seed, nominal.scene.name, asked.level, asked.coupled]
        if not asked.again and len(others(asked.table, mine)) < len(others(asked.table, [])):
            continue
        row = pd.DataFrame([compared(nominal, seed, folder)])
        rows = pd.concat([others(asked.table, mine), row])  # with what other campaigns have written
        rows.to_csv(asked.table, index=False, float_format="%.5g")
        print(rows.iloc[-1].dropna().to_dict(), flush=True)
        for place in () if asked.keep else nominal.out.glob(f"*/blind_{seed}_*"):
            shutil.rmtree(place, ignore_errors=True)
    print(counts(pd.read_csv(asked.table)))


if __name__ == "__main__":
    main()
