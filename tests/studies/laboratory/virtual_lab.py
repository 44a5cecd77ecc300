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
import xarray as xr
from scipy.stats import binomtest

from piv.synthetic.camera import Seeding
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.files import Registration
from postprocess.lab.data.inputs_toml import read_inputs, write_runs
from postprocess.lab.data.pictures import outline_mask
from postprocess.lab.data.pose import camera_series
from postprocess.lab.data.seeding import seeding_like
from postprocess.lab.judgement.compare import STRENGTH, compare, effects_of_runs
from postprocess.lab.judgement.inputs_of_budget import Case
from postprocess.lab.judgement.uncertainty_sources import VORTEX
from postprocess.lab.judgement.validation import DIFFERS, ERROR, LEVEL, UNCERTAIN
from postprocess.lab.registration.check_fit import check_fit
from postprocess.lab.registration.register import law_pressure, register
from postprocess.lab.report.answers import answer
from postprocess.lab.virtual.common_grid import appearance_of, outlines_px, with_finger
from postprocess.lab.virtual.virtual_experiment import evaluate, virtual_experiment
from tests.studies.laboratory import protocol
from tests.studies.laboratory.registration import summary as registration_summary
from tests.studies.laboratory.seeds import below_target, publish, share_of, spans
from tests.studies.laboratory.waters import (
    INTERVAL,
    MOVED,
    PAIRS_HZ,
    SAME_MODEL,
    SCALE_MM_PER_PX,
    SCALE_STD,
    SETS,
    WATERS,
    Laboratory,
    missed,
    recorded,
    rightly_judged,
    rightly_refused,
    true_errors,
)
from tests.studies.pages import libraries

WINDOW, SPACING = 24, 8
BAND = 1.96
MEASURED = (
    ("circulation", "cm²/s", 1e4), ("x", "mm", 1e3), ("y", "mm", 1e3), ("core_radius", "mm", 1e3), ("jet_speed", "mm/s", 1e3)
)  # fmt: skip
INSTANTS = 5  # of every trial: the stroke's middle holds five or six


def case_of(
    lab: Laboratory,
    registration: Registration,
    data: xr.Dataset,
    virtual: xr.Dataset,
    direct: xr.Dataset,
) -> Case:
    """What is compared of a recording: as `make compare` does it for a finger whose geometry was measured, and pictures in pairs."""
    instants, window_m = data["time"].values, WINDOW * 1e-3 * SCALE_MM_PER_PX
    window = float(instants[0]) - 1e-6, float(instants[-1]) + 1e-6
    case = Case(
        lab.kinematics, registration, data, virtual, direct, window, lab.settings, window_m, False, 0.0, fresh_pairs=True
    )  # fmt: skip
    case.effects.extend(effects_of_runs(lab.runs, case))
    return case


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
    }
    count = len(recording)
    times = np.arange(count) // 2 / PAIRS_HZ + np.arange(count) % 2 * INTERVAL
    hidden = 0.012 if "holder" in faults else 0.0
    known: dict[str, Any] = {"scale_std": SCALE_STD, "paired": True, "hidden": hidden}
    try:
        registration = register(recording, times, kinematics, lab.stated, None, seed=seed, **known)
        check = check_fit(recording, times, registration, kinematics, **known)
        refused = "; ".join(check.refusals)
    except ValueError as error:
        refused = str(error)
    if refused:
        return row | {"refused": refused, "right": rightly_refused(kind, faults, refused)}
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
        data,
        kinematics,
        pose,
        law_pressure(kinematics, data["time"].values + law.delay, law.values),
    )
    virtual = virtual_experiment(
        lab.sheet, pose, lab.camera, seeding_like(seen, 8, Seeding().sheet_thickness), clock,
        outlines_px(kinematics, pose, kinematics.law(clock)), piv, folder, seed=seed + 1000,
    )  # fmt: skip
    virtual = with_finger(virtual, kinematics, pose, kinematics.law(virtual["time"].values))
    instants = data["time"].values
    direct = camera_series(lab.sheet, pose, data["x"].values, data["y"].values, instants)
    case = case_of(lab, registration, data, virtual, direct)
    result, _, field = compare(case, lab.inputs)
    difference, of_model, (factor, delay, stretch) = true_errors(
        lab, kind, case, field, result["rows"], true, start
    )
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
    for q in result["quantities"]:
        name, found = q["name"], np.inf if q["detectable"] is None else q["detectable"]
        row |= {
            f"{name}_verdict": q["joint_verdict"],
            f"{name}_significance": q["significance"],
            f"{name}_detectable": found / abs(q["scale"]),
            f"{name}_dominant": q["dominant"],
            f"{name}_true_part": np.linalg.norm(of_model[name]) / abs(q["scale"]),
        }
        for k, column in enumerate(VORTEX[name][0] if name in VORTEX else ()):
            row |= {
                f"{column}_E": q["error"][k],
                f"{column}_true": of_model[name][k],
                f"{column}_difference": q["simulation"][k] - q["data"][k],
                f"{column}_difference_true": difference[name][k],
                f"{column}_u_D": q["u_D"][k],
                f"{column}_u_val": q["u_val"][k],
            }
    unseen = missed(result, of_model)
    return row | {"missed": " ".join(unseen), "right": rightly_judged(kind, result, told, unseen)}


