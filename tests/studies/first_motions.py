"""Coupled runs of the single finger begun from two motions: what each run changes, and how far apart they end; docs/coupling.md.

python -m tests.studies.first_motions --level coarse   (make coupled-docs; what is there of the runs stays)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from fileio.atomic import update_text
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import read_loads
from pipeline.scene.scene import load_scene
from pipeline.structure.coupling import motion_values
from pipeline.study.couple import SHAPES, Structure, couple
from tests.studies.coupled_runs import PAGE, SCENE, runs_of
from tests.studies.pages import libraries, write_between

OTHER = """# Written by tests.studies.first_motions: the same finger, its coupled motion begun from the prescribed one.
extends = "../.."
[structure]
first_motion = "prescribed"
"""


def changes(scene: Path, level: str) -> pd.DataFrame:
    """Of each run its level, the change (m) of the tip's place that its loads make, and the share of energy that is open."""
    structure, rows = Structure(load_scene(scene, level)), []
    for out in runs_of(scene / "out" / "coupled", level):
        loads = read_loads(out / "loads.h5")
        delta = read_elastic_motion(out.parents[1] / SHAPES)["delta"].values
        after = structure.next(delta, loads)
        values = motion_values(structure.chain, structure.time, structure.pressure, after, delta)
        left = structure.open_energy(delta, loads)
        rows.append({"level": out.name, "tip": values["tip_change"], "energy": left})
    return pd.DataFrame(rows)


def apart(one: Path, other: Path) -> float:
    """Largest distance (m) of the tips of two motions, from the output folders of their runs."""
    ends = [read_elastic_motion(out.parents[1] / SHAPES).isel(point=-1) for out in (one, other)]
    return float(np.hypot(*(ends[0][name] - ends[1][name] for name in ("profile_x", "profile_y"))).max())


def page(level: str) -> str:
    """The table as Markdown."""
    other = SCENE / "out" / "begun_elsewhere"
    update_text(other / "scene.toml", OTHER)
    lines = [
        "| first motion | change of the tip's place after each run, mm | energy open in each |",
        "|---|---|---|",
    ]
    ends = []
    for words, folder in (("under the modelled water", SCENE), ("prescribed", other)):
        scene = load_scene(folder, level)
        couple(scene, ranks=1, target="loads")
        runs = runs_of(folder / "out" / "coupled", level)
        ends.append((runs[0], runs[-1]))
        table = changes(folder, level)
        moved = ", ".join(f"{row.level} {1e3 * row.tip:.2f}" for row in table.itertuples())
        lines.append(f"| {words} | {moved} | {', '.join(f'{left:.1%}' for left in table['energy'])} |")
    (first, last), (other_first, other_last) = ends
    limit = scene.structure.tolerance * scene.finger.length
    lines += [
        "",
        f"The tips of the first motions are {1e3 * apart(first, other_first):.1f} mm apart at most, those of the last"
        f" {1e3 * apart(last, other_last):.2f} mm; the tolerance is {1e3 * limit:.2f} mm. Level {level}. {libraries()}.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Make the runs and write the page's table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--level", default="coarse", help="(default: %(default)s)")
    write_between(PAGE, "first motions", page(parser.parse_args().level))


if __name__ == "__main__":
    main()
