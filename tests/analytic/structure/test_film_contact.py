"""The contact of a coupled pinch: a viscous film, by the chain in modelled water."""

import numpy as np
import pytest

from pipeline.couple.motion import CoupledMotion
from pipeline.kinematics.contact import gap
from pipeline.scene.scene import load_scene
from pipeline.structure.coupling import Coupling
from pipeline.structure.energy import energies, open_share
from tests.conftest import CLOSING, write_scene


def closed(folder, step):
    """Gap beyond the residual one (m) and force (N) over time; motion and open energy."""
    write_scene(folder, more=CLOSING, parent="pinch")
    scene = load_scene(folder, "tiny")
    numerics = scene.numerics.model_copy(update={"time_step": step})
    scene = scene.model_copy(update={"numerics": numerics})
    run = CoupledMotion(scene)
    history = run.history
    run.history = Coupling(history.chain, step, run.finger.model, history.pressure)
    for number in range(run.last):
        run.advance(number)
    history = run.history
    gaps = [gap(run.outline(*run.state(k)), scene.pinch) for k in range(run.last + 1)]
    parts = energies(
        history.chain, history.pressure, history.delta, step, run.finger.model, history.contact
    )
    return np.array(gaps) - scene.pinch.residual_gap, run.force, open_share(parts)


def test_an_impact_does_not_depend_on_the_time_step(tmp_path):
    """A force that kept the residual gap doubled its peak with half of the step, and rebounded."""
    gaps, force, impulse = {}, {}, {}
    for step in (1e-3, 5e-4):
        gaps[step], force[step], open_energy = closed(tmp_path / f"{step:g}", step)
        assert force[step].min() == 0  # it never pulls
        assert gaps[step].min() > 0
        # the film's work is in the balance; 2 % are allowed of a run
        assert open_energy < 0.02
        first = int(np.argmax(force[step] > 0))
        impulse[step] = step * force[step][first : first + round(0.03 / step)].sum()
        closest = np.minimum.accumulate(gaps[step])
        assert (gaps[step] - closest).max() < 0.02 * 0.003  # of the film's thickness
    assert impulse[1e-3] == pytest.approx(impulse[5e-4], rel=0.01)
    assert force[1e-3].max() == pytest.approx(force[5e-4].max(), rel=0.1)
    assert np.abs(gaps[1e-3] - gaps[5e-4][::2]).max() < 0.02 * 0.003
