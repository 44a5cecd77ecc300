"""The virtual laboratory in numbers: recordings with known differences, registered, compared and judged; many seeds.

python -m tests.studies.laboratory.virtual_lab --seeds 20 -o trials.csv [--docs docs/comparison.md]   (make virtual-lab-study)
Sets: `noise` (the water is the simulation's own run), `pressure` (+1 kPa), `level` (a finer mesh). Every seed draws its own
particles, noise and set-up: root ±1 mm, turn ±2°, scale ±1 %, first picture 2 to 10 ms after the simulation's start.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.plane_series import read_plane
from piv.images.open_recording import open_recording
from piv.synthetic.camera import Seeding
from piv.vortices.find import VortexSettings
from postprocess.evidence.strokes import stroke_window
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.inputs_toml import Inputs, read_inputs
from postprocess.lab.data.pictures import outline_mask
from postprocess.lab.data.pose import Pose, camera_series
from postprocess.lab.data.seeding import seeding_like
from postprocess.lab.judgement.compare import compare
from postprocess.lab.judgement.inputs_of_budget import Case, Effect
from postprocess.lab.judgement.measures import measure
from postprocess.lab.judgement.uncertainty_sources import effect_of
from postprocess.lab.registration.register import law_pressure, register
from postprocess.lab.virtual.common_grid import appearance_of, outlines_px, with_finger
from postprocess.lab.virtual.virtual_experiment import evaluate, virtual_experiment
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for, make_recording
from tests.studies.laboratory.registration import summary as registration_summary
from tests.studies.pages import write_between

PAIRS_HZ, INTERVAL = 50.0, 0.002
WINDOW, SPACING = 24, 8
COLUMNS, SCALE_MM_PER_PX, PPP = 640, 0.25, 0.05
SETS = ("noise", "pressure", "level")
BAND = 1.96
INSTANTS = 5  # of every trial: the stroke's middle holds five or six


class Laboratory:
    """What all seeds share: the simulation, the waters, and the effects of the runs beside the nominal one."""

    def __init__(self, case: Path, level: str) -> None:
        out = case / "out" / level
        self.kinematics: Kinematics = read_kinematics(out / "kinematics.h5")
        self.inputs: Inputs = read_inputs(case / "reference" / "inputs.toml")
        self.settings = VortexSettings(**json.loads((out / "settings" / "vortices.json").read_text()))
        folder = out / "virtual" / "study"
        self.sheet = read_plane(folder / "nominal.h5").load()
        self.waters = {
            "noise": self.sheet,
            "pressure": read_plane(folder / "21kpa.h5").load(),
            "level": read_plane(folder / "grid.h5").load(),
        }
        self.camera = camera_for(self.kinematics.root, COLUMNS, SCALE_MM_PER_PX * 1e-3, 1 / INTERVAL)
        self.pose = SetUp(self.camera).pose(self.kinematics.root)
        times = self.sheet["time"].values
        bend = self.sheet["bend"].values[:, 0]
        self.window = stroke_window(times, bend, (0.25, 0.75))
        self._effects: list[Effect] = []
        self._runs = [
            (
                one,
                read_plane(folder / f"{one.name}.h5").load(),
                read_kinematics(out / "inputs" / one.name / "out" / level / "kinematics.h5"),
            )
            for one in self.inputs.all
        ]

    def effects(self, case: Case) -> list[Effect]:
        """Effects of the runs, found at the first trial's pose and instants and used for all: they are differences."""
        if not self._effects:
            direct, pose = case.direct, case.registration.pose
            nominal = measure(direct, pose, self.settings, case.window, "direct")
            for one, sheet, kinematics in self._runs:
                plane = camera_series(
                    sheet, pose, direct["x"].values, direct["y"].values, direct["time"].values
                )
                self._effects.append(effect_of(one, plane, kinematics, case, nominal))
        return self._effects


