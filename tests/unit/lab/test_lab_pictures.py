"""Pictures through a dpiv.toml: frames, times, and a rate that the camera knows better."""

import cv2
import numpy as np
import pytest

from piv.formats.recording import RecordingWriter
from postprocess.lab.dpiv_toml import read_dpiv
from postprocess.lab.recorded import LabRecording
from tests.lab_scene import PICTURES, state

COUNT, ROWS, COLUMNS, RATE = 6, 40, 50, 500.0


def frames() -> np.ndarray:
    """Noise of 8 bit."""
    return np.random.default_rng(4).integers(0, 255, (COUNT, ROWS, COLUMNS), np.uint8)


def images(folder, data) -> str:
    for k, image in enumerate(data):
        cv2.imwrite(str(folder / f"frame_{k + 8}.tif"), image)  # 8 … 13: by number, not by letter
    return "frame_*.tif"


def recording(folder, data) -> str:
    attrs = {"frame_rate_hz": RATE, "bits": 8}
    with RecordingWriter(folder / "a.h5", (ROWS, COLUMNS), np.uint8, COUNT, attrs) as writer:
        for k, image in enumerate(data):
            writer.write(k, image)
        writer.finish()
    return "a.h5"


def opened(
    folder, files: str, rate: float = RATE, piv: str = '"1-2,2-3"', x: str = "right"
) -> LabRecording:
    more = {"axes": f'{{ y = "up", x = "{x}", root_px = [20.0, 4.0] }}'}
    more |= {"files": f'"{files}"', "frame_rate_hz": f"{rate}"}
    more |= {"piv": f"{{ window = 16, spacing = 8, pairing = {piv} }}"}
    return LabRecording(read_dpiv(state(folder, PICTURES | more)))


@pytest.mark.parametrize("write", [images, recording])
def test_frames_and_times(tmp_path, write):
    data = frames()
    pictures = opened(tmp_path, write(tmp_path, data))
    assert len(pictures) == COUNT
    np.testing.assert_allclose(pictures.times, np.arange(COUNT) / RATE)
    for k in range(COUNT):
        assert np.array_equal(pictures.frame(k), data[k])
    pictures.close()


def test_pairs_have_their_own_interval(tmp_path):
    files = images(tmp_path, frames())
    pictures = opened(tmp_path, files, 50.0, '"1-2,3-4", interval_s = 0.001')
    np.testing.assert_allclose(pictures.times, [0.0, 0.001, 0.02, 0.021, 0.04, 0.041])


def test_a_rate_that_contradicts_the_camera_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"frame_rate_hz is 250, but .* states 500"):
        opened(tmp_path, recording(tmp_path, frames()), 250.0)


def test_mirrored_pictures_are_turned_back(tmp_path):
    data = frames()
    pictures = opened(tmp_path, images(tmp_path, data), x="left")
    assert np.array_equal(pictures.frame(0), data[0][:, ::-1])
    assert pictures.turned((20.0, 4.0)) == (COLUMNS - 21.0, 4.0)
