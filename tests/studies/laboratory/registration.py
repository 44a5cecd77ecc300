"""Registration over many seeds: pictures of a finger whose pose, scale, bend and clock are known; no flow is needed for it.

python -m tests.studies.laboratory.registration --seeds 20 -o registration.csv [--docs docs/comparison.md]   (make virtual-lab-study)
Camera of the virtual laboratory, 42 pictures with fresh particles each; half of the seeds bend 5 % further (+1 kPa).
"""

from __future__ import annotations

import time

import numpy as np
import pandas as pd

from fileio.formats.kinematics import Kinematics
from piv.images.recording import Recording
from piv.synthetic.camera import Seeding
from postprocess.lab.registration.register import register
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for
from tests.lab_scene import stated_pose, still_picture
from tests.studies.laboratory.seeds import below_target, study

PICTURES = 42
BAND = 1.96
ROWS = (
    ("root_x_mm", "root x, mm", 0.3), ("root_y_mm", "root y, mm", 0.3), ("turn_deg", "turn, °", 0.5),
    ("delay_ms", "time, ms", 1.0), ("scale_percent", "scale, %", 0.3), ("factor", "pressure factor", None),
    ("stretch", "duration factor", None),
)  # fmt: skip


class Stills(Recording):
    """Pictures of the finger at the pressures of a law."""

    def __init__(
        self, kinematics: Kinematics, lab: SetUp, times: np.ndarray, pressures: np.ndarray
    ) -> None:
        super().__init__("stills", times.size, None)
        self.times, self._kinematics, self._lab, self._pressures = times, kinematics, lab, pressures

    def _read(self, i: int) -> np.ndarray:
        return still_picture(self._kinematics, self._lab, float(self._pressures[i]), i)


def trial(kinematics: Kinematics, seed: int) -> dict[str, float]:
    """One registration: errors against the truth and the standard uncertainties stated for them."""
    rng = np.random.default_rng(seed)
    camera = camera_for(kinematics.root, 640, 0.25e-3, 500.0)
    lab = SetUp(
        camera, Seeding(density_ppp=0.05), tuple(rng.uniform(-1, 1, 2)), float(rng.uniform(-2, 2)), float(rng.uniform(-0.01, 0.01)), seed=seed
    )  # fmt: skip
    factor, delay = (1.05 if seed % 2 else 1.0), float(rng.uniform(-0.007, 0.007))
    times = np.linspace(0.0, 0.42, PICTURES)
    pressures = factor * kinematics.law(np.clip(times - delay, *kinematics.time))
    begin = time.process_time()
    registration = register(
        Stills(kinematics, lab, times, pressures),
        times,
        kinematics,
        stated_pose(kinematics, camera),
        None,
        scale_std=0.01,
        seed=seed,
    )
    true, pose, law = lab.pose(kinematics.root), registration.pose, registration.law
    std = np.sqrt(np.diag(registration.covariance))
    mm = 1e3 * true.scale_m_per_px
    return {
        "seed": seed, "cpu_s": time.process_time() - begin,
        "root_x_mm": (pose.at_px[0] - true.at_px[0]) * mm, "root_x_mm_std": std[0] * mm,
        "root_y_mm": (pose.at_px[1] - true.at_px[1]) * mm, "root_y_mm_std": std[1] * mm,
        "turn_deg": float(np.degrees(pose.angle - true.angle)), "turn_deg_std": float(np.degrees(std[2])),
        "scale_percent": 100 * (pose.scale_m_per_px / true.scale_m_per_px - 1), "scale_percent_std": 100 * float(std[3]),
        "delay_ms": 1e3 * (law.delay - delay), "delay_ms_std": 1e3 * law.std("delay"),
        "factor": float(law.values[0]) - factor, "factor_std": law.std("factor"),
        "stretch": float(law.values[2]) - 1.0, "stretch_std": law.std("stretch"),
    }  # fmt: skip


def summary(trials: pd.DataFrame) -> str:
    """Table of docs/comparison.md."""
    lines = [f"| registration ({len(trials)} recordings) | target | RMS error | within target | largest | coverage of the 95 % band |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    held = {}
    for name, label, target in ROWS:
        e, s = trials[name].abs(), trials[f"{name}_std"]
        held[label] = e <= BAND * s
        asked, kept = ("", "") if target is None else (f"{target:g}", f"{(e <= target).mean():.0%}")
        lines.append(
            f"| {label} | {asked} | {np.sqrt((e**2).mean()):.2g} | {kept} | {e.max():.2g} | {held[label].mean():.0%} |"
        )
    return "\n".join([*lines, "", below_target(held)])


if __name__ == "__main__":
    study("registration", __doc__, 20, trial, summary)
