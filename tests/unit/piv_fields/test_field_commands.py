"""stats, derive, profile, spectrum and their pictures from the command line."""

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import make_plane, read_plane, write_plane
from tests.piv_command import made, piv

X, Y = 0.001 * np.arange(16), 0.001 * np.arange(12)
XX, YY = np.meshgrid(X, Y)
TIMES = np.arange(80) * 0.01


@pytest.fixture
def file(tmp_path):
    """Solid rotation that turns back and forth with a period of 0.2 s, and a finger's bend."""
    wave = np.sin(2 * np.pi * TIMES / 0.2)[:, None, None]
    std = np.full((80, *XX.shape), 0.001)
    bend = np.linspace(0, 0.8, 80)[:, None]
    plane = make_plane(X, Y, -wave * YY, wave * XX, time=TIMES, u_std=std, v_std=std, bend=bend)
    write_plane(plane, tmp_path / "a.h5", settings='{"window": 32}', scale_mm_per_px=0.1)
    return tmp_path / "a.h5"


def test_statistics_then_their_derivatives_and_pictures(file, tmp_path, capsys):
    assert piv("stats", file, "-o", tmp_path / "mean.h5") == 0
    said = capsys.readouterr().out
    assert "1 field of 16 x 12 vectors, 100.0% valid" in said
    assert "means over 80 of 80 instants, 80 to 80 usable vectors at a point" in said
    with read_plane(tmp_path / "mean.h5") as mean:
        # of a sine over whole periods: mean zero, mean square half
        np.testing.assert_allclose(mean["u"], 0, atol=1e-12)
        np.testing.assert_allclose(mean["vv"], 0.5 * XX**2 * 80 / 79, atol=1e-12)
        np.testing.assert_allclose(mean["uu_noise"], 1e-6)
    assert piv("derive", tmp_path / "mean.h5", "-o", tmp_path / "d.h5") == 0
    made("plot", tmp_path / "mean.h5", "-o", tmp_path / "a.png", "--colour-by", "v_rms")
    assert piv("plot", tmp_path / "mean.h5", "-o", tmp_path / "b.png", "--colour-by", "speed") == 2
    assert "no 'speed' to colour by; it has vorticity, u, v" in capsys.readouterr().err


def test_phase_average_then_vorticity_and_streamlines(file, tmp_path):
    made("stats", file, "-o", tmp_path / "p.h5", "--period", 0.2, "--phases", 20)
    made("derive", tmp_path / "p.h5", "-o", tmp_path / "d.h5")
    with read_plane(tmp_path / "d.h5") as plane:
        exact = 2 * np.sin(2 * np.pi * np.arange(20) / 20)
        np.testing.assert_allclose(plane["vorticity"].mean(("y", "x")), exact, atol=1e-6)
        assert plane["time"].attrs["units"] == "cycle"
    made("plot", tmp_path / "d.h5", "-o", tmp_path / "a.png", "--streamlines", "--time", 0.275)
    words = ("--quiet", "--streamlines", "--every", 10)
    assert piv("animate", tmp_path / "d.h5", "-o", tmp_path / "a.gif", *words) == 0
    triggers = tmp_path / "t.csv"
    triggers.write_text("\ufeffpulse\n" + "\n".join(map(str, np.arange(0, 0.81, 0.2))))
    made("stats", file, "-o", tmp_path / "q.h5", "--triggers", triggers, "pulse", "--phases", 20)
    with read_plane(tmp_path / "p.h5") as p, read_plane(tmp_path / "q.h5") as q:
        np.testing.assert_allclose(p["u"], q["u"], atol=1e-9)


def test_a_phase_without_an_instant_has_no_valid_vector(file, tmp_path):
    made("stats", file, "-o", tmp_path / "p.h5", "--period", 0.05, "--phases", 16)
    with read_plane(tmp_path / "p.h5") as found:
        # five instants in a period, 0.01 s apart: every 3.2nd phase
        assert np.flatnonzero(found["n"].max(("y", "x"))).tolist() == [0, 3, 6, 9, 12]
        assert not found["valid"].values[1].any()


