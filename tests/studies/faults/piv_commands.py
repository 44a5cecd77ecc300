"""The commands of piv that no stage runs, on a full disk and on one that has room again."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from tests.studies.faults.project import out_of

# Arguments of `piv`; {} is the folder of the scene's results, on the full disk.
COMMANDS = {
    "correlate --ensemble": "correlate {}/images.h5 -o {}/mean.h5 --ensemble"
    " --preset fast --every 4",
    "calibrate": "calibrate --scale-mm-per-px 0.2 -o {}/calibration.json",
    "mask": "mask {}/images.h5 --image {}/camera.png -o {}/mask.png",
    "plot .png": "plot {}/piv.h5 -o {}/plot.png",
    "plot .svg": "plot {}/piv.h5 -o {}/plot.svg",
    "animate .mp4": "animate {}/piv.h5 -o {}/film.mp4 --every 4",
    "animate .gif": "animate {}/piv.h5 -o {}/film.gif --every 4",
    **{
        f"convert {suffix}": f"convert {{}}/piv.h5 -o {{}}/vectors{suffix}"
        for suffix in (".h5", ".nc", ".csv", ".vti", ".txt", ".dat")
    },
}
ROOM = 0  # KiB: a calibration is smaller than the smallest room of a disk


def piv_commands(
    project: Path, fill: Callable[[int], None], empty: Callable[[], None]
) -> Iterator[tuple[str, subprocess.CompletedProcess, str]]:
    """Name, result on the full disk and fault afterwards of each command; `fill`, `empty`: disk."""
    out = out_of(project)
    cv2.imwrite(str(out / "camera.png"), np.ones((256, 320), "u1"))
    for name, text in COMMANDS.items():
        arguments = text.replace("{}", str(out.relative_to(project))).split()
        command = [".venv/bin/python", "-m", "piv", *arguments, "--quiet"]

        def run(command: list[str] = command) -> subprocess.CompletedProcess:
            return subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)

        before = set(out.rglob("*"))
        fill(ROOM)
        full = run()
        empty()
        left = sorted(p.name for p in set(out.rglob("*")) - before if p.suffix != ".part")
        again = run()
        wrong = f"{', '.join(left)} left behind" if left else ""
        if again.returncode != 0:
            wrong = f"does not go on: {again.stderr.strip()[-200:]}"
        yield f"piv {name}", full, wrong or "works"
        for path in sorted(set(out.rglob("*")) - before):
            path.unlink()
