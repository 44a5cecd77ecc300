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
    cfd, piv = (find_vortices(plane)[0] for plane in (fine, coarse))
    # the report's own limits: 1.5 mm and 5 % between CFD and PIV; here a fifth of that in place
    assert np.hypot(cfd.x - piv.x, cfd.y - piv.y) < 0.3e-3
    assert piv.circulation == pytest.approx(cfd.circulation, rel=0.05)
    # against the truth: layers in the disc belong to the vortex' surroundings, wall hides half of
    # it
    assert np.hypot(cfd.x - centre[0], cfd.y - centre[1]) < 0.12 * core
    assert cfd.circulation == pytest.approx(0.01, rel=0.2)
    assert cfd.core_radius == pytest.approx(core, rel=0.12)
    assert abs(cfd.circulation - 0.01) < 3 * cfd.circulation_std
    others = [abs(w.circulation) for w in find_vortices(fine)[1:]]
    assert all(q < 0.6 * abs(cfd.circulation) for q in others)  # dominant


def test_a_young_vortex_at_the_wall_is_not_drawn_into_the_body():
    errors, expected = [], []
    for seed in range(10):
        plane, circulation, core = young_scene(1e-3, hidden=0.5e-3, noise=5e-3, seed=seed)
        near = [
            w for w in find_vortices(plane, stencil_radius=3e-3) if np.hypot(w.x, w.y) < 2 * core
        ]
        assert near, seed
        errors.append([near[0].circulation / circulation - 1, near[0].core_radius / core - 1])
        expected.append([near[0].circulation_std / circulation, near[0].core_radius_std / core])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    # 0.20 and 0.15 without the region's word on the core radius: a wider core, a disc further in
    # the body, more circulation
    assert (rms < [0.12, 0.10]).all(), rms
    # standard errors hold the layer's misfit too, which is the same in every realisation
    assert (rms < np.sqrt(np.mean(np.square(expected), axis=0))).all(), expected
    fine, circulation, core = young_scene(0.5e-3)
    whole = find_vortices(fine, stencil_radius=3e-3)[0]
    assert whole.circulation == pytest.approx(circulation, rel=0.12)  # 0.19 without
    assert whole.core_radius == pytest.approx(core, rel=0.1)
    assert len(find_vortices(fine, stencil_radius=3e-3)) == 1  # the layer is none
