"""One writer of a file at a time."""

import subprocess
import sys

import pytest

from piv.files.errors import sentence
from piv.files.lock import exclusive
from tests.conftest import ROOT

HOLD = """
import sys, time
from pathlib import Path
from piv.files.lock import exclusive
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
    with pytest.raises(BlockingIOError) as caught, exclusive(target):
        pass
    words = f"{target}: another make or command is writing it; wait for it or stop it"
    assert sentence(caught.value) == words
    with exclusive(tmp_path / "b.h5"):  # another file is free
        pass
    holder.kill()
    holder.wait()
    with exclusive(target):
        pass
    assert list(tmp_path.iterdir()) == []  # and none stays behind
