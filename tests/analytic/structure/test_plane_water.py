"""The water of a plane flow, whose loads are shared, against that of the finger in space."""

import numpy as np
import pytest

from pipeline.case.interval_case import sides
from pipeline.couple.motion import CoupledMotion
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.mesh.wall_layers import outline_at
from pipeline.scene.scene import load_scene
from pipeline.structure.chain import MIDDLE, placed
from pipeline.structure.finger import Posed, copies
from pipeline.structure.water_inertia import forces_of_water
from tests.conftest import CASES, meshes_of, prepare

_NUDGE = 1e-4  # rad


def added_inertia(scene):
    """Of the water about a finger that begins to bend evenly, kg m²; potential flow on its mesh."""
    run, built = CoupledMotion(scene), meshes_of(prepare(scene))[0]
    chain, planform = run.finger.chain, built.planform
    mode = (np.cumsum(chain.lengths) - 0.5 * chain.lengths) / chain.lengths.sum()
    still, nodes = 0 * mode, built.motion.nodes(0.0)
    moved = (run.outline(0.0, _NUDGE * mode) - run.outline(0.0, still)) / _NUDGE
    walls = np.zeros((1, *nodes.shape))
    walls[:, planform["wall"].values] = outline_at(moved[None], planform["material"].values)
    gaps = sides(planform) == OUTER_PATCHES.index("gap")
    place, force = forces_of_water(
        planform, built.sweep, nodes, walls, gaps, scene.fluid.density, copies(scene)
    )
    push, across, torque = -Posed(run.finger, 0.0, still).of_forces(place, force[0])[1:].T
    unloaded = chain.unloaded(np.zeros(1))
    at = [placed(unloaded, 0, turn) for turn in (still, _NUDGE * mode)]
    way = (at[1].content - at[0].content)[MIDDLE] / _NUDGE * np.conj(at[0].heading)
    return float((push * way.real + across * way.imag + torque * mode).sum())


@pytest.mark.parametrize("width", [0.028, 0.014])
def test_the_water_of_the_plane_level_is_that_of_the_finger(tmp_path, width):
    """25 %: a finger is not slender (its ends take 17 % at 28 mm, its thickness adds at 14 mm).

    Without the share the plane's water is 2.3 and 3.5 times that in space.
    """
    found = []
    for level in ("smoke", "draft"):
        values = {"motion.source": "structure", "motion.end_time": 0.05, "finger.width": width}
        scene = load_scene(CASES / "single_finger", level, values, tmp_path / level)
        scene.out.mkdir()
        found.append(added_inertia(scene))
    plane, space = found
    assert plane == pytest.approx(space, rel=0.25)
    assert copies(load_scene(CASES / "single_finger", "smoke")) < 0.5


def test_a_pressure_with_a_row_a_second_moves_a_coupled_finger(tmp_path):
    """Shapes of its own 2 s read the table again, of which two rows lay before them."""
    rows = "".join(f"{second},{1e3 * min(second, 20)}\n" for second in range(23))
    (tmp_path / "slow.csv").write_text(f"t,p\n{rows}")
    slow = {"pressure_csv": str(tmp_path / "slow.csv"), "strokes": [], "end_time": 22.0}
    keys = {f"motion.{key}": value for key, value in slow.items()}
    keys |= {"motion.source": "structure", "numerics.time_step": 0.02}
    keys |= {"sheet.rate_hz": 50.0, "camera.frame_rate_hz": 50.0}
    scene = load_scene(CASES / "single_finger", "smoke", keys, tmp_path / "out")
    assert CoupledMotion(scene).last == 1100
