"""One clock for every command, and frames of a pair known by their names."""

import cv2
import numpy as np
import pytest

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv import open_recording, open_vectors
from piv.foreign.read import in_px
from piv.formats.plane_series import make_plane, provenance, write_plane
from piv.images.clock import frame_times, set_clock
from piv.images.open_recording import PAIRINGS
from piv.sequence.sequence import alternating
from tests.piv_command import made, piv

NEIGHBOURS, COUPLES = PAIRINGS


@pytest.fixture(scope="module")
def couples(tmp_path_factory):
    """Four pairs, 2 px to the right within each, of other particles from pair to pair."""
    folder = tmp_path_factory.mktemp("pairs")
    for k in range(4):
        pair = render(uniform(2, 0), shape=(96, 128), seed=k, noise=0.01)
        for label, image in zip("AB", pair, strict=True):
            cv2.imwrite(str(folder / f"im_{k:04d}_{label}.png"), image)
    return folder


def test_a_spectrum_has_its_peak_at_the_true_frequency(tmp_path):
    time, interval, frequency = np.arange(256) + 0.5, 0.002, 8.475
    x, y = np.arange(0, 64, 8.0), np.arange(0, 48, 8.0)
    u = np.sin(2 * np.pi * frequency * time * interval)[:, None, None] + np.zeros((256, 6, 8))
    plane = in_px(make_plane(x, y, u, 0 * u, time=time), "frame")
    attrs = provenance(pairing=NEIGHBOURS, skip=0, frames=2, window=32.0)
    write_plane(plane.assign_attrs(attrs), tmp_path / "x.h5")
    made("calibrate", "--scale-mm-per-px", 0.1, "-o", tmp_path / "c.json")
    made(*f"calibrate --apply {tmp_path}/c.json --vectors {tmp_path}/x.h5".split(), "--interval",
         interval, "-o", tmp_path / "m.h5")  # fmt: skip
    made("spectrum", tmp_path / "m.h5", "--point", 0.002, 0.002, "-o", tmp_path / "s.csv")
    frequencies, psd = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=2, usecols=(0, 1)).T
    # within the step of the frequencies, 1/(256 · 2 ms)
    assert frequencies[np.argmax(psd)] == pytest.approx(frequency, abs=1.0)


def test_files_of_pairs_are_paired_by_their_names(couples, tmp_path):
    output = tmp_path / "o.h5"
    clock = ["--scale-mm-per-px", 0.1, "--interval", 0.001, "--rate", 10]
    made("correlate", couples, "-o", output, "--preset", "fast", *clock)
    with open_vectors(output) as plane:
        np.testing.assert_allclose(plane["time"], 0.0005 + np.arange(4) / 10)
        assert plane["time"].attrs["units"] == "s"
        # 2 px of 0.1 mm in a millisecond; 0.05 px is ten times the error of such a pair
        np.testing.assert_allclose(plane["u"].median(("y", "x")), 0.2, atol=0.005)
        assert plane.attrs["interval"] == 0.001
    # without a rate the velocities are known, the times are not
    made("correlate", couples, "-o", output, "--preset", "fast", *clock[:4])
    with open_vectors(output) as plane:
        assert (plane["u"].attrs["units"], plane["time"].attrs["units"]) == ("m/s", "frame")


def test_frames_of_pairs_taken_for_a_film_alternate_and_are_told(couples, tmp_path, capsys):
    made("correlate", couples, "-o", tmp_path / "o.h5", "--pairing", NEIGHBOURS)
    assert "are these pairs?" in capsys.readouterr().err
    assert alternating({0: 0.9, 1: 0.5, 2: 0.95, 3: 0.4}) == pytest.approx((0.925, 0.45))
    assert alternating({0: 0.9, 1: 0.5, 2: 0.45, 3: 0.4}) is None
    assert alternating({0: 0.9, 1: 0.4}) is None


@pytest.mark.parametrize(
    "names, pairing",
    [
        ("im_00_A im_00_B im_01_A im_01_B", COUPLES),
        ("exp1_001_a exp1_001_b exp1_002_a exp1_002_b", COUPLES),
        ("B01a B01b B02a B02b", COUPLES),
        ("t_1_0 t_1_1 t_2_0 t_2_1 t_10_0 t_10_1", COUPLES),
        ("t9-1 t9-2 t10-1 t10-2", COUPLES),
        ("f_0 f_1 f_2 f_3", NEIGHBOURS),
        ("f_0 f_1", NEIGHBOURS),
        ("a_1 b_1 c_1", NEIGHBOURS),
        ("0 1 2", NEIGHBOURS),
        ("im_00_A im_00_B im_01_A", None),
        ("im_00_A im_00_B im_01_B im_02_A im_02_B", None),
    ],
)
def test_names_state_the_pairing(tmp_path, names, pairing):
    for name in names.split():
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros((8, 8), np.uint8))
    with open_recording(tmp_path) as recording:
        assert recording.pairing == pairing
        shown = [path.stem for path, _ in recording.pages]
        assert shown == names.split()


def test_one_exposure_alone_is_refused(couples, tmp_path, capsys):
    assert piv("correlate", couples / "*_A.png", "-o", tmp_path / "o.h5") == 2
    assert "im_0000_B.png is not among the images" in capsys.readouterr().err


def test_the_clock_of_frames():
    frames = np.arange(4)
    np.testing.assert_allclose(frame_times(frames, NEIGHBOURS, 0.002, None), 0.002 * frames)
    np.testing.assert_allclose(frame_times(frames, NEIGHBOURS, None, 500), 0.002 * frames)
    # a frame is left out within each pair: frames follow at half the interval
    np.testing.assert_allclose(frame_times(frames, NEIGHBOURS, 0.002, None, 1), 0.001 * frames)
    np.testing.assert_allclose(frame_times(frames, COUPLES, 0.002, 10), [0, 0.002, 0.1, 0.102])
    assert frame_times(frames, COUPLES, 0.002, None) is None
    for wrong in ((NEIGHBOURS, 0.002, 400), (COUPLES, 0.2, 10), (COUPLES, None, 10),
                  (COUPLES, -1, None)):  # fmt: skip
        with pytest.raises(ValueError, match=r"`interval`|`rate`"):
            frame_times(frames, *wrong)


def test_the_times_of_a_recording_stay_where_the_interval_is_stated(couples):
    with open_recording(couples) as recording:
        recording.times = np.arange(8) / 20.0
        with pytest.raises(ValueError, match=r"0.2 s does not fit between its pairs, 0.1 s"):
            set_clock(recording, COUPLES, 0.2, None)
        set_clock(recording, COUPLES, 0.001, None)
        np.testing.assert_allclose(recording.times[:4], [0, 0.001, 0.1, 0.101])


def test_statistics_keep_how_their_vectors_were_made(tmp_path, couples, capsys):
    made("correlate", couples, "-o", tmp_path / "o.h5", "--preset", "fast")
    made("stats", tmp_path / "o.h5", "-o", tmp_path / "mean.h5")
    assert piv("derive", tmp_path / "mean.h5", "-o", tmp_path / "d.h5") == 0
    assert "those of neighbours correlated over 32 px" in capsys.readouterr().out
