"""The load in the sheet as a quantity of two sources."""

import numpy as np
import xarray as xr

from postprocess.evidence.line_loads import load_table


def series(times: list[float], moment: list[float], std: float = 0.0) -> xr.Dataset:
    """Moments on one finger at some instants."""
    value, axes = np.array(moment)[:, None], ("time", "finger")
    values = {"line_moment": (axes, value), "line_moment_std": (axes, np.full(value.shape, std))}
    return xr.Dataset(values, coords={"time": times})


def test_loads_of_two_sources_side_by_side() -> None:
    """Over the common time, the simulation's by lines."""
    table = load_table(
        series([0.05, 0.15, 0.25, 0.35], [1.65, 2.75, 3.85, 9.0], 0.2),
        series([0.0, 0.1, 0.2, 0.3], [1.0, 2.0, 3.0, 4.0]),
    )
    assert list(table["time"]) == [0.05, 0.15, 0.25]
    np.testing.assert_allclose(table["moment_cfd"], [1.5, 2.5, 3.5])
    assert set(table["moment_piv_std"]) == {0.2}
