"""A dpiv.toml to start from, filled in from the files of a folder."""

import tomllib

import cv2
import h5py
import numpy as np
import pytest

from fileio.key_reference import template
from postprocess.lab.data.dpiv_reference import KEYS
from postprocess.lab.data.seen_in_data import seen_in


def picture(seed: int) -> np.ndarray:
    """Particles around a dark body that hangs from row 40, 30 px wide about column 100."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur((rng.random((240, 200)) < 0.06).astype(np.float32) * 1500, (0, 0), 0.8)
    image[40:180, 85:116] = 0
    return np.clip(image + 8 + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def test_pictures_fill_in_files_and_root(tmp_path):
    (tmp_path / "run7" / "frames").mkdir(parents=True)
    for k in range(3):
        cv2.imwrite(str(tmp_path / "run7" / "frames" / f"a{k:03d}.tif"), picture(k))
    text = template(KEYS, seen_in(tmp_path / "run7"))
    table = tomllib.loads(text.replace("= …", "= 0"))
    assert (table["format"], table["format_version"], table["kind"]) == ("dpiv", 3, "pictures")
    assert (table["title"], table["files"]) == ("run7", "frames/*.tif")
    assert table["axes"]["y"] == "up"
    # as near as the mask is
    assert np.allclose(table["axes"]["root_px"], [100, 240 - 1 - 40], atol=6)
    assert "\nframe_rate_hz = …" in text  # pictures do not state it


def test_vectors_are_distinguished_from_pictures(tmp_path):
    (tmp_path / "a001.dat").write_text("x y u v")
    seen = seen_in(tmp_path)
    assert (seen["files"], seen["kind"]) == ('"*.dat"', '"vectors"')


def test_vectors_are_distinguished_from_a_recording(tmp_path):
    with h5py.File(tmp_path / "piv.h5", "w") as file:
        file["u"], file["v"] = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    assert seen_in(tmp_path)["kind"] == '"vectors"'


def test_a_folder_of_neither_is_refused(tmp_path):
    (tmp_path / "notes.doc").write_text("")
    with pytest.raises(FileNotFoundError, match="holds neither pictures nor vectors"):
        seen_in(tmp_path)
