"""`make benchmark`: recordings whose truth is exact, for PIV of any program, in one folder.

python -m docs.evidence.benchmark [FOLDER]
"""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import xarray as xr

from docs.evidence.piv.flows import TurbulentPlane
from docs.evidence.piv.pairs import render_pair
from docs.evidence.small_scene import ROOT
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import FORCES
from pipeline.runs.run import open_run
from pipeline.scene.measurement import render_settings
from piv.files.settings import build
from piv.formats.plane_series import AXES, UNITS, make_plane, read_plane, write_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.particles import exact_displacement
from piv.synthetic.score import Sampler
from piv.synthetic.virtual_camera import Recorder, finger_at
from piv.vortices.table import tabulate_vortices
from postprocess.lab.dpiv_toml import VERSION, read_dpiv

PAGE = Path(__file__).with_name("benchmark.md")
FRAMES = 16  # of a scene's recording; of turbulence as many pairs as half of them
STEP = 4  # px between the truth's points
SEED = 20261128
# folder: scene, level, first picture (s on the simulation's clock)
SCENES = {
    "single_finger": ("single_finger", "smoke", 0.15),
    "pinch": ("pinch", "smoke", 0.12),
    "rigid_plate": ("validation/plate_rotating", "c40", 0.12),
}
RMS, NOISE, FIRST_SEED = 1.5, 0.03, 9001  # of turbulence: px, of the grey scale, seed of the first
SHAPE, SCALE, INTERVAL, RATE = (512, 640), 0.1, 1e-3, 100.0  # px, mm/px, s in a pair, pairs/s
DPIV = """format = "dpiv"
format_version = {version}
title = "{title}"
kind = "pictures"
files = "frames/*.tif"
frame_rate_hz = {rate}
start = {{ at_s = {start}, std_s = 0.0 }}
finger_geometry = "measured"
finger_length_std_mm = 0.0
scale = {{ scale_mm_per_px = {scale}, std_percent = 0.01 }}
axes = {{ y = "up", root_px = [{root[0]:.4f}, {root[1]:.4f}] }}
piv = {{ window = 32, spacing = 8, pairing = {pairing} }}
"""


def record_scene(case: str, level: str, start: float, folder: Path) -> None:
    """Pictures, masks, dpiv.toml and truth of a run whose laser sheet has been made."""
    run = open_run(ROOT / "cases" / case, level)
    settings = render_settings(run.scene.camera, run.scene.sheet)
    camera, seeding = build(settings, Camera, Seeding, more=("seed", "truth"))
    camera = smaller(replace(camera, pairs_every=1))
    with read_plane(run.path("sheet")) as sheet:
        first = int(np.argmin(abs(sheet["time"].values - start)))
        near = sheet["time"] < start + (FRAMES + 1) / camera.frame_rate_hz
        part = sheet.isel(time=near.values).isel(time=slice(first, None)).load()
    recorder = Recorder(part, camera, seeding, SEED)
    frames = zip(range(FRAMES), recorder.frames(), strict=False)
    write_pictures(((f.image, f.mask) for _, f in frames), folder)
    truth = truth_of(recorder)
    table = FORCES.read(run.path("solve").with_name("forces.csv"))
    left = [np.interp(truth["time"], table["time"], table[f"f{a}_pressure"]) for a in "xy"]
    sides = np.array([(1, 1), (-1, 1)])[: truth.sizes["finger"]]  # the second one is mirrored
    force = np.stack(left, axis=-1)[:, None] * sides / run.scene.finger.width
    truth["line_force"] = AXES["line_force"], force, {"units": UNITS["line_force"]}
    if run.scene.body is None:
        truth.attrs["tip_width"] = float(part.attrs["tip_width"])
    write_truth(truth.assign_coords(time=truth["time"] - recorder.time[0]), folder)
    root = np.asarray(read_kinematics(run.scene.motion_folder / "kinematics.h5").root)
    write_dpiv(
        folder,
        root=root / camera.pixel + recorder.origin_px,
        start=float(recorder.time[0]),
        rate=camera.frame_rate_hz,
        scale=camera.scale_mm_per_px,
        pairing='"1-2,2-3"',
    )


def smaller(camera: Camera) -> Camera:
    """The same view on at most SHAPE's columns, which keeps the folder small and its PIV cheap."""
    less = camera.width_px / SHAPE[1]
    if less <= 1 or camera.origin_px is None:
        return camera
    x, y = ((o + 0.5) / less - 0.5 for o in camera.origin_px)
    return replace(
        camera,
        width_px=SHAPE[1],
        height_px=round(camera.height_px / less),
        scale_mm_per_px=camera.scale_mm_per_px * less,
        origin_px=(x, y),
    )


