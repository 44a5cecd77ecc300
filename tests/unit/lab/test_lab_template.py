"""A dpiv.toml to start from, filled in from the files of a folder."""

import tomllib

import cv2
import h5py
import numpy as np
import pytest

from postprocess.lab.dpiv_toml import dpiv_template, seen_in


def test_pictures_fill_in_their_files(tmp_path):
    (tmp_path / "run7" / "frames").mkdir(parents=True)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"run7/frames/a{k:03d}.tif"), np.zeros((9, 9), np.uint8))
    text = dpiv_template(tmp_path / "run7")
    table = tomllib.loads(text.replace("= …", "= 0"))
    assert (table["format"], table["format_version"], table["kind"]) == ("dpiv", 4, "pictures")
    assert (table["title"], table["files"]) == ("run7", "frames/*.tif")
    # pictures do not state them, nor need they what vectors do
    for key in ("frame_rate_hz", "scale_mm_per_px", "root_px", "pairing", "finger_length_std_mm"):
        assert f"\n{key} = …" in text
    assert "root_mm" not in text


def test_vectors_are_distinguished_from_a_recording(tmp_path):
    with h5py.File(tmp_path / "piv.h5", "w") as file:
        file["u"], file["v"] = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    assert seen_in(tmp_path)["kind"] == '"vectors"'


def test_a_folder_of_neither_is_refused(tmp_path):
    (tmp_path / "notes.doc").write_text("")
    with pytest.raises(FileNotFoundError, match="holds neither pictures nor vectors"):
        seen_in(tmp_path)
