"""Recordings of waters with known differences, registered, compared and judged, by the tests' own renderer; many seeds.

python -m tests.studies.laboratory.virtual_lab --seeds 5 -o trials.csv [--docs docs/comparison.md]   (make virtual-lab-study)
Waters: `none` (the simulation's own run), those of waters.toml, `slower` and `finer` (the runs of the inputs), `larger` (a finger 3 %
longer than stated). Every seed draws particles of its own for each pair, noise and set-up: root ±1 mm, turn ±2°, scale 0.3 % (standard
deviation; what is stated), first picture 2 to 10 ms after the simulation's start, and each fault but dropped frames with a chance of
a tenth.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from piv.synthetic.camera import Seeding
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.inputs_toml import read_inputs, write_runs
from postprocess.lab.data.pictures import outline_mask
from postprocess.lab.data.pose import camera_series
from postprocess.lab.data.seeding import seeding_like
from postprocess.lab.judgement.compare import compare
from postprocess.lab.judgement.inputs_of_budget import Case
from postprocess.lab.judgement.measures import measure
from postprocess.lab.judgement.validation import DIFFERS, ERROR
from postprocess.lab.registration.check_fit import check_fit
from postprocess.lab.registration.register import fit_law, law_pressure, register
from postprocess.lab.report.answers import answer
from postprocess.lab.virtual.common_grid import appearance_of, outlines_px, with_finger
from postprocess.lab.virtual.virtual_experiment import evaluate, virtual_experiment
from tests.studies.laboratory.registration import summary as registration_summary
from tests.studies.laboratory.waters import (
    INTERVAL,
    MOVED,
    PAIRS_HZ,
    SCALE_MM_PER_PX,
    SCALE_STD,
    SETS,
    WATERS,
    Laboratory,
    recorded,
    rightly_judged,
)
from tests.studies.pages import libraries, write_between

WINDOW, SPACING = 24, 8
BAND = 1.96
SWEEPS = (800, 300, 1200, 1200)
INSTANTS = 5  # of every trial: the stroke's middle holds five or six


def trial(lab: Laboratory, kind: str, seed: int, folder: Path) -> dict[str, object]:
    """One recording, registered and compared; errors against the truth, and the verdicts."""
    rng = np.random.default_rng([seed, SETS.index(kind)])
    kinematics = lab.kinematics
    recording, true, start, faults = recorded(lab, kind, seed + 1000 * SETS.index(kind), rng)
    row: dict[str, object] = {
        "set": kind,
        "seed": seed,
        "faults": " ".join(faults) or "none",
        "refused": "",
        "right": True,
    }
    count = len(recording)
    times = np.arange(count) // 2 / PAIRS_HZ + np.arange(count) % 2 * INTERVAL
    hidden = 0.012 if "holder" in faults else 0.0
    known: dict[str, Any] = {"scale_std": SCALE_STD, "paired": True, "hidden": hidden}
    try:
        registration = register(
            recording, times, kinematics, lab.stated, None, sweeps=SWEEPS, seed=seed, **known
        )
        check = check_fit(recording, times, registration, kinematics, **known)
        refused = "; ".join(check.refusals)
    except ValueError as error:
        refused = str(error)
    if refused:
        return row | {
            "refused": refused,
            "right": bool(faults) or (kind == "larger" and "the finger's length" in refused),
        }
    pose, law = registration.pose, registration.law
    middle = times[::2] + INTERVAL / 2 - law.delay
    wanted = np.flatnonzero((middle >= lab.window[0]) & (middle <= lab.window[1]))[:INSTANTS]
    index = np.column_stack([2 * wanted, 2 * wanted + 1]).ravel()
    clock = times[index] - law.delay
    shapes = outlines_px(kinematics, pose, law_pressure(kinematics, times[index], law.values))
    piv = Evaluation(window=WINDOW, spacing=SPACING, pairing="1-2,3-4", interval_s=INTERVAL)
    data = evaluate(recording, index, clock, shapes, pose, piv, folder / "data.h5")
    images = [recording.frame(int(i)) for i in index[::4]]
    seen = appearance_of(images, [outline_mask(s, recording.shape) for s in shapes[::4]])
    data = with_finger(
        data, kinematics, pose, law_pressure(kinematics, data["time"].values + law.delay, law.values)
    )
    virtual = virtual_experiment(
        lab.sheet, pose, lab.camera, seeding_like(seen, 8, Seeding().sheet_thickness), clock,
        outlines_px(kinematics, pose, kinematics.law(clock)), piv, folder, seed=seed + 1000,
    )  # fmt: skip
    virtual = with_finger(virtual, kinematics, pose, kinematics.law(virtual["time"].values))
    instants = data["time"].values
    direct = camera_series(lab.sheet, pose, data["x"].values, data["y"].values, instants)
    window = (float(instants[0]) - 1e-6, float(instants[-1]) + 1e-6)
    case = Case(
        kinematics,
        registration,
        data,
        virtual,
        direct,
        window,
        lab.settings,
        WINDOW * 1e-3 * SCALE_MM_PER_PX,
        False,
        0.0,
    )
    case.effects.extend(lab.effects(case))
    result, _, _ = compare(case, lab.inputs)
    # the truth: the water itself, at the true instants, through the true camera, without any measurement
    sheet, motion = lab.water(kind)
    along = np.linspace(*kinematics.time, 201)
    (factor, delay, stretch), _, _ = fit_law(kinematics, along, motion.law(along), np.array([1.0, 0.0, 1.0]))
    at = instants + law.delay + start
    truth = {
        name: measure(camera_series(of, true, data["x"].values, data["y"].values, when), true, lab.settings,
                      (float(when[0]) - 1e-6, float(when[-1]) + 1e-6), name, case.seen()).mean()
        for name, of, when in (("water", sheet, at), ("right", lab.sheet, at - delay))
    }  # fmt: skip
    told = answer(result | {"missing_runs": [], "two_dimensional": lab.two_dimensional})
    row |= {
        "motion": result["motion"] or "",
        "flow": result["flow"],
        "wrong": " ".join(result["wrong"]),
        "told": told,
    }
    std = np.sqrt(np.diag(registration.covariance))
    row |= {
        "root_mm": float(np.hypot(*(np.array(pose.at_px) - true.at_px)) * SCALE_MM_PER_PX),
        "root_x_mm": (pose.at_px[0] - true.at_px[0]) * SCALE_MM_PER_PX, "root_x_mm_std": std[0] * SCALE_MM_PER_PX,
        "root_y_mm": (pose.at_px[1] - true.at_px[1]) * SCALE_MM_PER_PX, "root_y_mm_std": std[1] * SCALE_MM_PER_PX,
        "turn_deg": np.degrees(pose.angle - true.angle), "turn_deg_std": np.degrees(std[2]),
        "scale_percent": 100 * (pose.scale_m_per_px / true.scale_m_per_px - 1), "scale_percent_std": 100 * std[3],
        "delay_ms": 1e3 * (law.delay - delay + start), "delay_ms_std": 1e3 * law.std("delay"),
        "factor": law.values[0] - factor, "factor_std": law.std("factor"),
        "stretch": law.values[2] - stretch, "stretch_std": law.std("stretch"),
        "density_ppp": seen.density_ppp,
    }  # fmt: skip
    columns = {
        "circulation": ["circulation"],
        "centre": ["x", "y"],
        "core_radius": ["core_radius"],
        "jet_speed": ["jet_speed"],
    }
    hidden_error = True
    for q in result["quantities"]:
        row |= {
            f"{q['name']}_verdict": q["joint_verdict"],
            f"{q['name']}_significance": q["significance"],
            f"{q['name']}_detectable": q["detectable"] / abs(q["scale"]),
            f"{q['name']}_dominant": q["dominant"],
        }
        for k, column in enumerate(columns.get(q["name"], [])):
            difference = truth["right"][column] - truth["water"][column]
            of_model = (
                0.0 if kind in MOVED else difference
            )  # a finger that moves otherwise is no error of the flow model
            row |= {
                f"{column}_E": q["error"][k],
                f"{column}_true": of_model,
                f"{column}_difference": q["simulation"][k] - q["data"][k],
                f"{column}_difference_true": difference,
                f"{column}_u_D": q["u_D"][k],
                f"{column}_u_val": q["u_val"][k],
            }
            hidden_error &= q["joint_verdict"] != "agrees" or abs(of_model) <= q["detectable"]
    return row | {"right": rightly_judged(kind, result, told, hidden_error)}


def summary(trials: pd.DataFrame) -> str:
    """The tables of docs/comparison.md."""
    whole, trials = trials, trials[trials["refused"].fillna("") == ""]
    if trials.empty:
        return "all recordings were refused"
    lines = [registration_summary(trials), ""]
    lines += [
        "| quantity | RMS error of S − D | mean u_D | coverage of 95 % by u_D | of E by u_val |",
        "|---|---|---|---|---|",
    ]
    inside = []
    for name, unit, factor in (
        ("circulation", "cm²/s", 1e4),
        ("x", "mm", 1e3),
        ("y", "mm", 1e3),
        ("core_radius", "mm", 1e3),
        ("jet_speed", "mm/s", 1e3),
    ):
        e = (trials[f"{name}_difference"] - trials[f"{name}_difference_true"]).astype(float)
        held = e.abs() <= BAND * trials[f"{name}_u_D"]
        inside.append(held)
        wide = (trials[f"{name}_E"] - trials[f"{name}_true"]).abs() <= BAND * trials[f"{name}_u_val"]
        lines.append(
            f"| {name.replace('_', ' ')}, {unit} | {np.sqrt((e**2).mean()) * factor:.2g} | {trials[f'{name}_u_D'].mean() * factor:.2g} | {held.mean():.0%} | {wide.mean():.0%} |"
        )
    lines.append(f"| all | | | **{np.mean(inside):.0%}** (target 90–99 %) | |")
    trials = whole
    lines += [
        "",
        "| water | recordings | refused | motion | flow | rightly judged |",
        "|---|---|---|---|---|---|",
    ]
    for kind, group in trials.groupby("set", sort=False):
        judged = group[group["refused"].fillna("") == ""]
        counts = [
            ", ".join(f"{word} {n}" for word, n in judged[name].value_counts().items()) or "–"
            for name in ("motion", "flow")
        ]
        lines.append(
            f"| {kind} | {len(group)} | {len(group) - len(judged)} | {counts[0]} | {counts[1]} | {group['right'].astype(bool).mean():.0%} |"
        )
    lines.append(
        f"| all | {len(trials)} | | | | **{trials['right'].astype(bool).mean():.0%}** (target 90 %) |"
    )
    judged = trials[trials["refused"].fillna("") == ""]
    same = judged[judged["set"] == "none"]
    alarms = ((same["flow"] == ERROR) | same["motion"].isin([ERROR, DIFFERS])).sum()
    lines += ["", f"False alarms without a difference: {alarms} of {len(same)} (target 5 %).", ""]
    lines += ["| quantity | smallest model error found with 95 %, median | mostly by |", "|---|---|---|"]
    for name in [c.removesuffix("_detectable") for c in judged.columns if c.endswith("_detectable")]:
        size, by = judged[f"{name}_detectable"].median(), judged[f"{name}_dominant"].mode()[0]
        lines.append(f"| {name.replace('_', ' ')} | {size:.0%} | {by.replace('_', ' ')} |")
    first, last = trials["seed"].min(), trials["seed"].max()
    return "\n".join([*lines, "", f"Seeds {first:.0f} to {last:.0f}; {libraries()}."])


def main() -> None:
    """Run the trials; those already in the table are not run again."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.studies.laboratory.virtual_lab", description=__doc__
    )
    parser.add_argument("--case", type=Path, default=Path("cases/single_finger"))
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--write", action="store_true", help="write the scenes of the waters, and no more")
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=SETS)
    parser.add_argument("-o", "--output", type=Path, default=Path("trials.csv"))
    parser.add_argument("--docs", type=Path, help="page to write the tables to")
    args = parser.parse_args()
    if args.write:
        print(*write_runs(StageFiles(args.case, args.level), read_inputs(WATERS), "virtual"))
        return
    done = pd.read_csv(args.output) if args.output.exists() else pd.DataFrame(columns=["set", "seed"])
    lab = Laboratory(args.case, args.level)
    for seed in range(args.first, args.first + args.seeds):
        for kind in args.sets:
            if ((done["set"] == kind) & (done["seed"] == seed)).any():
                continue
            begin = time.process_time()
            with TemporaryDirectory() as folder:
                row = trial(lab, kind, seed, Path(folder))
            row["cpu_s"] = time.process_time() - begin
            done = pd.concat([done, pd.DataFrame([row])], ignore_index=True)
            done.to_csv(args.output, index=False)
            print(
                kind,
                seed,
                row.get("motion"),
                row.get("flow"),
                row["refused"],
                f"{row['cpu_s']:.1f} s",
                flush=True,
            )
    text = summary(done)
    print(text)
    if args.docs:
        write_between(args.docs, f"study at {args.level}", text)


if __name__ == "__main__":
    main()
