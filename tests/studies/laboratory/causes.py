"""Recordings of coupled fingers whose pressure and structure are known, through make compare-coupled: are the causes told right?

python -m tests.studies.laboratory.causes --level draft   (make compare-coupled-study; docs/comparison.md)
Each finger moves as a coupled run makes it; pictures, errors of set-up, clock and the pressure's noise are those of its seed. What
is there of the runs stays.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from fileio.atomic import update_text, write_text
from fileio.formats.kinematics import read_kinematics
from fileio.formats.plane_series import read_plane
from fileio.provenance import digest
from pipeline.scene.scene import load_scene
from pipeline.sheet import run as write_sheet
from pipeline.study.couple import Structure, couple
from piv.synthetic.camera import Seeding
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.files import LabFiles
from postprocess.lab.judgement.validation import AGREES, ERROR
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for, make_recording, write_dpiv
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[3]
PAGE, CASE = ROOT / "docs" / "comparison.md", ROOT / "cases" / "single_finger"
VIEW = (-0.075, 0.12, 0.115, 0.275)  # m: more than the camera sees
COLUMNS, SCALE, PAIRS_HZ = 640, 0.25e-3, 100.0
STD_KPA, CLOCK_STD = 0.1, 1e-3  # stated, and true
STATED = """start = {{ at_s = {at!r}, std_s = {std!r} }}
pressure = {{ csv = "p.csv", std_kpa = {kpa!r} }}"""


@dataclass(frozen=True)
class Truth:
    """A finger beside the scene's: lines of its scene.toml, and what is right to say of pressure and structure."""

    name: str
    about: str
    differs: str
    pressure: str
    structure: str


LESS = "strokes = [{ pressure_kpa = 18.0, start = 0.005, duration = 0.4 }]\n"
STIFF = "[structure]\nbending_stiffness = 0.6e-3\n"  # N m²; the shipped finger's is 0.48e-3
TRUTHS = (
    Truth("less", "18 kPa, not 20", f"[motion]\n{LESS}", "differs", AGREES),
    Truth("stiff", "a quarter as stiff again", STIFF, AGREES, ERROR),
)


def recording_folder(truth: Truth, level: str, seed: int) -> Path:
    """Folder of a finger's recording: of another seed, or of a finger that differs otherwise, it is another."""
    own = f"{truth.name}_{digest(truth.differs)[:8]}"
    return CASE / "out" / level / "causes" / own / f"{own}_seed{seed}"


def record(truth: Truth, level: str, seed: int) -> Path:
    """The coupled run of a finger and its recording; returns the recording's folder."""
    rng = np.random.default_rng([seed, TRUTHS.index(truth)])
    output = recording_folder(truth, level, seed)
    folder = output.parent
    text = (
        f'# Written by tests.studies.laboratory.causes.\nextends = "../../../.."\n{truth.differs}'
    )
    update_text(folder / "scene.toml", text)
    scene = load_scene(folder, level)
    run = couple(scene, ranks=1, target="run")
    if (output / "dpiv.toml").exists():
        return output
    write_sheet(load_scene(run, level), quiet=True, view=VIEW, output=folder / "view.h5")
    root = read_kinematics(run / "out" / level / "kinematics.h5").root
    start = float(rng.uniform(0.002, 0.010))
    shift, turn, scale = (
        rng.uniform(-1, 1, 2),
        float(rng.uniform(-2, 2)),
        float(rng.uniform(-0.01, 0.01)),
    )
    set_up = SetUp(camera_for(root, COLUMNS, SCALE, 500.0), Seeding(density_ppp=0.05), tuple(shift), turn, scale,
                   start, seed=seed)  # fmt: skip
    with read_plane(folder / "view.h5") as sheet:
        make_recording(sheet.load(), set_up, root, output, PAIRS_HZ)
    structure = Structure(scene)
    time = np.arange(-0.03, scene.motion.end_time + 0.03, 1e-3)
    pressure = np.interp(time, structure.time, structure.pressure)
    pressure += rng.normal(0, 1e3 * STD_KPA, time.size)
    table = pd.DataFrame({"t": time - start, "p": pressure})
    write_text(output / "p.csv", table.to_csv(index=False, float_format="%.9g"))
    write_dpiv(set_up, root, output, truth.name, 24, 8, PAIRS_HZ, 1)
    stated = STATED.format(
        at=round(start + float(rng.normal(0, CLOCK_STD)), 6), std=CLOCK_STD, kpa=STD_KPA
    )
    path = output / "dpiv.toml"
    update_text(path, path.read_text(encoding="utf-8").replace('start = "from motion"', stated))
    return output


def row(truth: Truth, level: str, recording: Path) -> str:
    """What make compare-coupled says of a recording, as a row of the page's table."""
    inner = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    words = [
        "make",
        "--no-print-directory",
        "compare-coupled",
        f"SCENE={CASE.name}",
        f"LEVEL={level}",
        "NP=1",
    ]
    subprocess.run([*words, f"DPIV={recording}"], cwd=ROOT, env=inner, check=True)
    files = LabFiles(StageFiles(CASE, level), recording.name)
    found = pd.read_csv(files.folder / "causes.csv").set_index("cause")
    right = [
        found.verdict["pressure"] == truth.pressure,
        found.verdict["structure"] == truth.structure,
    ]
    cells = [
        f"{found.verdict[name]}: {factor * found.difference[name]:.{digits}f} ± {factor * found.band[name]:.{digits}f}"
        for name, factor, digits in (("pressure", 1e-3, 2), ("structure", float(np.degrees(1)), 1))
    ]
    said = ["no", "yes"][all(right)]
    return f"| {truth.about} | {' | '.join(cells)} | {said} |"


def main() -> None:
    """Make the runs and write the page's table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--level", default="draft", help="(default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=1, help="of the first finger's recording (default: 1)"
    )
    args = parser.parse_args()
    lines = [
        "| the recording's finger | pressure, kPa apart (RMS) | structure, ° apart (RMS) | both right |",
        "|---|---|---|---|",
    ]
    for number, truth in enumerate(TRUTHS):  # the page has what is done
        seed = args.seed + number
        lines.append(row(truth, args.level, record(truth, args.level, seed)))
        done = f"Level {args.level}, seeds {args.seed} to {seed}. {libraries()}."
        write_between(PAGE, "causes", "\n".join([*lines, "", done]))


if __name__ == "__main__":
    main()
