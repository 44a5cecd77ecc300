"""Stage fea: bending states of the scene's actuator, kinematics/states.h5 beside scene.toml."""

import os
import sys
from pathlib import Path

from tqdm import tqdm

from pipeline.fea.engines import bending_states
from pipeline.fea.sections import check_length, sections
from pipeline.fea.sensitivity import variations, with_uncertainty
from pipeline.formats.bending_states import write
from pipeline.scene.read_toml import OWN_STATES
from pipeline.scene.scene import Scene, load_scene
from piv.files.errors import StageError

_USED_BY = ("fea", "structure")  # of motion.source


def run(scene: Scene, quiet: bool = False, output: Path | None = None, processes: int = 2) -> None:
    """Analyse, add the uncertainty of the unit cell's inputs, write `output`.

    Without one: kinematics/states.h5 beside scene.toml, where it holds for all levels.
    """
    actuator, fea = sections(scene)
    if fea.engine == "unit_cell":
        check_length(scene, actuator)
    try:
        with tqdm(total=len(fea.pressures), unit="state", disable=not sys.stderr.isatty()) as bar:
            states = bending_states(scene.folder, actuator, fea, bar.update)
        if fea.engine == "unit_cell" and fea.uncertainty:
            cases = len(variations(actuator, fea))
            with tqdm(total=cases, unit="variation", disable=not sys.stderr.isatty()) as bar:
                states = with_uncertainty(states, actuator, fea, processes, bar.update)
    except (ValueError, RuntimeError, FileNotFoundError) as error:
        raise StageError(str(error)) from error
    target = output or scene.folder / OWN_STATES
    write(target, states)
    if not quiet:
        print(f"fea: {len(states.pressure)} states → {target}")
    motion = load_scene(scene.folder, scene.level).motion  # the new file may replace a parent's
    used = motion.source in _USED_BY and motion.states is not None
    if output is None and not (
        used and os.path.samefile(scene.folder / str(motion.states), target)
    ):
        print(
            f"fea: warning: {scene.folder / 'scene.toml'} has motion.source = {motion.source!r} and"
            f" motion.states = {motion.states!r}, so nothing uses these states; give"
            f" motion.source = 'fea' and motion.states = '{OWN_STATES}'"
        )
