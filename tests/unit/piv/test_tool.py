"""Every command of `piv` reads the project's files, reports, and refuses wrong numbers."""

import subprocess
import sys

import numpy as np
import pytest

from piv.files import command
from piv.foreign.read import in_px, open_vectors
from piv.formats.plane_series import make_plane, write_plane
from piv.vortices.lamb_oseen_fit import lamb_oseen
from tests.piv_command import made, piv


def series_px(n=3, std=0.05):
    """A Lamb-Oseen vortex over n frames, in px, with two absent vectors."""
    x, y = np.arange(0, 320, 8.0), np.arange(0, 240, 8.0)
    u, v = lamb_oseen(*np.meshgrid(x, y), 160.0, 120.0, 600.0, 30.0)
    u, v = (np.repeat(f[None], n, axis=0) for f in (u, v))
    valid = np.ones(u.shape, bool)
    valid[:, 0, :2] = False
    u, v = (np.where(valid, f, np.nan) for f in (u, v))
    more = {n: np.where(valid, std, np.nan) for n in ("u_std", "v_std")}
    plane = make_plane(x, y, u, v, time=np.arange(n) + 0.5, valid=valid, **more)
    return in_px(plane, "frame")


@pytest.fixture
def series(tmp_path):
    write_plane(series_px(), tmp_path / "a.h5")
    return tmp_path / "a.h5"


def test_pictures_and_vortices(series, tmp_path, capsys):
    source = str(series)
    assert piv("plot", source, "-o", tmp_path / "a.png") == 0
    told = capsys.readouterr().out
    assert "0.5 frame, vorticity " in told
    assert " 1/frame; 1 field of 40 x 30 vectors, 99.8% valid; displacement median" in told
    assert piv("animate", source, "-o", tmp_path / "a.mp4") == 0
    assert piv("vortices", source, "-o", tmp_path / "v.csv") == 0
    told = capsys.readouterr().out
    assert "3 vortices in 1 track; the strongest has a circulation of 600 ± " in told
    assert "px²/frame in all, by a Lamb-Oseen fit" in told


def test_calibrated_vectors_are_summed_up(series, tmp_path, capsys):
    scale = tmp_path / "c.json"
    made("calibrate", "--scale-mm-per-px", "0.1", "--origin", 10, 20, "-o", scale)
    words = ["--apply", str(scale), "--vectors", str(series), "--interval", "0.01", "--rate", "5"]
    assert piv("calibrate", *words, "-o", tmp_path / "m.h5") == 0
    assert "3 fields of 40 x 30 vectors, 99.8% valid; speed median" in capsys.readouterr().out
    with open_vectors(tmp_path / "m.h5") as metres:
        np.testing.assert_allclose(metres["u"], series_px()["u"] * 1e-4 / 0.01)
        np.testing.assert_allclose(metres["x"], (series_px()["x"] - 10) * 1e-4)


@pytest.mark.parametrize(
    "words, message",
    [
        ("vortices --least-part 2", "least_part = 2"),
        ("vortices --scale -4", "scale = -4"),
        ("vortices --gate -1", "gate = -1"),
        ("vortices --threads 0", "threads must be at least 1"),
        ("plot --arrow-every 0", "--arrow-every"),
        ("plot --vorticity-limit -1", "--vorticity-limit"),
        ("plot --time 9", "outside 0.5 to 2.5 frame"),
    ],
)
def test_wrong_numbers_are_refused(series, tmp_path, words, message, capsys):
    words = words.split()
    output = tmp_path / ("o.csv" if words[0] == "vortices" else "o.png")
    assert piv(words[0], series, "-o", output, *words[1:]) == 2
    assert message in capsys.readouterr().err
    assert not output.exists()


@pytest.mark.parametrize(
    "words, message",
    [
        ("convert --rate -5", "--rate: must be positive"),
        ("convert --interval nan", "--interval: must be positive"),
        ("mask --dark --min-area 2", "--min-area is a part"),
        ("mask --dark --grow -1", "--grow: must be at least 0"),
    ],
)
def test_wrong_numbers_are_refused_before_anything_is_read(tmp_path, words, message, capsys):
    words = words.split()
    assert piv(words[0], "nowhere", "-o", tmp_path / "o.h5", *words[1:]) == 2
    assert message in capsys.readouterr().err


def test_what_holds_no_vectors_is_named(tmp_path, capsys):
    assert piv("plot", tmp_path, "-o", tmp_path / "o.png") == 2
    assert "is a folder; give a file" in capsys.readouterr().err


def test_an_empty_plane_has_no_vortices(tmp_path, capsys):
    plane = series_px().isel(time=0, drop=True)
    plane["valid"][:] = 0
    write_plane(plane, tmp_path / "a.h5")
    assert piv("vortices", tmp_path / "a.h5", "-o", tmp_path / "v.csv") == 2
    assert "no usable vector" in capsys.readouterr().err


def test_a_redirected_log_holds_no_bar(series, tmp_path):
    command = [sys.executable, "-m", "piv", "animate", str(series), "-o", str(tmp_path / "a.gif")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1


def test_ctrl_c_while_a_command_is_loaded(monkeypatch, capsys):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "import_module", interrupted)
    assert piv("plot", "a.h5", "-o", "a.png") == 130
    assert capsys.readouterr().err.count("\n") == 1
