"""A small fuzz of every reader, the same inputs each time; `make fuzz` tries a hundred thousand."""

import random

import pytest

from fileio.child_process import check_walkable
from tests.studies.fuzz.mutate import damaged
from tests.studies.fuzz.scenes import count_outcomes
from tests.studies.fuzz.targets import TARGETS, check, named

INPUTS = 30


@pytest.mark.filterwarnings(
    "error::pytest.PytestUnraisableExceptionWarning"
)  # what a user would see as a traceback
@pytest.mark.parametrize("name", [target.name for target in TARGETS])
def test_damaged_files_are_read_or_refused_in_one_sentence(name, tmp_path):
    if name == "davis.vc7":
        pytest.importorskip("lvpyio", reason="the DaVis reader, an extra, is not installed")
    target, draw = named(name), random.Random(2017)
    seeds, files = tmp_path / "seeds", tmp_path / "files"
    seeds.mkdir()
    files.mkdir()
    whole = target.seeds(seeds)
    assert any(check(target, content, files) is None for content in whole), "no seed is read"
    outcomes = [
        check(target, damaged(whole, draw), files) for _ in range(max(2, INPUTS // target.costs))
    ]
    assert any(outcome is not None for outcome in outcomes), (
        "nothing was ever refused: the damage is not seen"
    )


def test_a_file_that_the_library_never_gets_through_is_refused(tmp_path, monkeypatch):
    """A loop in the library, put in by hand: the damaged files that loop differ between versions of HDF5."""
    from fileio import child_process

    path = named("images.h5").seeds(tmp_path)[0]
    (tmp_path / "a.h5").write_bytes(path)
    check_walkable(tmp_path / "a.h5")

    def loop(_):
        while True:
            pass

    monkeypatch.setattr(child_process, "_walk", loop)
    monkeypatch.setattr(child_process, "WALK_LIMIT", 1)
    check_walkable(tmp_path / "a.h5")  # as it was: not walked again
    (tmp_path / "a.h5").write_bytes(path)
    with pytest.raises(ValueError, match=r"a\.h5: damaged"):
        check_walkable(tmp_path / "a.h5")


def test_drawn_scenes_are_accepted_and_sane_or_refused_in_one_sentence():
    """The same forty each time; `make fuzz` draws two thousand."""
    counts = count_outcomes(40)
    assert counts["refused"] > 10
    # 15 in 100 of the drawn are accepted (docs/stability/scenes.csv); what is drawn changes with every new key
    assert counts["accepted"] + counts["warned"] > 0
