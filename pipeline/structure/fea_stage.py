"""Stage fea: bending states of the scene's actuator, kinematics/states.h5 beside scene.toml."""

import os
import sys
from functools import partial
from pathlib import Path

from tqdm import tqdm

from pipeline.fea.cell.bending_law import TURNS
from pipeline.fea.engines import bending_states
from pipeline.fea.sections import check_length, sections
from pipeline.fea.sensitivity import variations, with_uncertainty
from pipeline.formats.bending_states import BendingStates, write
from pipeline.scene.read_toml import OWN_STATES
from pipeline.scene.scene import Scene, load_scene
from pipeline.structure.finger import modelled_share
from piv.files.errors import StageError
from piv.files.record import check_own

_SPARE = 1.15  # of the moments that are needed
_USED_BY = ("fea", "structure")  # of motion.source


def _further(scene: Scene, states: BendingStates) -> tuple[float, ...]:
    """Turns (rad) that the loads of modelled water need beyond the table of the states."""
    if scene.motion.source not in _USED_BY or scene.body is not None or len(states.pressure) < 2:
        return ()  # a single state is no motion
    try:
        share = modelled_share(scene, states)
    except StageError:  # of a scene that is not complete yet
        return ()
    return () if share <= 1 else (-_SPARE * share * TURNS[-1], _SPARE * share * TURNS[-1])


def run(scene: Scene, quiet: bool = False, output: Path | None = None, processes: int = 2) -> None:
    """Analyse, add the uncertainty of the unit cell's inputs, write `output`.

    Without one: kinematics/states.h5 beside scene.toml, where it holds for all levels.
    """
    actuator, fea = sections(scene)
    if fea.engine == "unit_cell":
        check_length(scene, actuator)
    try:
        with tqdm(total=len(fea.pressures), unit="state", disable=not sys.stderr.isatty()) as bar:
            states = bending_states(
                scene.folder, actuator, fea, bar.update, partial(_further, scene)
            )
        if fea.engine == "unit_cell" and fea.uncertainty:
            cases = len(variations(actuator, fea))
            with tqdm(total=cases, unit="variation", disable=not sys.stderr.isatty()) as bar:
                states = with_uncertainty(states, actuator, fea, processes, bar.update)
    except (ValueError, RuntimeError, FileNotFoundError) as error:
        raise StageError(str(error)) from error
    target = output or scene.folder / OWN_STATES
    check_own(target.parent)
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
