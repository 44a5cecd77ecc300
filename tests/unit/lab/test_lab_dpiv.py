"""dpiv.toml: all that is missing is asked for at once; a template is filled in from the files."""

import tomllib
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from piv.images.open_recording import files_of
from postprocess.lab.dpiv_toml import dpiv_template, read_dpiv, seen_in
from tests.lab_scene import PICTURES, VECTORS

# what a test leaves out or changes, in the text
WHOLE, OF_VECTORS = (
    "".join(f"{k} = {v}\n" for k, v in keys.items())
    for keys in (PICTURES | {"piv": '{ window = 32, spacing = 8, pairing = "1-2,2-3" }'}, VECTORS)
)


def written(folder: Path, text: str) -> Path:
    (folder / "dpiv.toml").write_text(text)
    return folder


OF_PICTURES = (
    "finger_length_std_mm root_hidden_mm light_from_deg colour axes.root_px piv.pairing piv.every"
)
REQUIRED = "files frame_rate_hz start scale axes finger_geometry finger_length_std_mm piv"


@pytest.mark.parametrize(
    "text, old, new, message",
    [
        (WHOLE, ", std_percent = 1.0", "", "std_percent is missing"),
        (WHOLE, "format_version = 4", "format_version = 1", "version of this dpiv file is 1"),
        (WHOLE, "{ scale", '{ calibration = "a", scale', "or calibration"),
        (WHOLE, "[150.0, 270.0]", "[640.0]", "axes.root_px is missing"),
        (WHOLE, "scale_mm_per_px = 0.4, ", "", "scale_mm_per_px is missing: .* calibration"),
        (WHOLE, '"1-2,2-3"', '"1-2,3-4"', "interval_s"),
        (WHOLE, 'kind = "pictures"', 'kind = "vectors"', "piv.interval_s is missing"),
        (WHOLE, 'title = "a', 'color = "green"\ntitle = "a', "color: this key"),
        (OF_VECTORS, ", interval_s = 0.002", "", r"piv\.interval_s is missing: Between two"),
        (OF_VECTORS, ", root_std_mm = 0.3", "", "root_std_mm is missing"),
        (OF_VECTORS, ", turn_std_deg = 0.5", "", "turn_std_deg is missing"),
    ],
)
def test_what_is_missing_or_contradicts_is_refused(tmp_path, text, old, new, message):
    with pytest.raises(ValueError, match=message):
        read_dpiv(written(tmp_path, text.replace(old, new)))


@pytest.mark.parametrize(
    "text, key",
    [
        *((WHOLE, key) for key in ("axes.root_mm", "axes.root_std_mm", "vectors")),
        *((OF_VECTORS, key) for key in OF_PICTURES.split()),
    ],
)
def test_keys_of_the_other_kind_are_refused(tmp_path, text, key):
    """Whatever their value, beside which pydantic may have more to say."""
    table, _, name = key.rpartition(".")
    old, new = (f"{table} = {{", f"{table} = {{ {name} = 1,") if table else ("title", f"{name} = 1")
    kind = read_dpiv(written(tmp_path, text)).kind
    with pytest.raises(ValueError, match=f"{key} is not of {kind}: leave it out(;|$)"):
        read_dpiv(written(tmp_path, text.replace(old, new if table else f"{new}\ntitle")))


def test_all_that_is_missing_is_asked_for_at_once(tmp_path):
    kept = [line for line in WHOLE.splitlines() if line.split(" ")[0] not in REQUIRED.split()]
    text = "\n".join([*kept, "piv = { window = 32, spacing = 8 }"])
    with pytest.raises(ValueError, match="is missing") as caught:
        read_dpiv(written(tmp_path, text))
    asked = {part.split(" ")[0] for part in str(caught.value).split(": ", 1)[1].split("; ")}
    parts = {"scale.std_percent", "scale.scale_mm_per_px", "axes.root_px", "axes.y", "piv.pairing"}
    assert parts | set(REQUIRED.split()) - {"piv", "axes", "scale"} <= asked


@pytest.mark.parametrize("name", ["run 7", "20:30"])
def test_a_name_with_a_space_or_a_colon_is_a_name(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    dpiv = read_dpiv(written(folder, WHOLE.replace("a.h5", f"{name}.tif")))
    (folder / f"{name}.tif").touch()
    assert [str(path) for path in files_of(dpiv.sources())] == [str(folder / f"{name}.tif")]


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


def test_a_folder_shows_what_it_holds(tmp_path):
    (tmp_path / "notes.doc").write_text("")
    with pytest.raises(FileNotFoundError, match="holds neither pictures nor vectors"):
        seen_in(tmp_path)
    with h5py.File(tmp_path / "piv.h5", "w") as file:
        file["u"], file["v"] = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    assert seen_in(tmp_path)["kind"] == '"vectors"'
