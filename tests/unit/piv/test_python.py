"""`import piv`: its names, their examples, and calls as a user would guess them."""

import doctest
import inspect
from itertools import pairwise

import numpy as np
import pytest

import piv
from tests.conftest import ROOT

NAMES = [name for name in piv.__all__ if name != "__version__"]
FRAMES = ROOT / "docs" / "tutorials" / "frames"


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_each_name_gives_what_it_says(name, tmp_path, monkeypatch):
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(piv, name))
    example = doctest.DocTestParser().get_doctest(text, {"piv": piv, "np": np}, name, None, 0)
    assert example.examples
    assert "Examples\n--------" in text
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert runner.run(example).failed == 0


@pytest.fixture(scope="module")
def images():
    with piv.open_recording(FRAMES) as film:
        return list(film)


def test_correlate_takes_names_arrays_and_recordings(images, tmp_path):
    options = {"window": 24, "spacing": 16, "preprocess": "none"}
    film = piv.correlate(FRAMES, **options)
    names = sorted(FRAMES.glob("*.png"))
    with piv.open_recording(FRAMES) as recording:
        others = [
            piv.correlate(*names, **options), piv.correlate(names, **options),
            piv.correlate(str(FRAMES / "*.png"), **options), piv.correlate(*images, **options),
            piv.correlate(np.stack(images), **options), piv.correlate(recording, **options),
            piv.correlate(FRAMES, output=tmp_path / "o.h5", **options),
        ]  # fmt: skip
        recording.frame(0)  # stays open
    for other in others:
        np.testing.assert_array_equal(other["u"], film["u"])
    pair = piv.correlate(images[0], images[1], **options)
    np.testing.assert_array_equal(pair["u"], film["u"][0])
    stack = np.vstack(images[:2])
    both = piv.correlate([stack], layout="top-bottom", **options)
    np.testing.assert_array_equal(both["v"], pair["v"])
    metres = piv.correlate(*names[:2], scale_mm_per_px=0.1, interval=0.002, **options)
    np.testing.assert_allclose(metres["u"], pair["u"] * 0.05, rtol=1e-6)


def test_a_recording_of_the_caller_is_left_as_it_was(images):
    options = {"window": 24, "spacing": 16, "preprocess": "none"}
    with piv.open_recording(FRAMES) as film:
        before = film.shape, dict(film.attrs)
        part = piv.part_of_recording(film, roi=(0, 0, 199, 149))
        metres = piv.correlate(part, scale_mm_per_px=0.1, interval=0.002, **options)
        assert metres["u"].attrs["units"] == "m/s"
        assert (film.shape, film.attrs) == before
        assert film.times is part.times is None
        assert piv.correlate(part, **options)["u"].attrs["units"] == "px"
        # each picture taken for two exposures, side by side
        halves = piv.correlate(film, layout="left-right", **options)
        assert halves.sizes["time"] == len(images)
        left, right = np.split(images[1], 2, axis=1)
        np.testing.assert_array_equal(halves["u"][1], piv.correlate(left, right, **options)["u"])


def test_words_that_would_be_ignored_are_refused(images):
    with pytest.raises(ValueError, match="`colour` must be one of refuse, luma, green"):
        piv.correlate(FRAMES, colour="purple")
    with pytest.raises(ValueError, match="`colour` luma is of files"):
        piv.correlate(images[0], images[1], colour="luma")
    with pytest.raises(ValueError, match="`roi_unit` must be px or m, got 'mm'"):
        piv.correlate(images[0], images[1], roi=(0, 0, 99, 99), roi_unit="mm")


def test_errors_name_options_as_python_does(images):
    with pytest.raises(ValueError, match="give `interval` too"):
        piv.correlate(images[0], images[1], scale_mm_per_px=0.1)
    with pytest.raises(TypeError, match="no option 'windw'; did you mean window"):
        piv.correlate(images[0], images[1], windw=24)
    with pytest.raises(ValueError, match="name a recording, or give two or more pictures"):
        piv.correlate()
    with pytest.raises(ValueError, match=r"one frame is no pair.*`layout`"):
        piv.correlate([images[0]])
    with pytest.raises(ValueError, match=r"image 0 is of shape \(192, 224, 1\)"):
        piv.correlate(images[0][..., None], images[1][..., None])


def test_an_ensemble_takes_a_list_or_a_function(images):
    pairs = list(pairwise(images[:3]))
    options = {"window": 24, "spacing": 32}
    one = piv.correlate_ensemble(pairs, **options)
    other = piv.correlate_ensemble(lambda i: (*pairs[i], None), 2, **options)
    np.testing.assert_array_equal(one["u"], other["u"])
    with pytest.raises(ValueError, match="their `count`"):
        piv.correlate_ensemble(lambda i: pairs[i])
