"""piv vortices and render from the command line."""

import json

import numpy as np
import pandas as pd
import pytest

from piv.commands import render, vortices
from piv.formats.plane_series import make_plane, write_plane
from piv.formats.vortex_table import read_vortices
from piv.vortices.lamb_oseen_fit import lamb_oseen
from tests.piv_command import made, piv


def write_series(path, n=5, time=True, finger=True):
    x, y = np.arange(0, 0.0401, 1e-3), np.arange(0, 0.0321, 1e-3)
    xx, yy = np.meshgrid(x, y)
    planes = [lamb_oseen(xx, yy, 0.018 + 2e-4 * k, 0.016, 0.004, 4e-3) for k in range(n)]
    u, v = (np.array([p[c] for p in planes]) for c in (0, 1))
    if not time:
        write_plane(make_plane(x / 1.25e-4, y / 1.25e-4, u[0], v[0]), path)
        return
    more = {
        "tip": np.tile([0.01, 0.016], (n, 1, 1)),
        "tip_direction": np.tile([0.0, -1.0], (n, 1, 1)),
        "dorsal_direction": np.tile([1.0, 0.0], (n, 1, 1)),
    }
    plane = make_plane(x, y, u, v, time=np.arange(n) / 500, **(more if finger else {}))
    write_plane(plane, path, tip_width=0.004)


def test_vortices_of_a_series_are_one_track_in_the_tip_frame(tmp_path):
    write_series(tmp_path / "piv.h5")
    made("vortices", tmp_path / "piv.h5", "-o", tmp_path / "v.csv")
    table = read_vortices(tmp_path / "v.csv")
    assert list(table["track"]) == [0] * 5
    assert set(table["side"]) == {"dorsal"}
    np.testing.assert_allclose(table["x_fit"], 0.018 + 2e-4 * np.arange(5), atol=1e-6)
    # the region's centroid: a hundredth of a cell of 1 mm
    np.testing.assert_allclose(
        table["tip_distance"], (0.008 + 2e-4 * np.arange(5)) / 0.004, rtol=2e-3
    )
    np.testing.assert_allclose(table["lifetime"], 4 / 500)
    first = (tmp_path / "v.csv").read_text().splitlines()[0]
    assert json.loads(first[2:])["format"] == "vortices"


def test_processes_change_no_bit(tmp_path):
    write_series(tmp_path / "piv.h5")
    for count in ("1", "2"):
        words = [
            "vortices",
            str(tmp_path / "piv.h5"),
            "-o",
            str(tmp_path / f"{count}.csv"),
            "--quiet",
        ]
        assert piv(*words, "--threads", count) == 0
    assert (tmp_path / "1.csv").read_bytes() == (tmp_path / "2.csv").read_bytes()


def test_single_plane_in_pixels_needs_no_other_option(tmp_path):
    write_series(tmp_path / "pair.h5", time=False)
    made("vortices", tmp_path / "pair.h5", "-o", tmp_path / "v.csv")
    table = read_vortices(tmp_path / "v.csv")
    assert len(table) == 1
    assert table["x_fit"][0] == pytest.approx(0.018 / 1.25e-4, rel=1e-3)


def test_settings_in_memory(tmp_path):
    write_series(tmp_path / "piv.h5", finger=False)
    for least, count in ((1.0, 0), (0.001, 5)):
        vortices.make(
            tmp_path / "piv.h5", tmp_path / "v.csv", {"min_circulation": least}, quiet=True
        )
        assert len(read_vortices(tmp_path / "v.csv")) == count
    for command in (vortices, render):
        with pytest.raises(ValueError, match="unknown setting 'colour'"):
            command.make(tmp_path / "piv.h5", tmp_path / "out", {"colour": 1})


def test_a_set_radius_is_that_of_the_circulation(tmp_path, capsys):
    write_series(tmp_path / "piv.h5")
    words = "vortices", tmp_path / "piv.h5", "-o", tmp_path / "v.csv"
    assert piv(*words, "--radius", "0.006") == 0
    assert " m²/s within 0.006 m of its centre" in capsys.readouterr().out
    table = read_vortices(tmp_path / "v.csv")
    # of a core of 4 mm, bilinear on cells of 1 mm
    within = 0.004 * -np.expm1(-((6 / 4) ** 2))
    np.testing.assert_allclose(table["circulation"], within, rtol=0.02)
    np.testing.assert_allclose(table["circulation_radius"], 0.006)


def test_the_circulation_round_a_point_is_written(tmp_path, capsys):
    write_series(tmp_path / "pair.h5", time=False)
    words = "profile", tmp_path / "pair.h5", "-o", tmp_path / "p.csv"
    assert piv(*words, "--around", "144", "128", "--radius", "80") == 0
    assert ": 10 circles, 100.0% valid, largest |circulation| " in capsys.readouterr().out
    assert list(pd.read_csv(tmp_path / "p.csv")["r"]) == [8.0 * k for k in range(1, 11)]
    assert piv(*words, "--line", "0", "0", "80", "0", "--radius", "80") == 2


def test_bad_input_is_one_sentence_and_exit_code_2(tmp_path, capsys):
    assert piv("vortices", tmp_path / "none.h5", "-o", tmp_path / "v.csv") == 2
    assert capsys.readouterr().err.strip().endswith("none.h5: no such file")
    write_series(tmp_path / "piv.h5")
    args = ["render", str(tmp_path / "piv.h5"), "-o", str(tmp_path / "i.h5"), "--quiet"]
    assert piv(*args) == 2
    assert "the camera sees x from" in capsys.readouterr().err
    assert (
        piv(*args, "--width-px", "64", "--height-px", "48", "--no-truth", "--density-ppp", "-1")
        == 2
    )
    assert "density_ppp must be positive" in capsys.readouterr().err


def test_render_writes_recording_and_truth(tmp_path):
    write_series(tmp_path / "piv.h5")
    args = f"render {tmp_path / 'piv.h5'} -o {tmp_path / 'i.h5'} --quiet --seed 3".split()
    assert piv(*args, "--width-px", "128", "--height-px", "96") == 0
    assert (tmp_path / "i.h5").exists()
    made("vortices", tmp_path / "i_truth.h5", "-o", tmp_path / "t.csv")
    table = read_vortices(tmp_path / "t.csv")
    # at mid-times, in the middle between two frames' vortices; the frame interval's curvature moves
    # it by micrometres
    np.testing.assert_allclose(table["x_fit"], 0.0181 + 2e-4 * np.arange(4), atol=2e-5)


def test_a_row_without_a_number_is_refused_by_its_line(tmp_path):
    path = tmp_path / "v.csv"
    path.write_text("time,x,y,circulation,radius\n0,1,1,2,1\n1,1,1,,1\n")
    with pytest.raises(ValueError, match=r"v\.csv: row 2 has no number in 'circulation'"):
        read_vortices(path)
