"""Run docs/examples and keep their pictures, which the gallery shows.

python -m docs.evidence.examples
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from docs.evidence.small_scene import ROOT

FOLDER = ROOT / "docs" / "examples"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))


def place(folder: Path, results: Path) -> None:
    """Lay what the examples read into a folder: scenes, docs, and `results` of single_finger."""
    shutil.copytree(ROOT / "cases", folder / "cases", ignore=shutil.ignore_patterns("out"))
    (folder / "docs").symlink_to(ROOT / "docs")
    (folder / "cases" / "single_finger" / "out").mkdir()
    shutil.copytree(results, folder / "cases" / "single_finger" / "out" / "smoke")


def run_example(name: str, folder: Path) -> Path:
    """Run an example in a folder of `place`; returns its picture. CalledProcessError."""
    environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-P", str(FOLDER / f"{name}.py")]
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    return folder / f"{name}.png"


def main() -> None:
    """Make the results at level smoke, then every picture."""
    scene = ROOT / "cases" / "single_finger"
    command = [sys.executable, "-m", "softfinger", "run", str(scene), "--level", "smoke"]
    subprocess.run(command, cwd=ROOT, check=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        place(folder, scene / "out" / "smoke")
        for example in NAMES:
            shutil.copy2(run_example(example, folder), FOLDER)


if __name__ == "__main__":
    main()