def summary(trials: pd.DataFrame) -> str:
    """The tables of docs/comparison.md."""
    refused = trials["refused"].fillna("") != ""
    judged = trials[~refused]
    if judged.empty:
        return "all recordings were refused"
    lines = [registration_summary(judged), ""]
    lines += [
        "| quantity | RMS error of S − D | mean u_D | coverage of 95 % by u_D | of E by u_val |",
        "|---|---|---|---|---|",
    ]
    held = {}
    for name, unit, factor in MEASURED:
        e = (judged[f"{name}_difference"] - judged[f"{name}_difference_true"]).astype(float)
        held[label := f"{name.replace('_', ' ')}, {unit}"] = inside = (
            e.abs() <= BAND * judged[f"{name}_u_D"]
        )
        held[f"{label}, of E"] = wide = (
            judged[f"{name}_E"] - judged[f"{name}_true"]
        ).abs() <= BAND * judged[f"{name}_u_val"]
        rms, mean = factor * np.sqrt((e**2).mean()), factor * judged[f"{name}_u_D"].mean()
        lines.append(
            f"| {label} | {rms:.2g} | {mean:.2g} | {inside.mean():.0%} | {wide.mean():.0%} |"
        )
    lines += ["", below_target(held), "", *verdicts(trials, refused), ""]
    lines += [
        "| quantity | smallest model error found with 95 %, median | mostly by |",
        "|---|---|---|",
    ]
    for name in [
        c.removesuffix("_detectable") for c in judged.columns if c.endswith("_detectable")
    ]:
        size, by = judged[f"{name}_detectable"].median(), judged[f"{name}_dominant"].mode()[0]
        found = f"{size:.0%}" if np.isfinite(size) else "none"
        lines.append(f"| {name.replace('_', ' ')} | {found} | {by.replace('_', ' ')} |")
    runs = np.sqrt(judged["circulation_u_val"] ** 2 - judged["circulation_u_D"] ** 2)[
        judged["set"] == "none"
    ]
    if len(runs):
        least, most = 1e4 * runs.min(), 1e4 * runs.max()
        lines += [
            "",
            f"What the runs leave open of the circulation of `none` (u_num, u_input): {least:.1f} to {most:.1f} cm²/s.",
        ]
    seeds = "; ".join(
        f"{kind} {spans(group['seed'])}" for kind, group in trials.groupby("set", sort=False)
    )
    return "\n".join([*lines, "", f"Seeds: {seeds}. {libraries()}."])


