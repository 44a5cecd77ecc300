"""Coupled runs beside prescribed ones: how many they take and what they cost, the motion, the tip vortex; for docs/coupling.md.

python -m tests.studies.coupled_runs --level coarse   (make coupled-docs)
Runs are solved here on one rank, so that CPU times compare; what is there of them already stays.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.atomic import update_text
from fileio.errors import StageError
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import read_loads
from fileio.formats.plane_series import read_plane
from fileio.formats.records import COST, FORCES
from pipeline.scene.scene import load_scene
from pipeline.structure.coupling import motion_values
from pipeline.study.couple import CHEAP, SHAPES, Structure, couple, make_run
from postprocess.evidence.tip_vortex import dominant_track, read_vortices
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "coupling.md"
BENDS = (10, 20, 44, 60, 80)  # degrees, of the closing stroke
TIMES = (0.04, 0.1, 0.2, 0.3, 0.4)  # s
SOLVED = ("kinematics", "mesh", "case", "run", "loads")
PINCH_END = 0.224  # s: the prescribed tips of cases/pinch touch at 0.24 s


@dataclass(frozen=True)
class Coupled:
    """A scene and its coupled runs at a level; `differs`: lines of a scene below `folder`/out that the folder's own has not."""

    name: str
    folder: Path
    level: str
    differs: str = ""
    first_motion: str = "under the modelled water"

    @property
    def scene(self) -> Path:
        return self.folder / "out" / "coupling_study" if self.differs else self.folder

    def solve(self, target: str) -> None:
        """The prescribed run and the coupled ones, up to the loads and `target`."""
        if self.differs:
            text = '# Written by tests.studies.coupled_runs.\nextends = "../.."\n' + self.differs
            update_text(self.scene / "scene.toml", text)
        alone = self.prescribed.parents[1]
        for each in dict.fromkeys(("loads", target)):
            make_run(alone.parent, alone.name, self.level, each, ranks=1)
        couple(load_scene(self.scene, self.level), ranks=1, target=target)

    @property
    def prescribed(self) -> Path:
        """Output folder of the prescribed run: where the first motion alone differs, that of the folder's own scene."""
        scene = self.folder if self.first_motion == "prescribed" else self.scene
        return scene / "out" / self.level

    @cached_property
    def runs(self) -> list[Path]:
        """Output folders of the coupled runs, in order."""
        found = (self.scene / "out" / "coupled").glob(f"{self.level}_*/out/*/loads.h5")
        return [path.parent for path in sorted(found, key=lambda p: int(p.parts[-4].split("_")[1]))]

    @property
    def loads(self) -> xr.Dataset:
        """Of the last coupled run."""
        return read_loads(self.runs[-1] / "loads.h5")

    def iteration(self) -> list[tuple[str, float]]:
        """Of each run its level with the change (mm) of the tip's place that its loads make, and the share of energy that is open."""
        structure, found = Structure(load_scene(self.scene, self.level)), []
        for out in self.runs:
            loads = read_loads(out / "loads.h5")
            delta = read_elastic_motion(out.parents[1] / SHAPES)["delta"].values
            after = structure.next(delta, loads)
            values = motion_values(
                structure.chain, structure.time, structure.pressure, after, delta
            )
            moved = f"{out.name} {1e3 * values['tip_change']:.2f}"
            found.append((moved, structure.open_energy(delta, loads)))
        return found

    def row(self) -> str:
        """The iteration and what it cost."""
        moved, energy = zip(*self.iteration(), strict=True)
        spent, once = sum(map(cpu, self.runs)), cpu(self.prescribed)
        cells = (self.name, self.first_motion, ", ".join(moved), ", ".join(f"{left:.1%}" for left in energy), f"{spent:.0f}",
                 f"{once:.0f}", f"{spent / once:.1f}")  # fmt: skip
        return f"| {' | '.join(cells)} |"

    def bends(self) -> list[str]:
        """Rows of the bend at TIMES: prescribed, coupled and in air, and the largest force of the first two."""
        loads = self.loads
        step = loads["step"].values
        at = [int(np.argmin(np.abs(step - t))) for t in TIMES if t <= step[-1] + 1e-9]
        force = [f"{1e3 * peak_force(out):.0f}" for out in (self.prescribed, self.runs[-1])]
        parts = (("prescribed", "bend_unloaded"), ("coupled", "bend"), ("in air", "bend_in_air"))
        rows = []
        for (words, name), largest in zip(parts, [*force, ""], strict=True):
            cells = [f"{np.degrees(float(loads[name][i])):.1f}" for i in at] + [""] * (
                len(TIMES) - len(at)
            )
            rows.append(f"| {self.name}, {words} | {' | '.join([*cells, largest])} |")
        return rows


