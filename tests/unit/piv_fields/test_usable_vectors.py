"""Known uncertain vectors count as valid ones in all quantities of a field."""

import numpy as np
import pytest
import xarray as xr

from piv.fields.derived import derived
from piv.fields.lines import along_line
from piv.fields.spectra import space_spectrum, time_spectrum
from piv.fields.statistics import statistics
from piv.formats.plane_series import UNCERTAIN, make_plane, usable
from piv.plots.vectors import round_below, shaded, vorticity_scale
from piv.synthetic.plane_spline import PlaneField
from piv.vortices.find import find_vortices
from piv.vortices.lamb_oseen_fit import lamb_oseen
from piv.vortices.table import tabulate_vortices
from postprocess.evidence.fields import field_sums, frame

X = 1e-3 * np.arange(40)
CENTRE = 0.0205
CORE = np.hypot(X - CENTRE, (X - CENTRE)[:, None]) < 4e-3


@pytest.fixture
def sure():
    """A steady vortex of a core radius of four grid steps over ten instants, all vectors valid."""
    uv = lamb_oseen(*np.meshgrid(X, X), CENTRE, CENTRE, 1e-3, 4e-3)
    u, v = (np.tile(f, (10, 1, 1)) for f in uv)
    std = np.full(u.shape, 1e-4)
    flag = np.zeros(u.shape, np.uint8)
    return make_plane(X, X, u, v, time=0.01 * np.arange(10), flag=flag, u_std=std, v_std=std.copy())


@pytest.fixture
def unsure(sure):
    """The same with a core that is uncertain."""
    flag = sure["flag"].where(~CORE, UNCERTAIN)
    return sure.assign(valid=sure["valid"].where(~CORE, 0), flag=flag)


READERS = {
    "derived": lambda s: derived(s)["vorticity_std"],
    "statistics": lambda s: statistics(s)["n"],
    "line": lambda s: along_line(s, (0.001, 0.02), (0.038, 0.02))[["along", "u_std"]].to_array(),
    "time": lambda s: time_spectrum(s, [(CENTRE, CENTRE)])["averaged"],
    "space": lambda s: space_spectrum(s, "x"),
    "picture": lambda s: shaded(s.isel(time=0), "vorticity"),
    "continued": lambda s: PlaneField(s).plane(0),
    "vortices": lambda s: tabulate_vortices(s)[["x", "y", "circulation", "radius"]],
    "compared": lambda s: field_sums(s, s),
    "frame": lambda s: frame(s, 0)[1],
}


@pytest.mark.parametrize("name", READERS)
def test_an_uncertain_core_counts_as_if_it_were_valid(sure, unsure, name):
    one, other = (np.asarray(READERS[name](series)) for series in (unsure, sure))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["u", "v", "u_std", "v_std"])
def test_without_value_or_uncertainty_no_vector_is_usable(unsure, name):
    assert usable(unsure).all()
    assert (usable(unsure.assign({name: unsure[name].where(~CORE)})) == ~CORE).all()
    assert (usable(unsure.drop_vars(["u_std", "v_std"])) == ~CORE).all()


def test_uncertain_vectors_weigh_less_in_the_fit_of_a_vortex(unsure):
    """Core vectors a tenth too fast shift the circulation by 0.2 % at ten times the
    uncertainty, by 10 % at the same.
    """
    plane = unsure.isel(time=0)
    wrong = plane.assign({n: xr.where(CORE, 1.1 * plane[n], plane[n]) for n in ("u", "v")})
    far = wrong.assign({n: xr.where(CORE, 10 * plane[n], plane[n]) for n in ("u_std", "v_std")})
    misled, told = (find_vortices(p)[0].circulation_fit for p in (wrong, far))
    assert told == pytest.approx(1e-3, rel=0.005)
    assert abs(misled - 1e-3) > 5e-5


def test_a_small_core_is_within_the_colours_and_the_key_arrow_is_a_round_number():
    x = np.arange(0.0, 400, 4)
    u = 0.0 * x + 0 * x[:, None]
    u[50, 50] = 8.0  # one vector in ten thousand
    assert vorticity_scale(make_plane(x, x, u, 0 * u)) == pytest.approx(1.0)  # 8 px over 2 * 4 px
    assert [round_below(v) for v in (0.00137, 0.0499, 1.0, 7.3, 23.0)] == [0.001, 0.02, 1, 5, 20]
