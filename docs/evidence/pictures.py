"""`make docs`: pictures and numbers of the docs from runs, and pictures from exact fields.

python -m docs.evidence.pictures [SCENE ...]    (the repository's root; LEVEL as in make)
"""

import json
import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.ticker import LogLocator, NullFormatter
from PIL import Image

from docs.evidence.piv.flows import TurbulentPlane
from docs.evidence.small_scene import shared_data
from pipeline.formats.records import RUN
from pipeline.runs.stages import STAGES
from pipeline.scene.scene import load_scene
from piv.files.atomic import write_bytes
from piv.files.command import guarded
from piv.files.errors import StageError
from piv.foreign.read import in_px
from piv.formats.plane_series import make_plane, provenance, write_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.virtual_camera import Recorder
from piv.vortices.lamb_oseen_fit import lamb_oseen
from postprocess.draw.animation import write_picture
from postprocess.draw.style import CFD, new_figure, save
from postprocess.report.wording import requirement
from postprocess.tables import write_table
from postprocess.words import VERDICTS, measured_text
from softfinger.study.table import commit

DOCS = Path("docs")
# figures of a page that the docs show, beside the flow half-way through the run
SHOWN = {
    "single_finger": ("space_end.webp", "slices.webp", "pressure.webp"),
    "pinch": ("pair_dorsal.webp", "pair_ventral.webp"),
}
FRAMES = Path("docs/tutorials/frames").resolve()
SETTINGS = "--window 24 --spacing 8 --rate 500 --scale-mm-per-px 0.1"


