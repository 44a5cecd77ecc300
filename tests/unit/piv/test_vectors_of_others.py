"""Files of vectors as TSI Insight, DaVis, OpenPIV and a saved session of PIVlab write them."""

import numpy as np
import pytest

from piv import make_plane, read_vectors
from piv.formats.plane_series import write_plane
from tests import pivlab_session

X, Y = np.meshgrid(np.arange(16.0, 80, 16), np.arange(16.0, 64, 16))
U, V = 0.1 * X, -0.05 * Y
PX = {"length_unit": "px", "velocity_unit": "px/frame", "y_axis": "down", "image_rows": 64}


def rows(form, *more):
    """Lines of x, y, u, v and further columns; rows of falling y, as most programs write them."""
    columns = [a[::-1].ravel() for a in (X, Y, U, V, *more)]
    return "".join(form % values + "\n" for values in zip(*columns, strict=True))


INSIGHT = (
    'TITLE="C:\\Run1.vec" VARIABLES="X {0}", "Y {0}", "U {1}", "V {1}", "CHC", DATASETAUXDATA '
    'Application="PIV" DATASETAUXDATA SourceImageWidth="96" DATASETAUXDATA SourceImageHeight="80" '
    'DATASETAUXDATA LengthUnit="mm" DATASETAUXDATA OriginInImageX="0.000000" DATASETAUXDATA '
    'OriginInImageY="{2}" DATASETAUXDATA MicrosecondsPerDeltaT="2000.000000"{3} ZONE I=4, J=3, '
    "F=POINT\n"
)


def test_insight_states_units_clock_and_direction(tmp_path):
    chc = np.where(X == 32, -1, np.where(X == 48, 4, 1))
    path = tmp_path / "Run1.vec"
    path.write_text(INSIGHT.format("mm", "m/s", 0, "") + rows("%f, %f, %f, %f, %d", chc))
    plane = read_vectors(path)
    np.testing.assert_allclose(plane["x"], X[0] * 1e-3)
    np.testing.assert_allclose(plane["y"], Y[:, 0] * 1e-3)
    np.testing.assert_array_equal(plane["valid"], X != 32)
    np.testing.assert_allclose(plane["v"].values[X != 32], V[X != 32], rtol=1e-5)
    assert plane.attrs["interval"] == pytest.approx(0.002)


@pytest.mark.parametrize("scale", ["", ' DATASETAUXDATA MicrometersPerPixelX="50.000000"'])
def test_insight_in_px_counts_from_its_origin(tmp_path, scale):
    """The lower left pixel of a picture of 80 rows is row 79; the origin lies at row 69."""
    path = tmp_path / "Run1.vec"
    head = INSIGHT.format("pixel", "pixel", 69, scale)
    path.write_text(head + rows("%f, %f, %f, %f, %d", 0 * X + 1))
    plane = read_vectors(path)
    pixel, speed = (5e-5, 5e-5 / 0.002) if scale else (1, 1)
    np.testing.assert_allclose(plane["y"], (Y[:, 0] + 10) * pixel)
    np.testing.assert_allclose(plane["u"], U * speed, rtol=1e-5)
    assert plane["u"].attrs["units"] == ("m/s" if scale else "px")


@pytest.mark.parametrize("falling", [True, False])
def test_davis_text_with_decimal_commas(tmp_path, falling):
    """Rows run from the top of the picture: positions that grow along them point down."""
    path, sign = tmp_path / "B00001.txt", 1 if falling else -1
    head = '#DaVis 8.1.6 2D-vector 16 4 3 "position" "mm" "position" "mm" "velocity" "m/s"\n'
    table = rows("%.4f\t%.4f\t%.4f\t%.4f").splitlines()
    table[2] = table[2].rsplit("\t", 2)[0] + "\t0\t-0"  # no vector
    lines = table if falling else sorted(table, key=lambda ln: float(ln.split("\t")[1]))
    path.write_text(head + "\n".join(lines).replace(".", ","))
    plane = read_vectors(path)
    np.testing.assert_allclose(plane["y"].values[::sign], sign * Y[:, 0] * 1e-3)
    assert plane["valid"].values[::sign].tolist() == [[1] * 4, [1] * 4, [1, 1, 0, 1]]
    np.testing.assert_allclose(plane["v"].values[::sign][0], sign * V[0])