def trial(lab: Laboratory, kind: str, seed: int, folder: Path) -> dict[str, object]:
    """One recording, registered and compared; errors against the truth, and the verdicts."""
    rng = np.random.default_rng([seed, SETS.index(kind)])
    kinematics = lab.kinematics
    set_up = SetUp(
        lab.camera, Seeding(density_ppp=PPP), tuple(rng.uniform(-1, 1, 2)), float(rng.uniform(-2, 2)), float(rng.uniform(-0.01, 0.01)),
        float(rng.uniform(0.002, 0.010)), seed=int(rng.integers(1 << 30)),
    )  # fmt: skip
    path = make_recording(lab.waters[kind], set_up, kinematics.root, folder, PAIRS_HZ)
    true = set_up.pose(kinematics.root)
    piv = Evaluation(window=WINDOW, spacing=SPACING, pairing="1-2,3-4", interval_s=INTERVAL)
    with open_recording(str(path)) as recording:
        count = len(recording)
        times = np.arange(count) // 2 / PAIRS_HZ + np.arange(count) % 2 * INTERVAL
        stated = Pose(
            set_up.camera.scale_m_per_px,
            0.0,
            kinematics.root,
            tuple(
                np.asarray(set_up.camera.origin_px)
                + np.asarray(kinematics.root) / set_up.camera.scale_m_per_px
            ),
        )
        registration = register(
            recording,
            times,
            kinematics,
            stated,
            None,
            scale_std=0.01,
            paired=True,
            sweeps=(1200, 500, 2000, 2000),
            seed=seed,
        )
        pose, law = registration.pose, registration.law
        middle = times[::2] + INTERVAL / 2 - law.delay
        wanted = np.flatnonzero((middle >= lab.window[0]) & (middle <= lab.window[1]))
        wanted = wanted[:INSTANTS]
        index = np.column_stack([2 * wanted, 2 * wanted + 1]).ravel()
        clock = times[index] - law.delay
        shapes = outlines_px(kinematics, pose, law_pressure(kinematics, times[index], law.values))
        data = evaluate(recording, index, clock, shapes, pose, piv, folder / "data.h5")
        images = [recording.frame(int(i)) for i in index[::4]]
        seen = appearance_of(images, [outline_mask(s, recording.shape) for s in shapes[::4]])
    data = with_finger(
        data, kinematics, pose, law_pressure(kinematics, data["time"].values + law.delay, law.values)
    )
    virtual = virtual_experiment(
        lab.sheet, pose, set_up.camera, seeding_like(seen, 8, set_up.seeding.sheet_thickness), clock,
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
    offset = law.delay + set_up.start
    water = camera_series(lab.waters[kind], true, data["x"].values, data["y"].values, instants + offset)
    right = camera_series(lab.sheet, true, data["x"].values, data["y"].values, instants + offset)
    truth = {
        n: measure(p, true, lab.settings, (window[0] + offset, window[1] + offset), n).mean()
        for n, p in (("water", water), ("right", right))
    }
    row: dict[str, object] = {
        "set": kind,
        "seed": seed,
        "verdict": result["verdict"],
        "wrong": " ".join(result["wrong"]),
    }
    std = np.sqrt(np.diag(registration.covariance))
    row |= {
        "root_mm": float(np.hypot(*(np.array(pose.at_px) - true.at_px)) * SCALE_MM_PER_PX),
        "root_x_mm": (pose.at_px[0] - true.at_px[0]) * SCALE_MM_PER_PX, "root_x_mm_std": std[0] * SCALE_MM_PER_PX,
        "root_y_mm": (pose.at_px[1] - true.at_px[1]) * SCALE_MM_PER_PX, "root_y_mm_std": std[1] * SCALE_MM_PER_PX,
        "turn_deg": np.degrees(pose.angle - true.angle), "turn_deg_std": np.degrees(std[2]),
        "scale_percent": 100 * (pose.scale_m_per_px / true.scale_m_per_px - 1), "scale_percent_std": 100 * std[3],
        "delay_ms": 1e3 * offset, "delay_ms_std": 1e3 * law.std("delay"),
        "factor": law.values[0] - (1.05 if kind == "pressure" else 1.0), "factor_std": law.std("factor"),
        "stretch": law.values[2] - 1.0, "stretch_std": law.std("stretch"),
        "density_ppp": seen.density_ppp,
    }  # fmt: skip
    columns = {
        "circulation": ["circulation"],
        "centre": ["x", "y"],
        "core_radius": ["core_radius"],
        "jet_speed": ["jet_speed"],
    }
    for q in result["quantities"]:
        row |= {f"{q['name']}_verdict": q["verdict"], f"{q['name']}_significance": q["significance"]}
        for k, column in enumerate(columns.get(q["name"], [])):
            expected = truth["right"][column] - truth["water"][column]
            row |= {
                f"{column}_E": q["error"][k],
                f"{column}_true": expected,
                f"{column}_u_D": q["u_D"][k],
                f"{column}_u_val": q["u_val"][k],
            }
    return row


def summary(trials: pd.DataFrame) -> str:
    """The tables of docs/comparison.md."""
    lines = [registration_summary(trials), ""]
    lines += [
        "| quantity | RMS error of E | mean u_D | coverage of 95 % by u_D | coverage by u_val |",
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
        e = (trials[f"{name}_E"] - trials[f"{name}_true"]).astype(float)
        held = e.abs() <= BAND * trials[f"{name}_u_D"]
        inside.append(held)
        wide = e.abs() <= BAND * trials[f"{name}_u_val"]
        lines.append(
            f"| {name.replace('_', ' ')}, {unit} | {np.sqrt((e**2).mean()) * factor:.2g} | {trials[f'{name}_u_D'].mean() * factor:.2g} | {held.mean():.0%} | {wide.mean():.0%} |"
        )
    lines.append(f"| all | | | **{np.mean(inside):.0%}** (target 90–99 %) | |")
    lines += ["", "| water | seeds | overall verdict | quantities called in error |", "|---|---|---|---|"]
    for kind, group in trials.groupby("set", sort=False):
        counts = group["verdict"].value_counts()
        wrong = group["wrong"].fillna("").str.split().explode().value_counts()
        lines.append(
            f"| {kind} | {len(group)} | {', '.join(f'{v}: {n}' for v, n in counts.items())} | {', '.join(f'{q} {n}' for q, n in wrong.items() if q) or 'none'} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the trials; those already in the table are not run again."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.studies.laboratory.virtual_lab", description=__doc__
    )
    parser.add_argument("--case", type=Path, default=Path("cases/single_finger"))
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=SETS)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--docs", type=Path, help="page to write the tables to")
    args = parser.parse_args()
    done = pd.read_csv(args.output) if args.output.exists() else pd.DataFrame(columns=["set", "seed"])
    lab = Laboratory(args.case, args.level)
    for seed in range(1, args.seeds + 1):
        for kind in args.sets:
            if ((done["set"] == kind) & (done["seed"] == seed)).any():
                continue
            begin = time.process_time()
            with TemporaryDirectory() as folder:
                row = trial(lab, kind, seed, Path(folder))
            row["cpu_s"] = time.process_time() - begin
            done = pd.concat([done, pd.DataFrame([row])], ignore_index=True)
            done.to_csv(args.output, index=False)
            print(kind, seed, row["verdict"], row["wrong"], f"{row['cpu_s']:.1f} s", flush=True)
    text = summary(done)
    print(text)
    if args.docs:
        write_between(args.docs, "study", text)


if __name__ == "__main__":
    main()
