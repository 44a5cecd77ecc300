"""Laboratory and simulated fields on one grid and at the same instants."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import (
    OUTLIER,
    UNCERTAIN,
    VALID,
    make_plane,
    read_plane,
    write_plane,
)
from piv.synthetic.camera import Camera
from postprocess.evidence.fields import ROUNDING, on_grid
from postprocess.lab.data.dpiv_toml import Dpiv, LabCamera
from postprocess.lab.data.files import LabFiles, Registration
from postprocess.lab.data.pictures import LabRecording, outline_mask, thinned
from postprocess.lab.data.pose import Pose, camera_series, in_camera
from postprocess.lab.data.seeding import Appearance, measure_appearance, seeding_like
from postprocess.lab.data.vectors import camera_before, lab_vectors
from postprocess.lab.registration.register import law_pressure
from postprocess.lab.registration.silhouette import CORE_PX, learn, shrunk
from postprocess.lab.virtual.virtual_experiment import evaluate, virtual_experiment

SEEDING_PICTURES = 4  # pictures from which the seeding is measured


@dataclass(frozen=True)
class CommonGrid:
    """Plane series in the camera frame with the same axes and times; `virtual` may be None."""

    data: xr.Dataset
    virtual: xr.Dataset | None
    direct: xr.Dataset
    appearance: dict[str, Any]


def on_common_grid(
    files: LabFiles, dpiv: Dpiv, kinematics: Kinematics, registration: Registration, **options: Any
) -> CommonGrid:
    """Evaluate both sides alike; writes data.h5, virtual.h5 and direct.h5.

    `options`: seed, threads and quiet.
    """
    if not files.sheet.exists():
        raise FileNotFoundError(f"{files.sheet} is missing; run make compare first")
    with read_plane(files.sheet) as sheet:
        sheet = sheet.load()
    make = _of_pictures if dpiv.kind == "pictures" else _of_vectors
    data, virtual, seen = make(files, dpiv, kinematics, registration, sheet, options)
    x, y, times = (data[name].values for name in ("x", "y", "time"))
    direct = camera_series(sheet, registration.pose, x, y, times)
    written = ("data", "lab", data), ("virtual", "piv", virtual), ("direct", "cfd", direct)
    for name, source, plane in written:
        if plane is not None:
            write_plane(plane, files.side(name), source=source)
    return CommonGrid(data, virtual, direct, {} if seen is None else asdict(seen))


def _used_frames(
    dpiv: Dpiv, times: np.ndarray, delay: float, span: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Frames that the simulation covers, whole pairs only: indices and times (s of it)."""
    at = times - delay
    ok = (at >= span[0] - 1e-9) & (at <= span[1] + 1e-9)
    if dpiv.piv.pairing == "1-2,3-4":
        ok = ok[: ok.size // 2 * 2]
        ok = np.repeat(ok[::2] & ok[1::2], 2)
    index = _enough(ok, at, span)
    return index, np.clip(at[index], *span)


def _enough(ok: np.ndarray, at: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Indices of the instants that are `ok`; ValueError where there are fewer than four."""
    index = np.flatnonzero(ok)
    if index.size < 4:
        raise StageError(
            f"the data cover {at[0]:.3f}…{at[-1]:.3f} s of the simulation's clock, the simulation"
            f" {span[0]:.3f}…{span[1]:.3f} s: they share fewer than four instants; check start in"
            " dpiv.toml"
        )
    return index


def with_finger(
    plane: xr.Dataset, kinematics: Kinematics, pose: Pose, pressures: np.ndarray
) -> xr.Dataset:
    """A plane series in the camera frame with the finger's shape at each pressure (Pa)."""
    finger = {}
    for name in kinematics.splines:
        shapes = np.array([kinematics.fingers(name, p) for p in pressures])
        finger[name] = in_camera(name, shapes, pose)
    names = (n for n in plane.data_vars if plane[n].dims == ("time", "y", "x"))
    grids = {str(n): plane[n].values for n in names}
    x, y, time = (plane[name].values for name in ("x", "y", "time"))
    out = make_plane(x, y, time=time, **grids, **finger)
    return out.assign_attrs(plane.attrs | {"tip_width": kinematics.tip_width})


def outlines_px(kinematics: Kinematics, pose: Pose, pressures: np.ndarray) -> list[np.ndarray]:
    """The outlines (finger, point, 2) in the picture at pressures (Pa)."""
    return [pose.to_px(kinematics.fingers("outline", p)) for p in pressures]


def _of_pictures(files, dpiv, kinematics, registration, sheet, options):
    law, pose = registration.law, registration.pose
    speed = {name: options[name] for name in ("threads", "quiet")}
    with LabRecording(dpiv) as recording:
        span = float(sheet["time"][0]), float(sheet["time"][-1])
        index, times = _used_frames(dpiv, recording.times, law.delay, span)
        theirs = law_pressure(kinematics, times + law.delay, law.values)
        shapes = outlines_px(kinematics, pose, theirs)
        output = files.folder / "data_piv.h5"
        piv = evaluate(recording, index, times, shapes, pose, dpiv.piv, output, **speed)
        pressures = law_pressure(kinematics, piv["time"].values + law.delay, law.values)
        data = with_finger(piv, kinematics, pose, pressures)
        chosen = thinned(np.arange(index.size), SEEDING_PICTURES)
        images = [recording.frame(int(index[k])) for k in chosen]
        masks = [outline_mask(shapes[k], recording.shape) for k in chosen]
        seen = appearance_of(images, masks)
        rows, columns = recording.shape
        camera = _camera(columns, rows, recording.bits, seen, dpiv.frame_rate_hz)
        seeding = seeding_like(seen, recording.bits, dpiv.sheet_thickness_mm * 1e-3)
        ours = outlines_px(kinematics, pose, kinematics.law(times))
        at = pose, camera, seeding, times, ours, dpiv.piv, files.folder
        virtual = virtual_experiment(sheet, *at, **options)
        virtual = with_finger(virtual, kinematics, pose, kinematics.law(virtual["time"].values))
    return data, virtual, seen


def appearance_of(images: list[np.ndarray], masks: list[np.ndarray]) -> Appearance:
    """Seeding and noise of pictures in which the body is masked."""
    evidence = learn(images, masks)
    cores = (i[shrunk(mask, CORE_PX)] for i, mask in zip(images, masks, strict=True))
    core = np.concatenate(list(cores)).astype(float)
    middle = core[np.abs(core - evidence.body_level) < 5 * evidence.body_std]
    return measure_appearance(images, masks, float(middle.mean()), float(middle.std()))


def _camera(columns: int, rows: int, bits: int, seen: Appearance, rate: float) -> Camera:
    noise: dict[str, Any] = {"background": seen.background, "read_noise": seen.read_noise}
    return Camera(columns, rows, frame_rate_hz=rate, bits=bits, electrons_per_level=0.0, **noise)


def _of_vectors(files, dpiv, kinematics, registration, sheet, options):
    plane = lab_vectors(dpiv)
    pose, delay = registration.pose, registration.law.delay
    times = plane["time"].values - delay
    span = float(sheet["time"][0]), float(sheet["time"][-1])
    margin = 0.5 * dpiv.interval
    keep = _enough((times >= span[0] + margin) & (times <= span[1] - margin), times, span)
    plane, times, scale = plane.isel(time=keep), times[keep], pose.pixel
    # the vectors' metres are the stated ones: the pose holds what is known of the true scale
    plane = plane.assign_coords(x=plane["x"] * scale, y=plane["y"] * scale, time=times)
    velocities = (n for n in ("u", "v", "u_std", "v_std") if n in plane)
    plane = plane.assign({n: plane[n] * scale for n in velocities})
    pressures = kinematics.law(times)
    data = with_finger(plane, kinematics, pose, pressures)
    if not isinstance(dpiv.camera, LabCamera):
        return data, None, None
    c = dpiv.camera
    seen = Appearance(c.density_ppp, c.diameter_px, c.peak, c.background, c.read_noise)
    pairs = np.column_stack([times - margin, times + margin]).ravel()
    camera_pose, corner = camera_before(data, pose, c)
    camera = _camera(c.columns, c.rows, c.bits, seen, 1 / dpiv.interval)
    seeding = seeding_like(seen, c.bits, dpiv.sheet_thickness_mm * 1e-3)
    ours = outlines_px(kinematics, camera_pose, kinematics.law(pairs))
    alike = {"pairing": "1-2,3-4", "smoothing": dpiv.piv.smoothing is True}
    at = camera_pose, camera, seeding, pairs, ours, dpiv.piv.model_copy(update=alike), files.folder
    virtual = virtual_experiment(sheet, *at, **options)
    virtual = virtual.assign_coords(x=virtual["x"] + corner[0], y=virtual["y"] + corner[1])
    x, y = data["x"].values, data["y"].values
    velocity, whole = on_grid(virtual, x, y)
    more = {}
    for name in ("u_std", "v_std", "valid"):
        filled = virtual.assign(u=virtual[name], v=virtual[name])
        more[name] = np.where(whole, on_grid(filled, x, y)[0][:, 0], np.nan)
    sure = more.pop("valid") > 1 - ROUNDING
    more["flag"] = np.where(sure, VALID, np.where(whole, UNCERTAIN, OUTLIER)).astype(np.uint8)
    u, v = np.moveaxis(np.where(whole[:, None], velocity, np.nan), 1, 0)
    virtual = make_plane(x, y, u, v, time=times, valid=sure, **more)
    return data, with_finger(virtual, kinematics, pose, pressures), seen
