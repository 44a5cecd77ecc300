"""One dominant vortex next to a moving finger, alike on a CFD and on a PIV grid."""

import numpy as np
import pytest

from piv.vortices.find import find_vortices
from tests.analytic.piv.tip_scene import tip_scene, young_scene


@pytest.mark.parametrize("core", [3e-3, 5e-3])
@pytest.mark.parametrize("gap", [1.2, 1.5, 2.0])
def test_tip_vortex_is_the_same_on_both_grids(gap, core):
    fine, centre = tip_scene(0.5e-3, core, gap)
    coarse, _ = tip_scene(
        1e-3, core, gap, blur=0.8e-3, noise=2e-3
    )  # 0.03 px at 0.125 mm/px and 500 Hz
    cfd, piv = (find_vortices(plane, scale=2e-3)[0] for plane in (fine, coarse))
    # the report's own limits: 1.5 mm and 5 % between CFD and PIV; here a fifth of that in place
    assert np.hypot(cfd.x - piv.x, cfd.y - piv.y) < 0.3e-3
    assert piv.circulation == pytest.approx(cfd.circulation, rel=0.05)
    # against the truth: layers in the disc of the fit belong to the vortex's surroundings, and the
    # wall hides half of it
    assert np.hypot(cfd.x_fit - centre[0], cfd.y_fit - centre[1]) < 0.12 * core
    assert cfd.circulation_fit == pytest.approx(0.01, rel=0.2)
    assert cfd.core_radius == pytest.approx(core, rel=0.12)
    others = [abs(w.circulation) for w in find_vortices(fine, scale=2e-3)[1:]]
    assert all(q < 0.6 * abs(cfd.circulation) for q in others)  # dominant


def test_a_young_vortex_at_the_wall_is_found_and_its_layer_is_not():
    for seed in range(5):
        plane, _, core = young_scene(1e-3, hidden=0.5e-3, noise=5e-3, seed=seed)
        near = find_vortices(plane, scale=2e-3)
        assert len(near) == 1, seed
        assert near[0].circulation > 0
        assert np.hypot(near[0].x, near[0].y) < core
    assert len(find_vortices(young_scene(0.5e-3)[0], scale=2e-3)) == 1
