"""Forked processes: for files that may crash or hang the library that reads them, and for work."""

import multiprocessing
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any, TypeVar

from piv.files.errors import one_line

_READ_LIMIT = 120  # s of CPU time; reading a file of gigabytes takes seconds
_WALL_LIMIT = 600.0  # s; even on a machine that gives a process a hundredth of its time
T = TypeVar("T")
_threads = [1]  # of OpenCV before a fork
_forking = Lock()  # two threads fork one after the other


def _end_threads() -> None:
    """End OpenCV's threads, which are idle, before a fork: its child would wait for them."""
    _forking.acquire()
    if opencv := sys.modules.get("cv2"):
        _threads[0] = opencv.getNumThreads()
        opencv.setNumThreads(1)


def _allow_threads() -> None:
    if opencv := sys.modules.get("cv2"):
        opencv.setNumThreads(_threads[0])
    _forking.release()


os.register_at_fork(
    before=_end_threads, after_in_parent=_allow_threads, after_in_child=_allow_threads
)


def read_in_child(read: Callable[..., T], *args: Any, cpu_limit: int = _READ_LIMIT) -> T:
    """The result or exception of `read(*args)` in a forked process, which may die of it.

    ChildProcessError where it died or exceeded its time.
    """
    receiver, sender = multiprocessing.Pipe(duplex=False)
    child = os.fork()
    if child == 0:
        _read_and_exit(sender, read, args, cpu_limit)
    sender.close()
    try:
        if not receiver.poll(_WALL_LIMIT):
            raise EOFError
        good, result = receiver.recv()
    except EOFError:
        raise ChildProcessError(
            "the library that reads it failed; the file is damaged or another kind"
        ) from None
    finally:
        receiver.close()
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    if not good:
        raise result
    return result


@contextmanager
def worker_pool(processes: int, *, forked: bool = False) -> Iterator[ProcessPoolExecutor]:
    """Worker processes that Ctrl-C ends silently, also during their first import.

    `forked`: they begin with all imported and compiled code of this process.
    Not where Numba's parallel loops have threads by then: forks wait for them.
    """
    kind = "fork" if forked else "spawn"
    with ProcessPoolExecutor(processes, get_context(kind), initializer=_end_at_interrupt) as pool:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which they inherit
        try:
            for _ in range(processes):  # each starts one
                pool.submit(os.getpid)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield pool


def _end_at_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _read_and_exit(
    sender: Connection, read: Callable[..., Any], args: tuple, cpu_limit: int
) -> None:
    try:
        for kind in (signal.SIGXCPU, signal.SIGSEGV, signal.SIGABRT):
            signal.signal(kind, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_limit, cpu_limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        silent = os.open(os.devnull, os.O_WRONLY)  # the libraries' own messages
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        try:
            answer = (True, read(*args))
        except Exception as error:
            known = type(error).__module__ == "builtins"  # others may not survive the way back
            answer = (False, error if known else ValueError(one_line(error, 200)))
        sender.send(answer)
    finally:
        os._exit(0)
