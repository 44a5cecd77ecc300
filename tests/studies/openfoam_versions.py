"""The single finger by the OpenFOAM that is installed and by another one: how far apart they are, beside the level's own error.

python -m tests.studies.openfoam_versions /folder/of/an/OpenFOAM --level coarse   (make openfoam-versions OTHER=/folder)
What is solved already is not solved again. The table goes into docs/openfoam_versions.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pandas as pd

from fileio.formats.plane_series import read_plane
from fileio.formats.records import FORCES, RUN
from postprocess.evidence.stage_files import StageFiles
from postprocess.studies.table import middle_of_stroke, vortex
from postprocess.studies.tradeoff import errors_against
from tests.inner_make import inner_environment
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[2]
CASES = ROOT / "cases" / "single_finger" / "out" / "versions"
PAGE = ROOT / "docs" / "openfoam_versions.md"
LEVELS = ROOT / "cases" / "single_finger" / "studies" / "results" / "tradeoff.csv"
OF_LEVEL = {  # the difference between versions, and the level's own error against the finest run
    "circulation of the tip vortex, RMS": ("error_circulation", 100, "%"),
    "its centre, RMS": ("error_centre_mm", 1, "mm"),
    "velocity on the sheet, RMS of the tip's largest speed": ("error_velocity", 100, "%"),
    "force on the finger, RMS": ("error_force", 100, "%"),
}


def solved(level: str, other: str | None) -> StageFiles:
    """The single finger's run by the OpenFOAM installed, or the one in the folder `other`, from kinematics to vortices."""
    environment = inner_environment(**({"WM_PROJECT_DIR": other} if other else {}))
    said = subprocess.run(
        [sys.executable, "-m", "pipeline", "openfoam"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    if said.returncode:
        raise SystemExit(said.stderr.strip())
    scene = CASES / said.stdout.split()[-1]
    scene.mkdir(parents=True, exist_ok=True)
    states = 'motion = { states = "../../../kinematics/states.h5" }\n'
    (scene / "scene.toml").write_text(f'extends = "../../.."\n{states}')
    goals = [
        f"CASES={CASES.relative_to(ROOT)}",
        f"LEVEL={level}",
        "NP=1",
        f"{scene.name}.vortices_cfd",
    ]
    subprocess.run(["make", *goals], cwd=ROOT, env=environment, check=True)
    return StageFiles(scene, level)


def of_run(files: StageFiles) -> dict[str, str]:
    """What a run gave, as text."""
    run, force = (
        RUN.read(files.out / "run" / "run.json"),
        FORCES.read(files.out / "run" / "forces.csv"),
    )
    found = vortex(files)
    return {
        "mean circulation of the tip vortex": f"{found['circulation_cfd_m2_per_s'] * 1e4:.2f} cm²/s",
        "mean centre, x and y": f"{found['x_cfd_m'] * 1e3:.2f}, {found['y_cfd_m'] * 1e3:.2f} mm",
        "largest force": f"{(force['fx'] ** 2 + force['fy'] ** 2).max() ** 0.5 * 1e3:.2f} mN",
        "power balance unexplained": f"{100 * run['power_balance']['unexplained_fraction']:.2f} %",
    }


def equal(runs: list[StageFiles]) -> bool:
    """Whether forces, and velocity and pressure on the sheet, are the same bit for bit at all instants."""
    forces = [FORCES.read(files.out / "run" / "forces.csv") for files in runs]
    with (
        read_plane(runs[0].out / "sheet.h5") as first,
        read_plane(runs[1].out / "sheet.h5") as second,
    ):
        return forces[0].equals(forces[1]) and all(
            first[name].equals(second[name]) for name in ("u", "v", "p")
        )


def table(level: str, runs: list[StageFiles]) -> str:
    """The two runs, how far they are apart, and the level's own error."""
    names = [RUN.read(files.out / "run" / "run.json")["versions"]["OpenFOAM"] for files in runs]
    apart = errors_against(runs[0], runs[1], "cfd", middle_of_stroke(runs[0]))
    own = pd.read_csv(LEVELS, comment="#").set_index("run").loc[level]
    values = [of_run(files) for files in runs]
    rows = [
        [f"level {level}", *names],
        ["---"] * 3,
        *([key, *(of[key] for of in values)] for key in values[0]),
    ]
    rows += [
        [""] * 0,
        ["difference", f"{names[1]} against {names[0]}", f"error of the level {level}"],
        ["---"] * 3,
    ]
    for name, (key, factor, unit) in OF_LEVEL.items():
        rows.append([name, *(f"{factor * float(of[key]):.2g} {unit}" for of in (apart, own))])
    rows.append(
        [
            "forces, velocity and pressure of all instants",
            "equal bit for bit" if equal(runs) else "differ",
            "",
        ]
    )
    return "\n".join(f"| {' | '.join(row)} |" if row else "" for row in rows)


def main() -> None:
    """Solve, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", help="folder of another OpenFOAM, the one that has etc/bashrc")
    parser.add_argument("--level", default="coarse")
    args = parser.parse_args()
    runs = [solved(args.level, None), solved(args.level, args.other)]
    if runs[0].scene_folder == runs[1].scene_folder:
        raise SystemExit(
            f"{args.other}: the same version as the one installed; give the folder of another"
        )
    write_between(PAGE, args.level, f"{table(args.level, runs)}\n\nMeasured with {libraries()}.")


if __name__ == "__main__":
    main()