def cpu(out: Path) -> float:
    """CPU seconds from the kinematics to the loads."""
    return sum(float(COST.read(out / "costs" / f"{stage}.json")["cpu_time"]) for stage in SOLVED)


def at_bends(out: Path) -> dict[int, tuple[float, float]]:
    """Circulation (m²/s) of the tip vortex and its distance (m) behind the tip, where the closing finger first has each bend."""
    with read_plane(out / "sheet.h5") as plane:
        time, bend = plane["time"].values, np.degrees(plane["bend"].values[:, 0])
    if bend.max() < BENDS[-1]:
        raise StageError(
            f"{out}: the finger bends to {bend.max():.1f}° only; {BENDS[-1]}° are needed"
        )
    first = {b: float(time[np.argmax(bend >= b)]) for b in BENDS}
    window = (first[BENDS[1]], first[BENDS[-1]])
    track = dominant_track(read_vortices(out / "vortices_cfd.csv"), 0, window, "the CFD")
    nearest = {b: track.iloc[(track["time"] - at).abs().argmin()] for b, at in first.items()}
    return {b: (float(row["circulation"]), float(row["across_tip"])) for b, row in nearest.items()}


def peak_force(out: Path) -> float:
    """Largest force (N) of the water in the plane of the sheet."""
    table = FORCES.read(out / "run" / "forces.csv")
    return float(np.hypot(table["fx"], table["fy"]).max())


def apart(one: Path, other: Path) -> float:
    """Largest distance (m) of the tips of two motions, from the output folders of their runs."""
    ends = [read_elastic_motion(out.parents[1] / SHAPES).isel(point=-1) for out in (one, other)]
    return float(
        np.hypot(*(ends[0][name] - ends[1][name] for name in ("profile_x", "profile_y"))).max()
    )


def page(level: str) -> str:
    """Runs, motions and vortices as Markdown."""
    cases = ROOT / "cases"
    single = Coupled("finger, 20 kPa", cases / "single_finger", level)
    other = Coupled(single.name, single.folder, level, '[structure]\nfirst_motion = "prescribed"\n', "prescribed")  # fmt: skip
    deflated = Coupled("finger, −20 kPa", cases / "single_deflate", level)
    until = f"[motion]\nend_time = {PINCH_END}\n"
    pinch = Coupled(f"pinch until {PINCH_END} s ({CHEAP})", cases / "pinch", CHEAP, until)
    single.solve("vortices_cfd")
    for each in (deflated, pinch, other):
        each.solve("loads")
    scene = load_scene(single.folder, level)
    limit = scene.structure.tolerance * scene.finger.length
    before, after = at_bends(single.prescribed), at_bends(single.runs[-1])
    return "\n".join(
        [
            "| scene | first motion | change of the tip's place by each run, mm | energy open in each | CPU of all, s | of the prescribed run | ratio |",
            "|---|---|---|---|---|---|---|",
            *(each.row() for each in (single, other, deflated, pinch)),
            "",
            f"Allowed: {1e3 * limit:.2f} mm. Begun from two motions whose tips are {1e3 * apart(single.runs[0], other.runs[0]):.1f} mm apart"
            f" at most, the runs of 20 kPa end with tips {1e3 * apart(single.runs[-1], other.runs[-1]):.2f} mm apart. CPU time is from"
            f" kinematics to loads, on one rank.",
            "",
            f"| bend, °, at | {' | '.join(f'{t:g} s' for t in TIMES)} | largest force, mN |",
            "|---|" + "---|" * (len(TIMES) + 1),
            *(line for each in (single, deflated, pinch) for line in each.bends()),
            "",
            "| 20 kPa, closing, at a bend of | Γ prescribed, cm²/s | coupled | behind the tip, mm: prescribed | coupled |",
            "|---|---|---|---|---|",
            *(
                f"| {b}° | {1e4 * before[b][0]:.0f} | {1e4 * after[b][0]:.0f} | {1e3 * before[b][1]:.1f} | {1e3 * after[b][1]:.1f} |"
                for b in BENDS
            ),
            "",
            f"Level {level}. {libraries()}.",
        ]
    )


def main() -> None:
    """Make the runs and write the page's tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--level", default="coarse", help="(default: %(default)s)")
    write_between(PAGE, "coupled runs", page(parser.parse_args().level))


if __name__ == "__main__":
    main()
