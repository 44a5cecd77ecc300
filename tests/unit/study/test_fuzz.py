"""A small fuzz of every reader, the same inputs each time.

FUZZ=5000 in the environment tries so many damaged files of each; the last one stays in its folder.
"""

import os
import random

import pytest

from piv.files import hdf5
from piv.files.hdf5 import check_hdf5
from tests.fuzz_mutate import damaged
from tests.fuzz_scenes import count_outcomes
from tests.fuzz_targets import TARGETS, check, named

INPUTS = int(os.environ.get("FUZZ", "15"))


# an unraisable exception would reach a user as a traceback
@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", [target.name for target in TARGETS])
def test_damaged_files_are_read_or_refused_in_one_sentence(name, tmp_path):
    if name == "davis.vc7":
        pytest.importorskip("lvpyio", reason="the DaVis reader, an extra, is not installed")
    target, draw = named(name), random.Random(2017)
    seeds, files = tmp_path / "seeds", tmp_path / "files"
    seeds.mkdir()
    files.mkdir()
    valid = target.seeds(seeds)
    assert any(check(target, content, files) is None for content in valid), "no seed is read"
    inputs = [damaged(valid, draw) for _ in range(max(2, INPUTS // target.costs))]
    refusals = [check(target, content, files) for content in inputs]
    assert any(refusals), "nothing was ever refused: the damage is not seen"


def test_a_file_that_the_library_never_finishes_is_refused(tmp_path, monkeypatch):
    """The loop is put in by hand: which damaged files loop depends on the version of HDF5."""
    content, path = named("images.h5").seeds(tmp_path)[0], tmp_path / "a.h5"
    path.write_bytes(content)
    check_hdf5(path)

    def loop(_):
        while True:
            pass

    monkeypatch.setattr(hdf5, "_walk", loop)
    monkeypatch.setattr(hdf5, "WALK_LIMIT", 1)
    check_hdf5(path)  # an unchanged file is not walked again
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.h5: damaged"):
        check_hdf5(path)


def test_drawn_scenes_are_accepted_or_refused_in_one_sentence():
    """The same forty each time, up to the motion; FUZZ draws more of them, up to the case."""
    counts = count_outcomes(*((INPUTS, "case") if "FUZZ" in os.environ else (40, "kinematics")))
    assert counts["fault"] == 0
    assert counts["refused"] > 10
    # 15 in 100 are accepted (docs/stability.md); every new key changes the drawn scenes
    assert counts["accepted"] + counts["warned"] > 0
