"""Whether an HDF5 file can be walked at all: on some damaged files the library loops for ever or ends the process."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import h5py

CPU_LIMIT = 3  # s; walking a sound file takes milliseconds
WALL_LIMIT = 600.0  # s; even on a machine that gives a process a hundredth of its time


def check_walkable(path: str | Path) -> None:
    """ValueError where HDF5 cannot get through the file's structure, tried in a forked process that may die of it.

    What the library refuses by itself, and systems that cannot fork, pass: the caller's own opening reports those.
    """
    if not hasattr(os, "fork") or not Path(path).is_file():
        return
    child = os.fork()
    if child == 0:
        _walk_and_exit(str(path))
    deadline = time.monotonic() + WALL_LIMIT
    pause = 0.001
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            break
        time.sleep(pause)
        pause = min(2 * pause, 0.05)
    if os.WIFSIGNALED(status):
        raise ValueError(f"{path}: damaged: the HDF5 library cannot get through its structure")


def _walk_and_exit(path: str) -> None:
    import resource

    try:
        for kind in (signal.SIGXCPU, signal.SIGSEGV, signal.SIGABRT):
            signal.signal(kind, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT, CPU_LIMIT))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with h5py.File(path, "r") as file:
            _walk(file)
            file.visititems(lambda _, item: _walk(item))
    except BaseException:
        os._exit(1)
    os._exit(0)


def _walk(item: h5py.Group | h5py.Dataset) -> None:
    for name in item.attrs:
        item.attrs[name]
    if isinstance(item, h5py.Dataset) and item.chunks is not None:
        item.id.get_num_chunks()
