"""`python -m pipeline.fea cases/<scene>`: bending states of the scene's actuator → `kinematics/states.h5`."""

from __future__ import annotations

import argparse
import platform
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from tqdm import tqdm

from pipeline.fea.analyse import bend
from pipeline.fea.settings import read_sections
from pipeline.fea.states import write


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m pipeline.fea", description=__doc__)
    parser.add_argument("case", type=Path, help="folder with scene.toml")
    case = parser.parse_args().case
    with open(case / "scene.toml", "rb") as file:
        actuator, fea = read_sections(tomllib.load(file))
    with tqdm(total=len(fea.pressures), unit="state", disable=not sys.stderr.isatty()) as bar:
        states = bend(actuator, fea, bar.update)
    about = {
        "geometry": actuator.model_dump(exclude={"materials"}),
        "material": actuator.materials.model_dump(),
        "solver": f"FElupe {version('felupe')}, unit cell",
        "versions": {name: version(name) for name in ("felupe", "numpy", "scipy", "tensortrax")}
        | {"python": platform.python_version()},
        "settings": fea.model_dump(),
    }
    target = case / "kinematics" / "states.h5"
    write(target, replace(states, about=about))
    print(f"{len(states.pressure)} states → {target}")


if __name__ == "__main__":
    main()
