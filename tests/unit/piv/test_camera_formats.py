"""Pictures as cameras and their programs store them; files are made by the published formats."""

import cv2
import numpy as np
import pytest

from piv import correlate_pair, open_recording
from piv.images.recording import Recording
from piv.images.recordings.double_frames import DoubleFrames
from tests.camera_files import cine, imagej
from tests.piv_command import made, piv

RNG = np.random.default_rng(5)
FRAMES = RNG.integers(0, 1023, (3, 12, 20)).astype(np.uint16)


@pytest.mark.parametrize("stored, compression", [(16, 0), (8, 0), (10, 256), (12, 1024)])
def test_a_cine_file(tmp_path, stored, compression):
    """Ten bits are stored in 16: the largest grey value is 1023, and `bits` says so."""
    path = cine(tmp_path / "a.cine", FRAMES, stored, compression=compression)
    with open_recording(path) as film:
        expected = FRAMES >> 2 if stored == 8 else FRAMES
        np.testing.assert_array_equal(list(film), expected)
        assert film.attrs["bits"] == min(stored, 10)
        np.testing.assert_allclose(film.times, [0, 0.002, 0.004])


def test_a_damaged_or_coloured_cine_file_is_refused(tmp_path):
    path = cine(tmp_path / "a.cine", FRAMES, colour=3)
    with pytest.raises(ValueError, match=r"a\.cine: a colour film; export it as grey TIFF"):
        open_recording(path)
    whole = cine(path, FRAMES).read_bytes()
    for length in (0, 30, 50, 3000, 6100):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"a\.cine: "):
            open_recording(path)
    path.write_bytes(whole[:-9])
    with open_recording(path) as film, pytest.raises(ValueError, match="frame 2: the file is cut"):
        film.frame(2)


def test_both_exposures_in_one_picture(tmp_path, capsys):
    a, b = FRAMES[:2]
    for name, picture in (("v.tif", np.vstack([a, b])), ("h.tif", np.hstack([a, b]))):
        cv2.imwrite(str(tmp_path / name), picture)
    for name, layout in (("v.tif", "top-bottom"), ("h.tif", "left-right")):
        with open_recording(tmp_path / name, layout=layout) as pair:
            np.testing.assert_array_equal(list(pair), [a, b])
            assert pair.pairing == "1-2,3-4"
    assert piv("correlate", tmp_path / "v.tif", "-o", tmp_path / "o.h5") == 2
    assert "--layout" in capsys.readouterr().err
    cv2.imwrite(str(tmp_path / "odd.tif"), FRAMES[0, :11])
    with pytest.raises(ValueError, match="11 px cannot be halved"):
        open_recording(tmp_path / "odd.tif", layout="top-bottom")


def test_halves_of_a_picture_keep_its_mask_and_identity():
    class Masked(Recording):
        def _read(self, i):
            return FRAMES[0]

        def mask(self, i):
            return FRAMES[0] > 500

    whole = Masked("masked", 1)
    whole.key = "of these pixels"
    pair = DoubleFrames(whole, "top-bottom")
    assert pair.key == whole.key
    np.testing.assert_array_equal(pair.mask(1), FRAMES[0, 6:] > 500)


@pytest.mark.parametrize("kind", ["f4", "f8", "i2", "u4"])
def test_tiff_of_other_numbers(tmp_path, kind):
    picture = (FRAMES[0].astype(float) - (100 if kind != "u4" else 0)).astype(kind)
    cv2.imwrite(str(tmp_path / "a.tif"), picture)
    with open_recording(tmp_path / "a.tif") as images:
        np.testing.assert_array_equal(images.frame(0), picture.astype(np.float32))
        assert images.frame(0).dtype == np.float32


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_stack_of_imagej_with_one_page_for_all(tmp_path, order):
    """ImageJ writes one directory where a stack is larger than 4 GB; OpenCV sees one picture."""
    path = imagej(tmp_path / "stack.tif", FRAMES, order)
    with open_recording(path) as stack:
        np.testing.assert_array_equal(list(stack), FRAMES)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(ValueError, match="ends before the last of its 3 pictures"):
        open_recording(path)


def test_a_video_or_images_of_photron_beside_their_header(tmp_path):
    header = "#Camera Information Header\nRecord Rate(fps) : 250\nFile Format : {}\n"
    (tmp_path / "a.cih").write_text(header.format("AVI"))
    video = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    for _ in range(3):
        video.write(RNG.integers(0, 255, (48, 64, 3)).astype(np.uint8))
    video.release()
    for name in ("a.cih", "a.avi"):  # the playing rate of 30 is not that of the camera
        with open_recording(tmp_path / name) as film:
            np.testing.assert_allclose(film.times, [0, 0.004, 0.008])
    (tmp_path / "b.cih").write_text(header.format("Tiff"))
    for k, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / f"b{k + 1:06d}.tif"), frame)
    # and those of another recording whose name begins alike
    (tmp_path / "b1.cih").write_text(header.format("Tiff"))
    cv2.imwrite(str(tmp_path / "b1000001.tif"), FRAMES[0])
    with open_recording(tmp_path / "b.cih") as film:
        np.testing.assert_array_equal(list(film), FRAMES)
        assert film.attrs["frame_rate_hz"] == 250
    (tmp_path / "b.cih").write_text("File Format : Tiff")
    with pytest.raises(ValueError, match=r"b\.cih: not a readable Photron header"):
        open_recording(tmp_path / "b.cih")


def test_image_buffers_of_davis(tmp_path):
    lv = pytest.importorskip("lvpyio", reason="the DaVis reader, an extra, is not installed")
    for k in range(2):
        buffer = lv.arrays_to_buffer([np.ma.array(frame + k) for frame in FRAMES[:2]])
        for frame in buffer.frames:
            frame.scales.x = lv.Scale(0.1, -1.0, "mm", "x")
            frame.scales.y = lv.Scale(-0.1, 1.0, "mm", "y")
        lv.write_buffer(buffer, str(tmp_path / f"B0000{k}.im7"))
    with open_recording(tmp_path) as pairs:
        np.testing.assert_array_equal(list(pairs), [*FRAMES[:2], *(FRAMES[:2] + 1)])
        assert pairs.pairing == "1-2,3-4"
        assert pairs.attrs["scale_mm_per_px"] == pytest.approx(0.1)
        # x = 0 at the edge of px 9 and 10 from the left, y = 0 of those from the top, of 12 rows
        assert pairs.attrs["origin_x_px"] == pytest.approx(9.5)
        assert pairs.attrs["origin_y_px"] == pytest.approx(1.5)


def test_float_pictures_are_correlated_as_they_are(tmp_path):
    rng = np.random.default_rng(2)
    a = cv2.GaussianBlur(rng.normal(0, 1, (96, 96)).astype(np.float32), (0, 0), 1.2)
    pair = [np.roll(a, shift, 1) for shift in (0, 2)]
    for name, image in zip("ab", pair, strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.tif"), image)
    made("correlate", tmp_path / "a.tif", tmp_path / "b.tif", "-o", tmp_path / "o.h5",
         "--preprocess", "none")  # fmt: skip
    from piv import read_plane

    with read_plane(tmp_path / "o.h5") as plane:
        np.testing.assert_array_equal(plane["u"][0], correlate_pair(*pair)["u"])
