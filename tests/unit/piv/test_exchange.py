"""Vectors of other programs: what a file does not state is asked for; what others open."""

import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.io import loadmat, savemat

from piv.fields.derived import derived
from piv.fields.statistics import statistics
from piv.files.child_process import read_in_child
from piv.foreign import pivlab
from piv.foreign.read import open_vectors, read_vectors
from piv.foreign.write import write_vectors
from piv.formats.plane_series import fields_of, make_plane, provenance, write_plane
from piv.formats.recording import window_of
from tests import pivlab_session
from tests.piv_command import made, piv


def make(times=None, seed=0):
    rng = np.random.default_rng(seed)
    x, y = 0.01 + 0.002 * np.arange(7), -0.03 + 0.002 * np.arange(5)
    shape = (5, 7) if times is None else (len(times), 5, 7)
    u, v = rng.normal(size=shape), rng.normal(size=shape)
    valid = rng.random(shape) > 0.2
    u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    flag = np.where(valid, 0, 2).astype(np.uint8)
    return make_plane(x, y, u, v, valid=valid, flag=flag, time=times)


@pytest.fixture(scope="module")
def everything():
    """What `piv stats` and `piv derive` make, of a series with provenance and of its instants."""
    rng = np.random.default_rng(3)
    x, y = 2.5 + 8 * np.arange(9.0), 8 * np.arange(7.0)
    u, v = rng.normal(size=(2, 40, 7, 9)).astype(np.float32)
    flag = rng.choice([0, 2, 5], size=u.shape, p=[0.8, 0.1, 0.1]).astype(np.uint8)
    u[flag == 2] = v[flag == 2] = np.nan
    std = rng.uniform(0.01, 0.02, u.shape).astype(np.float32)
    more = {"flag": flag, "u_std": std, "v_std": 2 * std}
    series = make_plane(x, y, u, v, time=np.arange(40) / 500, valid=flag == 0, **more)
    series.attrs = provenance(window=32.0, pairing="1-2,2-3") | {"scale_mm_per_px": 1e3}
    return {"series": derived(series.isel(time=slice(3))), "mean": derived(statistics(series))}


def test_pandas_opens_a_csv_with_every_field(tmp_path, everything):
    plane = everything["series"]
    write_vectors(plane, tmp_path / "a.csv")
    table = pd.read_csv(tmp_path / "a.csv", comment="#")
    assert set(table) == {"time", "x", "y", *fields_of(plane)}
    # as many digits as a single-precision number has
    np.testing.assert_allclose(table["u"], plane["u"].values.ravel(), rtol=1e-6)
    np.testing.assert_array_equal(table["x"][:9], plane["x"])
    assert "u in m/s" in (tmp_path / "a.csv").read_text().splitlines()[0]


def test_scipy_opens_a_mat_with_every_variable_and_its_unit(tmp_path, everything):
    plane = everything["series"]
    write_vectors(plane, tmp_path / "a.mat")
    found = loadmat(tmp_path / "a.mat")
    assert set(plane.variables) <= set(found)
    np.testing.assert_array_equal(found["u"], np.moveaxis(plane["u"].values, 0, -1))
    assert found["units"]["u"][0, 0][0] == "m/s"


def test_zones_of_other_programs_are_instants(tmp_path):
    zone = 'ZONE T="a", SOLUTIONTIME={}\nI=2, J=2\n0 0 1 2 1\n1 0 1 2 1\n0 1 1 2 0\n1 1 {} 2 1\n'
    path = tmp_path / "a.dat"
    names = 'VARIABLES="X(m)","Y(m)","U(m/s)","V(m/s)","CHC"\n'
    path.write_text(names + zone.format(0.5, 1) + zone.format(0.7, 3))
    series = read_vectors([path], y_axis="up")
    assert series["time"].values.tolist() == [0.5, 0.7]
    assert series["u"].values[:, 1, 1].tolist() == [1, 3]
    assert read_vectors([path], y_axis="up", rate=5.0)["time"].values.tolist() == [0.5, 0.7]
    with pytest.raises(ValueError, match=r"a\.dat: `rate` 50 contradicts its own times, 5 Hz"):
        read_vectors([path], y_axis="up", rate=50.0)


