"""The wheel with its core dependencies does PIV from the command line and from Python."""

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]

SIMULATION = (
    "gmsh", "pyvista", "felupe", "meshio", "shapely", "tensortrax", "pydantic", "lvpyio",
    "imageio_ffmpeg", "matplotlib",
)  # fmt: skip
FROM_PYTHON = f"""
import sys, cv2
from piv import correlate_pair, find_vortices, open_recording
with open_recording(sys.argv[1:3]) as recording:
    print(recording)
    plane = correlate_pair(*recording)
print(find_vortices(plane)[0])
present = [name for name in {SIMULATION!r} if name in sys.modules]
assert not present, present
"""


def run(*command, cwd):
    """Output of a command outside the checkout, which must succeed."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    options = {"cwd": cwd, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run([*map(str, command)], **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel; skipped where the package index, which has its backend, is out of reach."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    backend = ["download", "-q", "--no-deps", "-d", folder / "backend", "hatchling"]
    if subprocess.run([*pip, *backend]).returncode:
        pytest.skip("the package index cannot be reached")
    run(*pip, "wheel", "-q", "--no-deps", "-w", folder, ROOT, cwd=folder)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Folder of the programs of an environment that holds the wheel and its core dependencies."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=True)
    run(folder / "bin/python", "-m", "pip", "install", "-q", wheel, cwd=folder)
    (package,) = folder.glob("lib/*/site-packages/piv")
    take_compiled(package)
    return folder / "bin"


def take_compiled(package: Path) -> None:
    """Copy this clone's compiled functions (numba's cache), which belong to the same sources."""
    for source in package.rglob("*.py"):
        here = ROOT / "piv" / source.relative_to(package)
        shutil.copystat(here, source)  # numba knows a source by its size and date
        for compiled in here.parent.glob(f"__pycache__/{here.stem}.*.nb[ic]"):
            (source.parent / "__pycache__").mkdir(exist_ok=True)
            shutil.copy2(compiled, source.parent / "__pycache__")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two images of particles that turn round the middle by 0.03 rad."""
    folder = tmp_path_factory.mktemp("pair")
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 256, (2, 2600))
    angle = 0.03 * np.exp(-((x - 128) ** 2 + (y - 128) ** 2) / 50**2)
    for k, share in enumerate((-0.5, 0.5)):
        c, s = np.cos(share * angle), np.sin(share * angle)
        px, py = 128 + c * (x - 128) - s * (y - 128), 128 + s * (x - 128) + c * (y - 128)
        image = np.zeros((256, 256))
        rows, columns = np.mgrid[:256, :256]
        for a, b in zip(px, py, strict=True):
            i, j = slice(max(int(b) - 4, 0), int(b) + 5), slice(max(int(a) - 4, 0), int(a) + 5)
            image[i, j] += 120 * np.exp(-((columns[i, j] - a) ** 2 + (rows[i, j] - b) ** 2) / 1.6)
        cv2.imwrite(str(folder / f"{k}.png"), image.clip(0, 255).astype(np.uint8))
    return folder


@pytest.mark.slow
def test_console_script(installed, pair):
    assert run(installed / "piv", "--version", cwd=pair).startswith("piv ")
    run(installed / "piv", "correlate", "0.png", "1.png", "-o", "v.h5", "--quiet", cwd=pair)
    found = run(installed / "piv", "vortices", "v.h5", "-o", "v.csv", cwd=pair)
    assert int(found.split(": ")[1].split()[0]) >= 1
    run(installed / "piv", "convert", "v.h5", "-o", "v.mat", cwd=pair)
    with pytest.raises(AssertionError, match="VTK files need the package pyvista: pip install"):
        run(installed / "piv", "convert", "v.h5", "-o", "v.vti", cwd=pair)
    with pytest.raises(AssertionError, match="piv plot: pictures need the package matplotlib: pip"):
        run(installed / "piv", "plot", "v.h5", "--vortices", "v.csv", "-o", "v.png", cwd=pair)


@pytest.mark.slow
def test_from_python(installed, pair):
    lines = run(installed / "python", "-c", FROM_PYTHON, "0.png", "1.png", cwd=pair).splitlines()
    assert lines[0].endswith("2 frames>")
    assert lines[1].startswith("Vortex(x=1")
    missing = run(installed / "python", "-m", "pip", "list", "--format", "freeze", cwd=pair).lower()
    assert not [name for name in SIMULATION if f"\n{name}==" in missing]


@pytest.mark.slow
def test_the_wheel_is_the_package_piv_alone(wheel, installed, pair):
    with zipfile.ZipFile(wheel) as file:
        names = {n for n in file.namelist() if ".dist-info/" not in n}
    tracked = run("git", "ls-files", "piv", cwd=ROOT).split()
    assert names == set(tracked)
    for other in ("pipeline", "postprocess", "softfinger"):
        code = f"import importlib.util as u; assert u.find_spec('{other}') is None"
        run(installed / "python", "-c", code, cwd=pair)
