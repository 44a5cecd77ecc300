"""What a user of `piv` may give by mistake: one sentence, and nothing is lost."""

import cv2
import numpy as np
import pytest

from piv.correlation.options import Options
from piv.images.masks import read_polygon
from tests.piv_command import made, piv


@pytest.fixture
def pair(tmp_path):
    rng = np.random.default_rng(3)
    picture = cv2.GaussianBlur(rng.integers(0, 255, (128, 128)).astype(np.uint8), (0, 0), 1.0)
    for name in ("a.tif", "b.tif"):
        cv2.imwrite(str(tmp_path / name), picture)
    return tmp_path / "a.tif", tmp_path / "b.tif"


@pytest.mark.parametrize("source", [("a.tif", "b.tif"), (".",), ("*.tif",)])
def test_an_input_is_not_written_over(pair, capsys, source):
    """Given by name, as a folder or by a glob."""
    a, before = pair[0], pair[0].read_bytes()
    given = [str(a.parent / name) for name in source]
    assert piv("correlate", *given, "-o", a, "--quiet") == 2
    assert "give -o another name" in capsys.readouterr().err
    assert a.read_bytes() == before


@pytest.mark.parametrize("command, suffix", [
    ("correlate a.tif b.tif", "tif"), ("vortices v.h5", "h5"), ("render s.h5", "csv"),
    ("plot v.h5", "jpg"), ("animate v.h5", "png"), ("stats v.h5", "csv"), ("view v.h5", "toml"),
    ("derive v.h5", "nc"), ("profile v.h5 --line 0 0 1 1", "h5"),
    ("calibrate --scale-mm-per-px 1", "toml"),
])  # fmt: skip
def test_an_output_is_named_by_what_it_is(capsys, command, suffix):
    words = command.split()
    assert piv(*words, "-o", f"o.{suffix}") == 2
    assert f"piv {words[0]} writes ." in (said := capsys.readouterr().err)
    assert "; name it so\n" in said


def test_a_result_beside_the_images_may_be_made_again(pair):
    output = pair[0].parent / "o.h5"
    for _ in range(2):
        made("correlate", pair[0].parent, "-o", output, "--preset", "fast")


@pytest.mark.parametrize(
    "options, words",
    [
        ("--scale-mm-per-px 0 --rate 500", "scale_mm_per_px = 0: give a positive number"),
        ("--scale-mm-per-px nan --rate 500", "scale_mm_per_px = nan"),
        ("--scale-mm-per-px 0.1 --rate 5 --origin-x-px inf", "origin_x_px = inf"),
        ("--scale-mm-per-px 0.1", "give --interval too"),
        ("--search 5000", "search must be between 16 and 1024 px, got 5000"),
        ("--spacing 65", "at most 64 px; got 65"),
        ("--least-window 64 --window 32", "between 8 and 32 px (window), got 64"),
    ],
)
def test_numbers_of_the_camera_are_looked_at(pair, tmp_path, capsys, options, words):
    assert piv("correlate", *pair, "-o", tmp_path / "o.h5", "--quiet", *options.split()) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "o.h5").exists()


def test_a_polygon_may_have_a_line_of_names(tmp_path):
    path = tmp_path / "body.csv"
    path.write_text("x_px, y_px\n0, 0\n10, 0\n10, 5\n")
    assert read_polygon(path).tolist() == [[0, 0], [10, 0], [10, 5]]
    path.write_text("\ufeffx;y\n0,5;0\n10;0\n10;5\n", encoding="utf-8")  # a spreadsheet's
    assert read_polygon(path).tolist() == [[0.5, 0], [10, 0], [10, 5]]
    for text, words in (
        ("x_px, y_px\n0, 0\n10, zero\n10, 5\n", r"line 3, column y_px: 'zero' is not a finite"),
        ("0,0\n1,1\n", "has 2 rows of 2 numbers; give x and y in px of at least 3 corners"),
        ("", "has 0 rows of 0 numbers"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_polygon(path)


def test_a_mask_that_may_be_inverted_asks(pair, tmp_path, capsys):
    rows, columns = cv2.imread(str(pair[0]), cv2.IMREAD_GRAYSCALE).shape
    most = np.full((rows, columns), 255, np.uint8)
    most[rows // 4 :, : columns // 3] = 0
    for k, mask in enumerate((most, 255 - most)):
        cv2.imwrite(str(tmp_path / "m.png"), mask)
        made("correlate", *pair, "-o", tmp_path / "o.h5", "--mask", tmp_path / "m.png")
        assert ("m.png: masks 75% of the picture; is it inverted?" in capsys.readouterr().err) == (
            k == 0
        )


def test_a_window_is_square(pair, tmp_path, capsys):
    assert piv("correlate", *pair, "-o", tmp_path / "o.h5", "--window", "64x32") == 2
    words = "give one number (windows and spacings are the same along x and y), got '64x32'"
    assert words in capsys.readouterr().err
    with pytest.raises(ValueError, match="window is one number, the same along x and y"):
        Options(window=(64, 32))
