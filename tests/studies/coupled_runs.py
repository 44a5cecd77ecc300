"""What the water does to the motion and to the tip vortex: a coupled run beside the prescribed one, for docs/coupling.md.

python -m tests.studies.coupled_runs --level coarse   (make coupled-docs, which solves the prescribed run first)
The coupled runs are made here, up to the vortices; what is there already of them stays.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fileio.errors import StageError
from fileio.formats.finger_loads import read_loads
from fileio.formats.plane_series import read_plane
from fileio.formats.records import COST, FORCES
from pipeline.scene.scene import load_scene
from pipeline.structure.energy import open_share
from pipeline.study.couple import couple
from postprocess.evidence.tip_vortex import dominant_track, read_vortices
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "coupling.md"
SCENE = ROOT / "cases" / "single_finger"
BENDS = (10, 20, 44, 60, 80)  # degrees, of the closing stroke
TIMES = (0.04, 0.1, 0.2, 0.3, 0.4)  # s
SOLVED = ("kinematics", "mesh", "case", "run", "loads")


def runs_of(home: Path, level: str) -> list[Path]:
    """Output folders of a coupled motion's runs, in order. StageError where there are none."""
    runs = sorted(home.glob(f"{level}_*/out/*/loads.h5"), key=lambda p: int(p.parts[-4].split("_")[1]))
    if not runs:
        raise StageError(f"{home}: no coupled runs of level {level}; run make SCENE COUPLED=1 LEVEL={level}")
    return [path.parent for path in runs]


def cpu(out: Path) -> float:
    """CPU seconds from the kinematics to the loads."""
    return sum(float(COST.read(out / "costs" / f"{stage}.json")["cpu_time"]) for stage in SOLVED)


def at_bends(out: Path) -> dict[int, tuple[float, float]]:
    """Circulation (m²/s) of the tip vortex and its distance (m) behind the tip, where the closing finger first has each bend."""
    with read_plane(out / "sheet.h5") as plane:
        time, bend = plane["time"].values, np.degrees(plane["bend"].values[:, 0])
    if bend.max() < BENDS[-1]:
        raise StageError(f"{out}: the finger bends to {bend.max():.1f}° only; {BENDS[-1]}° are needed")
    first = {b: float(time[np.argmax(bend >= b)]) for b in BENDS}
    window = (first[BENDS[1]], first[BENDS[-1]])
    track = dominant_track(read_vortices(out / "vortices_cfd.csv"), 0, window, "the CFD")
    nearest = {b: track.iloc[(track["time"] - at).abs().argmin()] for b, at in first.items()}
    return {b: (float(row["circulation"]), float(row["across_tip"])) for b, row in nearest.items()}


def peak_force(out: Path) -> float:
    """N."""
    table = FORCES.read(out / "run" / "forces.csv")
    return float(np.hypot(table["fx"], table["fy"]).max())


def page(level: str) -> str:
    """Tables as Markdown."""
    couple(load_scene(SCENE, level), ranks=1, target="vortices_cfd")
    prescribed = SCENE / "out" / level
    runs = runs_of(SCENE / "out" / "coupled", level)
    coupled = runs[-1]
    loads = read_loads(coupled / "loads.h5")
    step = loads["step"].values
    nearest = [int(np.argmin(np.abs(step - t))) for t in TIMES]
    rows = [
        (words, [f"{np.degrees(float(loads[name][i])):.1f}" for i in nearest])
        for words, name in (("coupled", "bend"), ("prescribed", "bend_unloaded"), ("in air", "bend_in_air"))
    ]
    before, after = at_bends(prescribed), at_bends(coupled)
    force = peak_force(prescribed), peak_force(coupled)
    spent = sum(cpu(out) for out in runs)
    lines = [
        "| bend, °, at " + ", ".join(f"{t:g}" for t in TIMES) + " s | |",
        "|---|---|",
        *(f"| {words} | {', '.join(values)} |" for words, values in rows),
        "",
        "| closing, at a bend of | Γ prescribed, cm²/s | coupled | behind the tip, mm: prescribed | coupled |",
        "|---|---|---|---|---|",
        *(
            f"| {b}° | {1e4 * before[b][0]:.0f} | {1e4 * after[b][0]:.0f} | {1e3 * before[b][1]:.1f} | {1e3 * after[b][1]:.1f} |"
            for b in BENDS
        ),
        "",
        f"Largest force on the finger {1e3 * force[0]:.0f} mN prescribed, {1e3 * force[1]:.0f} mN coupled. CPU {spent:.0f} s from kinematics"
        f" to loads of all {len(runs)} runs against {cpu(prescribed):.0f} s of the prescribed one. Energy open in the last: {open_share(loads):.1%}. {libraries()}.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Write the page's tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--level", default="coarse", help="(default: %(default)s)")
    write_between(PAGE, "coupled runs", page(parser.parse_args().level))


if __name__ == "__main__":
    main()