def test_scale_and_clock_reach_our_own_files(tmp_path):
    series = make(np.arange(3.0))
    for name in ("x", "y", "u", "v"):
        series[name].attrs["units"] = "px"
    series["time"].attrs["units"] = "frame"
    series.attrs = provenance(pairing="1-2,2-3", skip=0, frames=2, window=32.0)
    series = series.assign_coords(time=("time", np.arange(3) + 0.5, {"units": "frame"}))
    write_plane(derived(series, ("vorticity",)), tmp_path / "px.h5")
    done = f"--scale-mm-per-px 0.1 --interval 0.002 -o {tmp_path / 'm.h5'} --quiet".split()
    made("convert", tmp_path / "px.h5", *done)
    with open_vectors(tmp_path / "px.h5") as px, open_vectors(tmp_path / "m.h5") as plane:
        np.testing.assert_allclose(plane["u"], px["u"].values * 0.05)
        np.testing.assert_allclose(plane["x"], px["x"].values * 1e-4)
        np.testing.assert_allclose(plane["vorticity"], px["vorticity"].values * 500, rtol=1e-6)
        np.testing.assert_allclose(plane["time"], [0.001, 0.003, 0.005])
        units = [plane[n].attrs["units"] for n in ("u", "x", "time", "vorticity")]
        assert units == ["m/s", "m", "s", "1/s"]
        assert plane.attrs["interval"] == 0.002
        assert window_of(plane) == pytest.approx(0.0032)
    assert piv("convert", tmp_path / "m.h5", *done) == 2  # in m already


