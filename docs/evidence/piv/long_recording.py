"""A recording of 5,000 frames with three bad ones, killed and resumed: `piv correlate`, one thread.

Pictures are small, so that the recording costs a CPU minute; their size counts for memory alone.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import h5py
import numpy as np

from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.particles import render
from piv.formats.plane_series import absent, read_plane

FRAMES, SHORT, SHAPE = 5000, 2000, (64, 96)  # a shorter recording shows what memory does
BAD = {1200: "black", 2500: "saturated", 3700: "cut off"}
SEED = 4401
PERIOD = 25  # frames after which the flow repeats: so many pictures are rendered


def pictures(folder: Path) -> None:
    """Particles that go round on a circle, as TIFF; three files are damaged."""
    turn = 2 * np.pi / PERIOD

    def path(x, y, t):
        return x + 8 * np.cos(turn * t), y + 8 * np.sin(turn * t)  # 2 px per frame

    frames = render(None, shape=SHAPE, seed=SEED, noise=0.02, frames=range(PERIOD), path=path)
    for k in range(FRAMES):
        image = frames[k % PERIOD]
        if BAD.get(k) in ("black", "saturated"):
            image = np.full_like(image, 255 * (BAD[k] == "saturated"))
        file = folder / f"{k:04d}.tif"
        cv2.imwrite(str(file), image)
        if BAD.get(k) == "cut off":
            file.write_bytes(file.read_bytes()[:500])


def run(source: str, output: Path, kill_at: int | None = None) -> tuple[float, float]:
    """Peak memory (MB) and CPU time (s) of a run; it is killed once so many fields are on disk."""
    command = [sys.executable, "-m", "piv", "correlate", source, "-o", str(output), "--quiet"]
    child = subprocess.Popen([*command, "--spacing", "16"])
    while kill_at is not None and finished(Path(f"{output}.part")) < kill_at:
        time.sleep(0.5)
    if kill_at is not None:
        os.kill(child.pid, signal.SIGKILL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != (0 if kill_at is None else -signal.SIGKILL):
        raise SystemExit(f"{' '.join(command)}: ended with {child.returncode}")
    return used.ru_maxrss / 1024, used.ru_utime + used.ru_stime


def finished(part: Path) -> int:
    """Fields in an unfinished file; it is written in order."""
    try:
        with h5py.File(part, "r", locking=False) as file:
            return int(np.count_nonzero(file["u"][:, 0, 0]))
    except (OSError, KeyError):  # not there yet, or a block is being written
        return 0


def study() -> None:
    """Memory of a short and a long recording; the long one is killed and resumed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "frames").mkdir()
        pictures(folder / "frames")
        short, _ = run(str(folder / "frames" / "[01]*.tif"), folder / "short.h5")
        _, first = run(str(folder / "frames"), folder / "long.h5", FRAMES // 2)
        peak, second = run(str(folder / "frames"), folder / "long.h5")
        with read_plane(folder / "long.h5") as series:
            count, lost = series.sizes["time"], np.flatnonzero(absent(series)).tolist()
            valid = float(series["valid"].mean())
    expected = sorted(k for bad in BAD for k in (bad - 1, bad))
    if lost != expected:
        raise SystemExit(f"absent fields {lost}, expected {expected}")
    write_study(
        "long_recording", [],
        f"- {FRAMES} frames of {SHAPE[1]} x {SHAPE[0]} px, of which one is black, one saturated "
        f"and one cut off, by one command: {count} fields, {valid:.1%} of the vectors valid. "
        f"The {len(lost)} fields of those frames are absent, and no other.",
        f"- Killed with {FRAMES // 2} fields on disk after {first:.0f} CPU s, resumed: "
        f"{second:.0f} CPU s for the rest.",
        f"- Peak memory: {short:.0f} MB with {SHORT} frames, {peak:.0f} MB with {FRAMES}.",
        f"Seed {SEED}; {libraries()}.",
    )  # fmt: skip