def copy_figures(scene: str, level: str) -> None:
    """The picture half-way through a run, which of a pinch is about contact, and others it has."""
    figures = load_scene(Path("cases") / scene, level).out / "figures"
    name = scene if level == "coarse" else f"{scene}_{level}"
    flow = sorted(figures.glob("flow_*.webp"))
    if not flow:
        raise StageError(f"{figures}: no flow_*.webp; run make {scene} LEVEL={level} first")
    _copy(flow[len(flow) // 2], DOCS / name)
    for figure in SHOWN.get(scene, ()):
        _copy(figures / figure, DOCS / f"{name}_{figure.partition('.')[0]}")


def copy_numbers(scene: str, level: str) -> None:
    """What a run found and took, as the tables of its page: docs/scenes/."""
    out = load_scene(Path("cases") / scene, level).out
    name = scene if level == "coarse" else f"{scene}_{level}"
    checks = json.loads((out / "comparison.json").read_text(encoding="utf-8"))["checks"]
    rows = [(c["finding"], requirement(c), measured_text(c), VERDICTS[c["met"]]) for c in checks]
    found = pd.DataFrame(rows, columns=["finding", "asked for", "measured", "verdict"])
    write_table(DOCS / f"scenes/{name}_findings.csv", found)

    run = RUN.read(out / "run/run.json")
    balance = run["power_balance"]
    work, taken = abs(balance["work"]), balance["taken"]
    day = date.fromtimestamp((out / "run/run.json").stat().st_mtime)
    facts = {
        "made": f"{day}, level {level}, model {run['model']}, commit {commit()}",
        "stages": ", ".join(f"{stage.name} {stage.version}" for stage in STAGES),
        "cells": f"{run['cells']:,}",
        "time steps": f"{run['steps']:,} of {run['time_step'] * 1e3:g} ms",
        "time of the solver": f"{run['wall_time']:.0f} s on {run['ranks']} ranks",
        "largest Courant number": f"{run['courant_max']:.1f}",
        "the finger's work on the water": f"{work * 1e3:.3f} mJ",
        "of it kinetic energy at the end": f"{balance['kinetic_energy'] / work:.0%}",
        "taken by viscosity": f"{taken['viscous'] / work:.0%}",
        "taken by the convection scheme": f"{taken['convection'] / work:.0%}",
        "taken by coupling pressure and velocity": f"{taken['coupling'] / work:.0%}",
        "unexplained": f"{abs(balance['unexplained_fraction']):.1%}",
    }
    table = pd.DataFrame(facts.items(), columns=["run", "value"])
    write_table(DOCS / f"scenes/{name}_run.csv", table)


def _copy(picture: Path, target: Path) -> None:
    """A picture of a page as the docs have it: SVG as it is, others as PNG."""
    if picture.suffix == ".svg":
        write_bytes(target.with_suffix(".svg"), picture.read_bytes())
    else:
        write_picture(np.asarray(Image.open(picture)), target.with_suffix(".png"))


def tradeoff(scene: str) -> None:
    """Largest error of each level against CPU time of the flow; a line joins those not beaten."""
    table = Path("cases") / scene / "studies/results/tradeoff.csv"
    levels = pd.read_csv(table, comment="#").query("run == level").dropna(subset="error")
    figure, axis = new_figure(5.5, 4.6)
    ahead = levels[levels["front"]].sort_values("cpu_flow_s")
    axis.plot(ahead["cpu_flow_s"], 100 * ahead["error"], "o-", color=CFD, lw=1.2)
    for run, cost, error in levels[["run", "cpu_flow_s", "error"]].itertuples(index=False):
        axis.annotate(run, (cost, 100 * error), (6, 6), textcoords="offset points")
    axis.set(xscale="log", yscale="log", xlabel="CPU time of the flow, s", ylabel="worst error, %")
    axis.margins(x=0.2, y=0.1)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(lambda value, _: f"{value:g}")
        side.set_minor_formatter(NullFormatter())
    save(figure, DOCS / f"tradeoff/{scene}.svg")


def synthetic(path: Path) -> None:
    """A frame with body and shadow, and the brightest of 16 frames."""
    x, y = np.arange(0, 0.0601, 1e-3), np.arange(0, 0.0501, 1e-3)
    xx, yy = np.meshgrid(x, y)
    body = (xx > 0.014) & (xx < 0.026) & (yy > 0.02)
    flow = lamb_oseen(xx, yy, 0.038, 0.022, -0.015, 6e-3)
    u, v = (np.tile(np.where(body, np.nan, f), (16, 1, 1)) for f in flow)
    corners = np.array([[0.014, 0.02], [0.026, 0.02], [0.026, 0.036], [0.014, 0.036]])
    outline = np.tile(corners, (16, 1, 1, 1))
    series = make_plane(x, y, u, v, time=np.arange(16) / 500, outline=outline)
    camera = Camera(width_px=448, height_px=352)
    recorder = Recorder(series, camera, Seeding(shadow=0.9), seed=1)
    frames = [frame.image.astype(float) for frame in recorder.frames()]
    pictures = {
        "one frame: black body, shadow above it": frames[0],
        "brightest of 16 frames: the same particles move on": np.max(frames, axis=0),
    }
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for axis, (title, image) in zip(axes, pictures.items(), strict=True):
        axis.imshow(image, cmap="gray", vmin=0, vmax=200)
        axis.set(title=title, xlabel="column, px", ylabel="row, px")
    figure.savefig(path, dpi=110)


def of_tests(folder: Path) -> None:
    """Pictures of the tutorials and of the viewer, by the tests that do their steps."""
    tests = (
        "tests/cases/test_tutorials.py::test_an_own_finger_and_its_recording",
        "tests/unit/piv/test_view_task.py",
    )
    if pytest.main([*tests, "-q", f"--basetemp={folder / 'test'}"]):
        raise StageError(f"{' or '.join(tests)} failed, so that their pictures are not made anew")
    (out,) = folder.glob("test/**/clone/cases/my_finger/out/smoke")
    flow = sorted((out / "figures").glob("flow_*.webp"))
    _copy(flow[len(flow) // 2], DOCS / "tutorials/own_finger")
    _copy(out / "lab/recording/figures/series.svg", DOCS / "tutorials/comparison")
    for picture in folder.glob("test/**/view*.png"):  # none without a browser
        _copy(picture, DOCS / picture.stem)


def piv(command: str, folder: Path) -> None:
    """Run `piv COMMAND --quiet` in a folder."""
    subprocess.run(
        [sys.executable, "-m", "piv", *command.split(), "--quiet"], cwd=folder, check=True
    )


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


def of_piv(docs: Path) -> None:
    """Pictures of PIV; that of the recorded wake where its images are (SHARED_DATA)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tutorial((docs / "tutorials/piv.png").resolve(), folder)
        turbulence((docs / "vortices_turbulence.png").resolve(), folder)
        if data := shared_data():
            karman(data, (docs / "vortices_karman.png").resolve(), folder)


def main() -> None:
    """Copy the pictures and numbers of scenes that are named; otherwise draw all others."""
    if scenes := sys.argv[1:]:
        level = os.environ.get("LEVEL") or "coarse"
        for scene in scenes:
            copy_figures(scene, level)
            copy_numbers(scene, level)
        return
    tradeoff("single_finger")
    synthetic(DOCS / "synthetic.png")
    of_piv(DOCS)
    with tempfile.TemporaryDirectory() as folder:
        of_tests(Path(folder))


if __name__ == "__main__":
    sys.exit(guarded("pictures", main))
