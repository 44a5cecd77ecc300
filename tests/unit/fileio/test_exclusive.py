"""One writer at a time; the settings of a scene stay while a stage is at work on the old ones."""

import subprocess
import sys
import time

import pytest

from fileio.errors import StageError, sentence
from fileio.lock import exclusive, held
from pipeline import stage_settings as settings_stage
from pipeline.stage_settings import changed_settings
from tests.conftest import ROOT, write_scene

HOLD = """
import sys, time
from pathlib import Path
from fileio.lock import exclusive
with exclusive(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def hold(path):
    """Another process that holds the lock on `path`."""
    command = [sys.executable, "-c", HOLD, str(path)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def holder(tmp_path):
    process = hold(tmp_path / "a.h5")
    yield process
    process.kill()
    process.wait()


def test_a_second_writer_is_told_and_a_killed_one_leaves_no_lock(tmp_path, holder):
    target = tmp_path / "a.h5"
    assert held(tmp_path) == "a.h5"
    with pytest.raises(BlockingIOError) as caught, exclusive(target):
        pass
    words = f"{target}: another make or command is writing it; wait for it or stop it"
    assert sentence(caught.value) == words
    with exclusive(tmp_path / "b.h5"):  # another file is free
        assert held(tmp_path) == "a.h5"
    holder.kill()
    holder.wait()
    assert held(tmp_path) is None
    with exclusive(target):
        pass
    assert list(tmp_path.iterdir()) == []  # and none stays behind


def test_waiting_ends_when_the_holder_does(tmp_path, holder):
    holder.kill()
    begin = time.monotonic()
    with exclusive(tmp_path / "a.h5", wait=True):
        assert time.monotonic() - begin < 30


def test_new_numbers_wait_for_a_stage_that_works_with_the_old_ones(tmp_path):
    scene = write_scene(tmp_path / "s")
    settings_stage.update_settings(scene, quiet=True)
    other = write_scene(tmp_path / "s", more="[piv]\nspacing = 4")
    assert list(changed_settings(other)) == ["piv.json"]
    process = hold(scene.out / "mesh")
    try:
        settings_stage.update_settings(
            write_scene(tmp_path / "s"), quiet=True
        )  # the same numbers: nothing to wait for
        other = write_scene(tmp_path / "s", more="[piv]\nspacing = 4")
        with pytest.raises(StageError, match=r"another make is at work here \(mesh\)"):
            settings_stage.update_settings(other, quiet=True)
        assert list(changed_settings(other)) == ["piv.json"]
    finally:
        process.kill()
        process.wait()
    settings_stage.update_settings(other, quiet=True)
    assert changed_settings(other) == {}