def test_the_fifth_column_of_openpiv(tmp_path):
    """Signal to noise keeps all vectors; a flag or mask of 0 and 1 does not."""
    path = tmp_path / "a.txt"
    ratio = np.where(X == 32, 1.0, 20.5)
    path.write_text(rows("%g %g %.4f %.4f %.4f", ratio))
    plane = read_vectors(path, **PX)
    assert plane["valid"].values.all()
    np.testing.assert_allclose(plane["v"], -V[::-1])
    path.write_text(rows("%g %g %.4f %.4f %d", X == 32))
    assert (read_vectors(path, **PX)["flag"] == np.where(X == 32, 1, 0)).all()
    path.write_text("x [mm];y [mm];Velocity u [m/s];Velocity v [m/s];valid\n"
                    + rows("%g;%g;%.4f;%.4f;%d", X != 32).replace(".", ","))  # fmt: skip
    plane = read_vectors(path, y_axis="up")
    np.testing.assert_allclose(plane["u"].values[X != 32], U[X != 32])
    np.testing.assert_array_equal(plane["valid"], X != 32)


def test_a_saved_session_of_pivlab(tmp_path):
    path = pivlab_session.write_session(tmp_path / "a.mat")
    series = read_vectors(path, image_rows=32)
    assert series["u"].attrs["units"] == "px"
    np.testing.assert_allclose(series["u"][:, 1, 0], [0.8, 1.6])
    np.testing.assert_allclose(series["v"][:, 1, 0], [-1.6, -1.6])  # PIVlab's points down
    pivlab_session.write_session(
        path, calxy=1e-4, calu=0.05, expected_image_size=np.array([32.0, 48.0])
    )
    series = read_vectors(path, rate=10.0)  # 0.05 m/s per px/frame of 0.1 mm: 2 ms
    assert series.attrs["interval"] == pytest.approx(0.002)
    np.testing.assert_allclose(series["u"][:, 1, 0], [0.04, 0.08])
    np.testing.assert_allclose(series["y"], [15e-4, 23e-4])
    with pytest.raises(ValueError, match=r"`interval` 0.004 contradicts the file"):
        read_vectors(path, rate=10.0, interval=0.004)


@pytest.mark.parametrize(
    "option, text",
    [
        ({"scale_mm_per_px": 0.1}, "is in mm and m/s; omit `scale_mm_per_px`, which is of px"),
        ({"image_rows": 80}, "omit `image_rows`, which is of files that count px downwards"),
        ({"rate": 15.0}, "holds a single instant; omit `rate`, which is of a series"),
    ],
)
def test_what_a_file_in_mm_cannot_use_is_refused(tmp_path, option, text):
    path = tmp_path / "Run1.vec"
    path.write_text(INSIGHT.format("mm", "m/s", 0, "") + rows("%f, %f, %f, %f, %d", 0 * X + 1))
    with pytest.raises(ValueError, match=text):
        read_vectors(path, **option)
    assumed = {"scale_mm_per_px": 1.0, "image_rows": 8, "rate": 1.0, "interval": 1.0} | option
    plane = read_vectors(path, assumed=assumed)  # as piv score takes them of the truth
    np.testing.assert_allclose(plane["y"], Y[:, 0] * 1e-3)
    assert plane.attrs["interval"] == pytest.approx(0.002)


def test_a_single_plane_of_ours_has_no_rate(tmp_path):
    plane = make_plane(X[0], Y[:, 0], U, V)
    for name in ("x", "y", "u", "v"):
        plane[name].attrs["units"] = "px"
    write_plane(plane, tmp_path / "a.h5")
    with pytest.raises(ValueError, match="holds a single instant; omit `rate`"):
        read_vectors(tmp_path / "a.h5", scale_mm_per_px=0.1, interval=0.002, rate=5.0)