def test_conditional_on_a_column_and_on_the_finger(file, tmp_path):
    table = tmp_path / "bend.csv"
    pd.DataFrame({"time": [0.0, 0.79], "bend": [0.0, 0.8]}).to_csv(table, index=False)
    bins = ("--by", "bend", "--bins", 0, 0.4, 0.8, "--quiet")

    assert piv("stats", file, "-o", tmp_path / "c.h5", *bins) == 0
    assert piv("stats", file, "-o", tmp_path / "b.h5", *bins, "--table", table) == 0
    with read_plane(tmp_path / "c.h5") as a, read_plane(tmp_path / "b.h5") as b:
        assert a["time"].values.tolist() == [0.2, 0.6000000000000001]
        assert (a["n"] == 40).all()
        np.testing.assert_allclose(a["v"], b["v"])


def test_derive_says_what_it_assumes(file, tmp_path, capsys):
    assert piv("derive", file, "-o", tmp_path / "d.h5", "--quantities", "vorticity") == 0
    assert "neighbours correlated over 0.0032 m" in capsys.readouterr().out
    with read_plane(tmp_path / "d.h5") as plane, read_plane(file) as given:
        assert "q" not in plane
        np.testing.assert_array_equal(plane["bend"], given["bend"])
        np.testing.assert_array_equal(plane["u"], given["u"])


def test_profile_and_spectrum(file, tmp_path, capsys):
    assert piv("profile", file, "-o", tmp_path / "p.csv", "--line", 0, 0.005, 0.015, 0.005) == 0
    assert "1280 points on 0.015 m, 100.0% valid" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "p.csv")
    across = np.sin(2 * np.pi * table["time"] / 0.2) * table["x"]
    np.testing.assert_allclose(table["across"], across, atol=1e-9)
    assert piv("spectrum", file, "-o", tmp_path / "s.csv", "--point", 0.01, 0.01) == 0
    assert "the peak is at 5" in capsys.readouterr().out
    made("spectrum", file, "-o", tmp_path / "s.csv", "--along", "x")
    columns = list(pd.read_csv(tmp_path / "s.csv", comment="#"))
    assert columns == ["frequency", "psd_u", "psd_v", "averaged"]


@pytest.mark.parametrize(
    "words, message",
    [
        ("stats --period -1", "period must be positive"),
        ("stats --period 1000", "--period 1000 makes no phases"),
        ("stats --period 1e-6", "--period 1e-06 makes no phases"),
        ("stats --phases 0 --period 0.2", "--phases: must be at least 1"),
        ("stats --by bend", "--by needs --bins"),
        ("stats --by angle --bins 0 1", "no variable 'angle' over time"),
        ("stats --by bend --bins 5 6", "no instant is in any group"),
        ("stats --least 1", "at least 2 samples"),
        ("stats --bins 0 1", "--bins and --table go with --by"),
        ("stats --table bend.csv --period 1", "--bins and --table go with --by"),
        ("stats --start 0 --by bend --bins 0 1", "--start goes with --period"),
        ("stats --phases 16", "--phases goes with --period or --triggers"),
        ("spectrum --along x --segments 7", "they go with --point, not with --along"),
        ("derive --correlation-length -1", "must not be negative"),
        ("profile --line 0 0 1 1", "leaves the plane"),
        ("spectrum --point 0 0 --segments 20", "shorter than 8"),
    ],
)
def test_wrong_requests_are_refused(file, tmp_path, words, message, capsys):
    words = words.split()
    output = tmp_path / ("o.csv" if words[0] in ("profile", "spectrum") else "o.h5")
    assert piv(words[0], file, "-o", output, *words[1:]) == 2
    assert message in capsys.readouterr().err
    assert not output.exists()
