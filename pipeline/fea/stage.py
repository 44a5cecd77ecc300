"""`python -m pipeline.fea cases/<scene>`: bending states of the scene's actuator → `kinematics/states.h5`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from fileio.command import guarded
from fileio.errors import StageError
from fileio.formats.bending_states import write
from pipeline.fea.engines import bending_states
from pipeline.fea.sections import sections
from pipeline.fea.sensitivity import variations, with_uncertainty
from pipeline.scene.scene import load_scene


def run(case: Path, level: str, processes: int) -> None:
    """Analyse, add the uncertainty of the unit cell's inputs, write."""
    scene = load_scene(case, level)
    actuator, fea = sections(scene)
    try:
        with tqdm(total=len(fea.pressures), unit="state", disable=not sys.stderr.isatty()) as bar:
            states = bending_states(case, actuator, fea, bar.update)
        if fea.engine == "unit_cell" and fea.uncertainty:
            cases = len(variations(actuator, fea))
            with tqdm(total=cases, unit="variation", disable=not sys.stderr.isatty()) as bar:
                states = with_uncertainty(states, actuator, fea, processes, bar.update)
    except (ValueError, RuntimeError, FileNotFoundError) as error:
        raise StageError(str(error)) from error
    target = case / "kinematics" / "states.h5"
    write(target, states)
    print(f"{len(states.pressure)} states → {target}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m pipeline.fea", description=__doc__)
    parser.add_argument("case", type=Path, help="folder of the scene, as cases/single_finger")
    parser.add_argument("--level", default="coarse", help="level of the scene (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="for the variations (default: %(default)s)")
    given = parser.parse_args()
    guarded("fea", lambda: run(given.case, given.level, given.processes))


if __name__ == "__main__":
    main()
