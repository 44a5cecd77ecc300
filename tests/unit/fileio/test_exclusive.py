"""One writer of a file at a time."""

import subprocess
import sys
import time

import pytest

from fileio.errors import sentence
from fileio.lock import exclusive
from tests.conftest import ROOT

HOLD = "import sys, time; from pathlib import Path; from fileio.lock import exclusive\nwith exclusive(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"


@pytest.fixture
def holder(tmp_path):
    """Another process that holds the lock on tmp_path/a.h5."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "a.h5")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()


def test_a_second_writer_is_told_and_a_killed_one_leaves_no_lock(tmp_path, holder):
    target = tmp_path / "a.h5"
    with pytest.raises(BlockingIOError) as caught, exclusive(target):
        pass
    assert (
        sentence(caught.value)
        == f"{target}: another make or command is writing it; wait for it or stop it"
    )
    with exclusive(tmp_path / "b.h5"):  # another file is free
        pass
    holder.kill()
    holder.wait()
    with exclusive(target):
        pass
    assert list(tmp_path.iterdir()) == []  # and none stays behind


def test_waiting_ends_when_the_holder_does(tmp_path, holder):
    holder.kill()
    begin = time.monotonic()
    with exclusive(tmp_path / "a.h5", wait=True):
        assert time.monotonic() - begin < 30
