"""Registration of recordings with the faults of real ones, by the tests' own renderer: errors over the stated uncertainties.

python -m tests.studies.laboratory.faults --seeds 40 -o faults.csv [--docs docs/comparison.md]
Every recording has one history of particles, errors of set-up, a motion of its own (pressure and duration within 5 %), and each of
the faults with a chance of a quarter, as strong as it happens to be. Of half of the recordings with a shadow it is stated where the
light comes from, known to 10°. A small camera (400 px, 0.4 mm/px), 24 pictures.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pandas as pd

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.check_fit import check_fit
from postprocess.lab.registration.register import law_pressure, register
from tests.lab_renderer import Faults, Rendered
from tests.studies.laboratory.seeds import below_target, spans, study
from tests.studies.pages import libraries

PICTURES, SHAPE, SCALE = 24, (320, 400), 0.4e-3
BAND, FAR_OFF = 1.96, 5.0
KINDS = ("shadow", "reflection", "holder", "dropped", "perspective")
CHANCE = 0.25  # of each
STATED, LIGHT_STD_DEG = (
    "shadow_stated",
    10.0,
)  # of a shadow where it is stated that light comes from one side, and how well that is known
ROWS = (
    ("root_x_px", "root x"), ("root_y_px", "root y"), ("turn", "turn"), ("scale", "scale"), ("delay", "time"),
    ("factor", "pressure factor"), ("stretch", "duration factor"),
)  # fmt: skip


def drawn_faults(kinds: list[str], rng: np.random.Generator) -> Faults:
    """The faults, each as strong as chance has it."""
    turn, width = rng.uniform(0, 2 * np.pi), float(rng.uniform(0.001, 0.008))
    shadow, reflection, holder = (float(rng.uniform(low, 1.0)) for low in (0.5, 0.2, 0.2))
    perspective = (float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.4, 0.4)))
    return Faults(
        shadow=shadow if "shadow" in kinds else 0.0,
        shadow_to=(np.cos(turn), np.sin(turn)),
        shadow_width=width,
        reflection=reflection if "reflection" in kinds else 0.0,
        holder=0.01 * holder if "holder" in kinds else 0.0,
        perspective=perspective if "perspective" in kinds else (0.0, 0.0),
    )


def trial(kinematics: Kinematics, seed: int) -> dict[str, object]:
    """One recording: its faults, why it was refused (or nothing), errors and standard uncertainties."""
    rng = np.random.default_rng([seed, 21])
    kinds = [kind for kind in KINDS if rng.random() < CHANCE]
    faults = drawn_faults(kinds, rng)
    stated = Pose(SCALE, 0.0, kinematics.root, (150.0, 270.0))
    shift = rng.uniform(-1e-3, 1e-3, 2) / SCALE
    at = stated.at_px + shift
    true = Pose(
        SCALE * (1 + rng.uniform(-0.01, 0.01)),
        np.radians(rng.uniform(-2, 2)),
        kinematics.root,
        (at[0], at[1]),
    )
    values = np.array(
        [rng.uniform(0.95, 1.05), rng.uniform(-0.008, 0.008), rng.uniform(0.95, 1.05)]
    )
    clock = np.linspace(0.0, 0.44, PICTURES)
    taken = clock.copy()
    if "dropped" in kinds:
        taken[rng.integers(8, 16) :] += clock[1] * rng.integers(1, 3)
    recording = Rendered(
        kinematics,
        true,
        law_pressure(kinematics, taken, values),
        SHAPE,
        faults,
        fresh=False,
        seed=seed,
    )
    known: dict[str, Any] = {
        "scale_std": 0.01,
        "hidden": faults.holder + 0.002 if faults.holder else 0.0,
    }
    of_light = np.random.default_rng([seed, 22])
    if "shadow" in kinds and of_light.random() < 0.5:
        onward = true.rotation @ np.asarray(faults.shadow_to)
        light_from = (
            np.arctan2(-onward[1], -onward[0])
            + np.radians(LIGHT_STD_DEG) * of_light.standard_normal()
        )
        known["light_from"] = float(light_from)
        kinds[kinds.index("shadow")] = STATED
    row: dict[str, object] = {"seed": seed, "kind": " ".join(kinds) or "none", "refused": ""}
    begin = time.process_time()
    try:
        made = register(
            recording,
            clock,
            kinematics,
            stated,
            None,
            seed=seed,
            **known,
        )
    except ValueError as error:
        return row | {"refused": str(error), "cpu_s": time.process_time() - begin}
    check = check_fit(recording, clock, made, kinematics, **known)
    pose, law, std = made.pose, made.law, np.sqrt(np.diag(made.covariance))
    off = [*(np.array(pose.at_px) - true.at_px), pose.angle - true.angle, np.log(true.scale_m_per_px / pose.scale_m_per_px)]  # fmt: skip
    off += [law.values[k] - values[k] for k in (1, 0, 2)]
    own = [*std, law.std("delay"), law.std("factor"), law.std("stretch")]
    for (name, _), e, s in zip(ROWS, off, own, strict=True):
        row |= {name: float(e), f"{name}_std": float(s)}
    return row | {"refused": "; ".join(check.refusals), "cpu_s": time.process_time() - begin}


def summary(trials: pd.DataFrame) -> str:
    """Tables of docs/comparison.md."""
    refused = trials["refused"].fillna("").str.len() > 0
    ok = trials[~refused]
    z = pd.DataFrame({name: ok[name].abs() / ok[f"{name}_std"] for name, _ in ROWS})
    lines = [
        f"| accepted ({len(ok)} of {len(trials)} recordings) | coverage of the 95 % band | largest error, std | mean std |",
        "|---|---|---|---|",
    ]
    for name, label in ROWS:
        lines.append(
            f"| {label} | {(z[name] <= BAND).mean():.0%} | {z[name].max():.1f} | {ok[f'{name}_std'].mean():.2g} |"
        )
    lines += [
        "",
        below_target({label: z[name] <= BAND for name, label in ROWS}),
        "",
        f"| recordings with | number | refused | accepted and beyond 3 std | beyond {FAR_OFF:g} std |",
        "|---|---|---|---|---|",
    ]
    worst = z.max(axis=1).reindex(trials.index, fill_value=0.0)
    for kind in ("none", KINDS[0], STATED, *KINDS[1:]):
        has = trials["kind"].str.split().apply(lambda kinds, kind=kind: kind in kinds)
        lines.append(
            f"| {kind.replace('_', ', light ')} | {has.sum()} | {(refused & has).sum()} | {(worst[has] > 3).sum()} | {(worst[has] > FAR_OFF).sum()} |"
        )
    return "\n".join([*lines, "", f"Seeds {spans(trials['seed'])}; {libraries()}."])


if __name__ == "__main__":
    study("faults", __doc__, 40, trial, summary)
