"""Processes that are forked beside a library's threads."""

import time
from multiprocessing import get_context

import cv2
import numpy as np

import piv.files.child_process  # noqa: F401 - it prepares forks


def _one_thread():
    cv2.setNumThreads(1)
    cv2.GaussianBlur(np.zeros((600, 600), np.float32), (0, 0), 3)


def test_a_fork_does_not_wait_for_the_threads_of_opencv():
    """The stage piv, forked by a process that had measured vortices, waited for ever."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    for _ in range(5):
        cv2.GaussianBlur(np.ones((3000, 3000), np.float32), (0, 0), 5)
    time.sleep(1)  # until its threads sleep
    child = get_context("fork").Process(target=_one_thread)
    child.start()
    child.join(20)
    threads, ended = cv2.getNumThreads(), child.exitcode
    child.kill()
    cv2.setNumThreads(before)
    assert ended == 0
    assert threads == 2  # of this process, as before
