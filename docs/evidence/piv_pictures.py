"""`make docs`: pictures of PIV, by the commands of its pages, and of turbulence."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from docs.evidence.piv.turbulence_field import TurbulentPlane
from docs.evidence.shared_data import shared_data
from piv.foreign.read import in_px
from piv.formats.plane_series import make_plane, provenance, write_plane

FRAMES = Path("docs/tutorials/frames").resolve()
SETTINGS = "--window 24 --spacing 8 --rate 500 --scale-mm-per-px 0.1"
PIV = (sys.executable, "-m", "piv")


def piv(command: str, folder: Path) -> None:
    """Run `piv COMMAND --quiet` in a folder."""
    subprocess.run([*PIV, *command.split(), "--quiet"], cwd=folder, check=True)


def tutorial(picture: Path, folder: Path) -> None:
    """The tutorial's recording: masks, vectors `piv.h5`, vortices, picture."""
    piv(f"mask {FRAMES} --dark -o masks", folder)
    piv(f"correlate {FRAMES} -o piv.h5 --mask masks {SETTINGS}", folder)
    piv("vortices piv.h5 -o vortices.csv", folder)
    piv(f"plot piv.h5 --vortices vortices.csv -o {picture}", folder)


def turbulence(picture: Path, folder: Path) -> None:
    """Vortices of a plane of synthetic turbulence, vectors every 8 px."""
    x, y = np.arange(0, 513, 8.0), np.arange(0, 513, 8.0)
    u, v = TurbulentPlane(2.5, seed=1)(*np.meshgrid(x, y))
    plane = in_px(make_plane(x, y, u, v), "frame")
    write_plane(plane.assign_attrs(provenance()), folder / "turbulence.h5")
    piv("vortices turbulence.h5 -o turbulence.csv", folder)
    piv(f"plot turbulence.h5 --vortices turbulence.csv -o {picture}", folder)


def karman(data: Path, picture: Path, folder: Path) -> None:
    """Vortices of a recorded wake, from PIVlab's example images in `data`."""
    frames = " ".join(f"{data}/pivlab_karman/PIVlab_Karman_0{k}.bmp" for k in (1, 2))
    piv(f"correlate {frames} -o karman.h5", folder)
    piv("vortices karman.h5 -o karman.csv", folder)
    piv(f"plot karman.h5 --vortices karman.csv -o {picture}", folder)


def draw(docs: Path) -> None:
    """All pictures; that of the recorded wake where its images are (SHARED_DATA)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tutorial((docs / "tutorials/piv.png").resolve(), folder)
        turbulence((docs / "vortices_turbulence.png").resolve(), folder)
        if data := shared_data():
            karman(data, (docs / "vortices_karman.png").resolve(), folder)