def verdicts(trials: pd.DataFrame, refused: pd.Series) -> list[str]:
    """The waters and what was said of each. A refusal is no judgement: those without a fault are counted beside it. Undecided is what
    is not wrong and of which motion or flow cannot be said."""
    lines = [
        "| water | recordings | refused, of these without a fault | motion | flow | right | undecided | wrong |",
        "|---|---|---|---|---|---|---|---|",
    ]
    sound, accepted = trials["faults"] == "none", ~refused
    wrong = accepted & ~trials["right"].astype(bool)
    undecided = accepted & ~wrong & (trials[["motion", "flow"]] == UNCERTAIN).any(axis=1)
    right = accepted & ~wrong & ~undecided
    for kind, group in trials.groupby("set", sort=False):
        of = group.index
        said = [
            ", ".join(
                f"{word} {n}" for word, n in group.loc[accepted[of], name].value_counts().items()
            )
            or "–"
            for name in ("motion", "flow")
        ]
        counts = " | ".join(str(found[of].sum()) for found in (right, undecided, wrong))
        lines.append(
            f"| {kind} | {len(group)} | {refused[of].sum()}, {(refused & sound)[of].sum()} | {said[0]} | {said[1]} | {counts} |"
        )
    judged = trials[accepted]
    moves = judged["motion"].isin([ERROR, DIFFERS]) == judged["set"].isin(MOVED)
    lines += [
        "",
        f"Of accepted recordings right, in motion and flow: {share_of(right[accepted])}; right or said to be undecided:"
        f" **{share_of(~wrong[accepted])}** (target 90 %); wrong: {share_of(wrong[accepted])}. Motion by itself right: {share_of(moves)}.",
        f"Of those refused {share_of(trials['right'].astype(bool)[refused])} had a reason: a fault drawn, or of `larger` its length named.",
    ]
    model = judged[~judged["set"].isin(SAME_MODEL)]
    parts = "; ".join(
        f"{kind} {name.replace('_', ' ')} {group[f'{name}_true_part'].median():.0%}"
        for kind, group in model.groupby("set", sort=False)
        for name in STRENGTH
    )
    if parts:
        lines.append(f"What of the flow model truly differs (medians): {parts}.")
    unseen = judged.loc[judged["missed"].astype(object).fillna("") != "", ["set", "seed", "missed"]]
    if len(unseen):
        of = "; ".join(
            f"{kind} {seed}: {names}" for kind, seed, names in unseen.itertuples(index=False)
        )
        lines.append(
            f"Said to agree though the true error is larger than what would have been found: {of}."
        )
    same = judged[judged["set"] == "none"]
    if len(same):
        alarms = (same["flow"] == ERROR) | same["motion"].isin([ERROR, DIFFERS])
        most = binomtest(int(alarms.sum()), len(same), alternative="less").proportion_ci(LEVEL).high
        lines.append(
            f"False alarms without a difference: {alarms.sum()} of {len(same)} (target 5 %; with 95 % not above {most:.0%})."
        )
    return lines


def main() -> None:
    """Run the trials; those already in the table are not run again."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.studies.laboratory.virtual_lab", description=__doc__
    )
    parser.add_argument("--case", type=Path, default=Path("cases/single_finger"))
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument(
        "--write", action="store_true", help="write the scenes of the waters, and no more"
    )
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=SETS)
    parser.add_argument("-o", "--output", type=Path, default=Path("trials.csv"))
    parser.add_argument("--docs", type=Path, help="page to write the tables to")
    args = parser.parse_args()
    if args.write:
        print(*write_runs(StageFiles(args.case, args.level), read_inputs(WATERS), "virtual"))
        return
    done = (
        pd.read_csv(args.output) if args.output.exists() else pd.DataFrame(columns=["set", "seed"])
    )
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
        publish(args.docs, f"study at {args.level}", text, done)
        protocol.write(args.docs, args.docs.with_name("lab_protocol.md"))


if __name__ == "__main__":
    main()