def truth_of(recorder: Recorder) -> xr.Dataset:
    """Velocity, pressure and outlines halfway between the frames, origin in the corner pixel."""
    camera, rim = recorder.camera, recorder.rim_px
    shift = np.asarray(recorder.origin_px) * camera.pixel
    columns, up = (np.arange(0, n, STEP) for n in (camera.width_px, camera.height_px))
    tank = columns * camera.pixel - shift[0], up * camera.pixel - shift[1]
    xx, yy = np.meshgrid(*tank)
    inner = np.ix_(camera.height_px - 1 - up + rim, columns + rim)
    instants = []
    for k, (t0, t1) in enumerate(zip(recorder.time[: FRAMES - 1], recorder.time[1:], strict=False)):
        substeps, middle = recorder.motion(k).substeps, (t0 + t1) / 2
        dx, dy = exact_displacement(recorder.field, xx, yy, t0, t1, substeps)
        water = ~np.logical_or(*(recorder.body(t).mask[inner] > 0 for t in (t0, t1)))
        now = recorder.series[["p", "valid"]].interp(time=middle)
        p = Sampler(now.assign(valid=now["valid"] == 1), *tank)(now["p"])
        fields = {"u": dx / (t1 - t0), "v": dy / (t1 - t0), "p": p}
        fields = {n: np.where(water, f, np.nan).astype(np.float32) for n, f in fields.items()}
        fields |= {
            n: finger_at(recorder.series, n, middle) for n in ("outline", "outline_velocity")
        }
        instants.append(fields | {"valid": water, "time": middle})
    stacked = {name: np.stack([now[name] for now in instants]) for name in instants[0]}
    stacked["outline"] += shift
    plane = make_plane(tank[0] + shift[0], tank[1] + shift[1], **stacked)
    about = {"scale_mm_per_px": camera.scale_mm_per_px, "image_rows": camera.height_px}
    return plane.assign_attrs(about | {"interval": 1 / camera.frame_rate_hz})


def record_turbulence(folder: Path) -> None:
    """Pairs of planes of turbulence, each with its exact truth; no body, no pressure."""
    y, x = (np.arange(0.0, n, STEP) for n in SHAPE)
    pictures, flows = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + FRAMES // 2):
        field = TurbulentPlane(RMS, seed)
        pair = render_pair(partial(field, components=3), SHAPE, noise=NOISE, seed=seed)
        pictures += [(image, None) for image in pair]
        flows.append(field(*np.meshgrid(x, y)))
    write_pictures(pictures, folder)
    pixel = SCALE * 1e-3
    u, v = np.stack(flows, axis=1) * pixel / INTERVAL
    plane = make_plane(pixel * x, pixel * y, u, v, time=INTERVAL / 2 + np.arange(len(u)) / RATE)
    about = {"scale_mm_per_px": SCALE, "interval": INTERVAL, "image_rows": SHAPE[0]}
    write_truth(plane.assign_attrs(about), folder)
    pairs = f'"1-2,3-4", interval_s = {INTERVAL}'
    write_dpiv(folder, root=(0.0, 0.0), start=0.0, rate=RATE, scale=SCALE, pairing=pairs)


def write_pictures(pictures: Iterable[tuple[np.ndarray, np.ndarray | None]], folder: Path) -> None:
    """TIFF pictures in `frames`, and masks (white = body) of their names in `masks`."""
    for k, (image, mask) in enumerate(pictures):
        body = None if mask is None else 255 * (mask > 0).astype(np.uint8)
        for name, values in (("frames", image), ("masks", body)):
            if values is not None:
                (folder / name).mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(folder / name / f"{k:03d}.tif"), values)


def write_truth(truth: xr.Dataset, folder: Path) -> None:
    """truth.nc, and the vortices of it in vortices.nc."""
    write_plane(truth, folder / "truth.nc", source="truth")
    table = tabulate_vortices(truth)
    table = table.assign(finger=table["finger"].astype(float), side=table["side"].astype(str))
    table.to_xarray().to_netcdf(folder / "vortices.nc", engine="h5netcdf")


def write_dpiv(folder: Path, **values: object) -> None:
    """The laboratory's file of the recording, checked."""
    text = DPIV.format(version=VERSION, title=folder.name, **values)
    (folder / "dpiv.toml").write_text(text, encoding="utf-8")
    read_dpiv(folder)


def describe(folder: Path) -> None:
    """README.md, LICENSE, datacite.json and SHA256SUMS."""
    shutil.copy2(PAGE, folder / "README.md")
    (folder / "LICENSE").write_text(
        "Creative Commons Attribution 4.0 International (CC BY 4.0)\n"
        "https://creativecommons.org/licenses/by/4.0/legalcode\n"
    )
    title, abstract = PAGE.read_text(encoding="utf-8").split("\n\n")[:2]
    size = sum(path.stat().st_size for path in folder.rglob("*.*"))
    about = {
        "titles": [{"title": title.removeprefix("# ")}],
        "creators": [{"name": "The softfinger-piv developers", "nameType": "Organizational"}],
        "publicationYear": time.strftime("%Y"),
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "PIV benchmark"},
        "rightsList": [{"rights": "CC BY 4.0", "rightsIdentifier": "CC-BY-4.0"}],
        "descriptions": [{"descriptionType": "Abstract", "description": abstract}],
        "subjects": [{"subject": "particle image velocimetry"}, {"subject": "fluid dynamics"}],
        "formats": ["image/tiff", "application/x-netcdf"],
        "sizes": [f"{size / 1e6:.0f} MB"],
        "schemaVersion": "http://datacite.org/schema/kernel-4",
    }
    (folder / "datacite.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sums = (f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(folder)}" for p in files)
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")
    print(f"{folder}: {len(files)} files, {size / 1e6:.0f} MB")


def main(folder: Path) -> None:
    """Make the flows where they are stale, then everything of the folder anew."""
    page, title = folder / "README.md", PAGE.read_text(encoding="utf-8").splitlines()[0]
    ours = page.is_file() and title in page.read_text(encoding="utf-8", errors="replace")
    if folder.exists() and any(folder.iterdir()) and not ours:
        raise SystemExit(f"{folder}: is not empty and no benchmark; name another folder")
    shutil.rmtree(folder, ignore_errors=True)
    for name, (case, level, start) in SCENES.items():
        make = ["softfinger", "run", f"cases/{case}", "--level", level, "--until", "sheet"]
        subprocess.run([sys.executable, "-m", *make], cwd=ROOT, check=True)
        record_scene(case, level, start, folder / name)
    record_turbulence(folder / "turbulence")
    describe(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "benchmark")