def test_a_file_named_nc_is_the_plane_series(tmp_path):
    series = make(np.array([0.0, 0.002]))
    write_vectors(series, tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc") as theirs, open_vectors(tmp_path / "a.nc") as ours:
        for opened in (theirs, ours, read_vectors(tmp_path / "a.nc")):
            np.testing.assert_array_equal(opened["u"], series["u"])


def test_vtk_opens_in_pyvista_with_its_time(tmp_path):
    import pyvista

    series = make(np.array([0.0, 0.002]))
    files = write_vectors(series, tmp_path / "a.vti")
    assert files[-1].suffix == ".pvd"
    reader = pyvista.get_reader(files[-1])
    assert reader.time_values == [0.0, 0.002]
    grid = pyvista.read(files[1])
    ok = series["valid"].values[1].ravel() == 1
    np.testing.assert_allclose(grid["velocity"][ok, 1], series["v"].values[1].ravel()[ok])
    np.testing.assert_allclose(grid.bounds[:4], [0.01, 0.022, -0.03, -0.022])


@pytest.mark.parametrize(
    "text",
    [
        "y [mm] x [mm] v [m/s] u [m/s]\n8 4 2 1\n8 6 2 1\n16 4 2 1\n16 6 2 1\n",
        "x [mm] ,y [mm] ,u [m/s] ,v [m/s]\n4 ,8 ,1 ,2\n6 ,8 ,1 ,2\n4 ,16 ,1 ,2\n6 ,16 ,1 ,2\n",
    ],
)
def test_titles_apart_by_blanks_and_commas_behind_them(tmp_path, text):
    """The first was read as x, y, u, v without units, the second's commas as decimal ones."""
    path = tmp_path / "a.txt"
    path.write_text(text)
    plane = read_vectors(path, y_axis="up")
    np.testing.assert_allclose(plane["x"], [0.004, 0.006])
    np.testing.assert_allclose(plane["u"], 1.0)
    np.testing.assert_allclose(plane["v"], 2.0)


def test_openpiv_text_asks_for_what_it_does_not_state(tmp_path):
    path = tmp_path / "a.txt"
    rows = "8 8 1.0 2.0 0 0\n16 8 1.0 2.0 1 0\n8 16 1.0 3.0 0 0\n16 16 1.0 2.0 0 1\n"
    path.write_text("# x y u v flags mask\n" + rows)
    told: dict = {}
    with pytest.raises(ValueError, match=r"`length_unit`.*`velocity_unit`.*`y_axis`"):
        read_vectors(path)
    needed = {"length_unit": "px", "velocity_unit": "px/frame", "y_axis": "down", "image_rows": 100}
    for option, value in needed.items():
        with pytest.raises(ValueError, match=f"`{option}`"):
            read_vectors([path], **told)
        told[option] = value
    in_px = read_vectors([path], **told)
    np.testing.assert_allclose(in_px["y"], [83, 91])
    assert in_px["u"].attrs["units"] == "px"
    with pytest.raises(ValueError, match="`interval`"):
        read_vectors([path], **told, scale_mm_per_px=0.1)
    told["interval"] = 0.002
    with pytest.raises(ValueError, match="`scale_mm_per_px`"):
        read_vectors([path], **told)
    told["scale_mm_per_px"] = 0.1
    plane = read_vectors([path], **told)
    np.testing.assert_allclose(plane["x"], [8e-4, 16e-4])
    np.testing.assert_allclose(plane["y"], [83e-4, 91e-4])  # 99 - 16, 99 - 8
    # the top row; down becomes negative
    assert plane["v"].values[1, 0] == pytest.approx(-2.0 * 1e-4 / 0.002)
    assert plane["v"].values[0, 0] == pytest.approx(-3.0 * 1e-4 / 0.002)
    assert plane["flag"].values.tolist() == [[0, 2], [0, 1]]


def test_tecplot_units_in_names_and_contradiction(tmp_path):
    path = tmp_path / "a.dat"
    path.write_text(
        'TITLE="MicroVec"\nVARIABLES="X(mm)","Y(mm)","U(m/s)","V(m/s)","CHC"\n'
        "ZONE I=2, J=2, F=POINT\n"
        "0 0 1 2 1\n1 0 1 2 1\n0 1 1 2 0\n1 1 1 2 1\n"
    )
    plane = read_vectors([path], y_axis="up")
    np.testing.assert_allclose(plane["x"], [0, 1e-3])
    assert plane["valid"].values.tolist() == [[1, 1], [0, 1]]
    with pytest.raises(ValueError, match="contradicts"):
        read_vectors([path], y_axis="up", length_unit="m")


PIVLAB = (
    "PIVlab, ASCII chart output\nFRAME: 1, filenames: A & B\n"
    "x [px],y [px],u [px/frame],v [px/frame],Vector type [-]\n"
)
TOLD = {"scale_mm_per_px": 1.0, "interval": 0.5, "image_rows": 32}


@pytest.mark.parametrize("version", ["ascii", "mat5", "mat73"])
def test_pivlab(tmp_path, version):
    path = tmp_path / "a.mat"
    if version == "ascii":
        path = tmp_path / "a.txt"
        rows = np.column_stack([values.T.ravel() for values in pivlab_session.FRAME.values()])
        path.write_text(PIVLAB + "\n".join(",".join(map(repr, row)) for row in rows.tolist()))
    else:
        getattr(pivlab_session, f"write_{version}")(path)
    plane = read_vectors([path], **TOLD)
    np.testing.assert_allclose(plane["y"], [0.015, 0.023])
    assert plane["valid"].values.tolist() == [[0, 1, 1], [1, 1, 0]]
    assert plane["u"].values[1, 0] == pytest.approx(0.8e-3 / 0.5)
    assert plane["v"].values[1, 0] == pytest.approx(-1.6e-3 / 0.5)


@pytest.mark.parametrize("compress", [False, True])
def test_a_session_of_pivlab_is_read_once(tmp_path, monkeypatch, compress):
    loads = []
    monkeypatch.setattr(pivlab, "read_in_child", lambda *a: loads.append(a) or read_in_child(*a))
    path = pivlab_session.write_mat5(tmp_path / "a.mat", 3, compress)
    series = read_vectors([path], rate=2.0, **TOLD)
    assert len(loads) == 1
    np.testing.assert_allclose(series["u"][:, 1, 0], 1.6e-3 * np.array([1, 2, 3]))
    np.testing.assert_allclose(series["time"], [0, 0.5, 1.0])
    savemat(path, dict.fromkeys(pivlab_session.FRAME, np.empty((0, 0), object)))
    with pytest.raises(ValueError, match=r"a\.mat: no vectors in it"):
        read_vectors([path], **TOLD)


def test_davis_through_lvpyio(tmp_path):
    lv = pytest.importorskip("lvpyio", reason="the DaVis reader, an extra, is not installed")
    values = np.zeros((6, 8), dtype=lv.vec2c)
    values["u"], values["v"] = np.arange(8), np.arange(6)[:, None]
    absent = np.zeros((6, 8), bool)
    absent[2, 3] = True
    buffer = lv.arrays_to_buffer([np.ma.array(values, mask=absent)])
    frame = buffer[0]
    frame.scales.x = lv.Scale(0.1, 5.0, "mm", "x")
    frame.scales.y = lv.Scale(-0.1, 50.0, "mm", "y")  # rows run down, the axis up
    frame.scales.i = lv.Scale(2.0, 0.0, "m/s", "velocity")
    frame.grid = lv.Grid(16, 16, 1)
    lv.write_buffer(buffer, str(tmp_path / "a.vc7"))
    plane = read_vectors([tmp_path / "a.vc7"])
    np.testing.assert_allclose(plane["x"], (5 + 1.6 * (np.arange(8) + 0.5)) * 1e-3)
    np.testing.assert_allclose(plane["y"], (50 - 1.6 * (np.arange(6) + 0.5))[::-1] * 1e-3)
    assert plane["valid"].values[3, 3] == 0  # row 2 from the top of 6
    assert (plane["valid"].values == 0).sum() == 1
    assert plane["u"].values[0, 7] == pytest.approx(14.0)
    # the lowest row: 5 rows down, times 2, upwards negative
    assert plane["v"].values[0, 0] == pytest.approx(-10.0)

    # the axis down as well: the same vectors stand on their heads
    frame.scales.y = lv.Scale(0.1, 50.0, "mm", "y")
    lv.write_buffer(buffer, str(tmp_path / "b.vc7"))
    down = read_vectors([tmp_path / "b.vc7"])
    np.testing.assert_allclose(down["y"], -(50 + 1.6 * (np.arange(6) + 0.5))[::-1] * 1e-3)
    np.testing.assert_allclose(down["v"].values, plane["v"].values)
    with pytest.raises(ValueError, match="contradicts the file, which states down"):
        read_vectors([tmp_path / "b.vc7"], y_axis="up")


def test_irregular_and_doubled_positions(tmp_path):
    told = {"length_unit": "m", "velocity_unit": "m/s", "y_axis": "up"}
    path = tmp_path / "a.txt"
    path.write_text("0 0 1 1\n1 0 1 1\n3.3 0 1 1\n0 1 1 1\n1 1 1 1\n3.3 1 1 1\n")
    with pytest.raises(ValueError, match="not regularly spaced"):
        read_vectors([path], **told)
    path.write_text("0 0 1 1\n1 0 1 1\n0 1 1 1\n1 1 1 1\n1 1 1 1\n")
    with pytest.raises(ValueError, match="same position"):
        read_vectors([path], **told)


def test_a_valid_vector_that_is_no_number_is_refused(tmp_path, capsys, monkeypatch):
    """Also deep in a series, which is looked at block by block."""
    from piv.formats import plane_series as module

    monkeypatch.setattr(module, "BLOCK", 70)  # two instants
    series, path = make(np.arange(5) / 500), tmp_path / "a.h5"
    series["u"][3, 2, 1], series["valid"][3, 2, 1] = np.nan, 1
    with monkeypatch.context() as unchecked:
        for name in ("piv.formats.plane_series.check_plane", "piv.foreign.write.check_plane"):
            unchecked.setattr(name, lambda _: None)
        write_vectors(series, path)
    says = "a plane has vectors marked valid at 0.006 s whose u or v is not finite"
    with pytest.raises(ValueError, match=says):
        read_vectors([path])
    for command, output in {"convert": "b.csv", "vortices": "b.csv", "plot": "b.png"}.items():
        assert piv(command, path, "-o", tmp_path / output, "--quiet") == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1
    assert not (tmp_path / "b.csv").exists()


def test_without_lvpyio_the_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lvpyio", None)
    (tmp_path / "a.vc7").write_bytes(b"DaVis")
    with pytest.raises(ValueError, match=r"a\.vc7: .*lvpyio.*pip install"):
        read_vectors([tmp_path / "a.vc7"])
