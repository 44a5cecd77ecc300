"""A texture so faint that its square underflows takes no step, in place of a division by zero."""

import numpy as np

from piv.correlation.newton_step import MOMENTS, newton_step


def test_faint_texture_takes_no_step():
    sums = np.full((MOMENTS, 2, 3), 1e-25, np.float32)
    step_x, step_y, _ = newton_step(sums, 1.0)
    assert not step_x.any()
    assert not step_y.any()
