"""Laboratory and simulated fields on one grid and at the same instants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import make_plane, usable, write_plane
from piv.vortices.find import VortexSettings
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles, Registration
from postprocess.lab.data.pictures import LabRecording
from postprocess.lab.data.pose import Pose, camera_series, in_camera
from postprocess.lab.data.vectors import lab_vectors
from postprocess.lab.judgement.case import Sides
from postprocess.lab.registration.register import law_pressure
from postprocess.lab.virtual.virtual_experiment import Still, evaluate, virtual_experiment

# Of the tip's width: smoothing length, of which the circle of the circulation has three. Wider than
# where a vortex is found in one flow, since meshes and windows then change less of it.
WIDE = 2 / 9


def on_common_grid(
    files: LabFiles,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    **options: Any,
) -> Sides:
    """Evaluate both sides alike; writes data.h5, virtual.h5 and direct.h5.

    `sheet`: the simulation's over the registration's view. `options`: threads and quiet.
    """
    make = _of_pictures if dpiv.kind == "pictures" else _of_vectors
    data, virtual = make(files, dpiv, kinematics, registration, sheet, options)
    x, y, times = (data[name].values for name in ("x", "y", "time"))
    direct = camera_series(sheet, registration.pose, x, y, times)
    written = ("data", "lab", data), ("virtual", "piv", virtual), ("direct", "cfd", direct)
    for name, source, plane in written:
        write_plane(plane, files.side(name), source=source)
    settings = files.stage.numbers.vortices.model_dump(mode="json")
    px = registration.pose.pixel  # m; of vectors the picture's unit is the stated metre
    window = dpiv.piv.window * (px * dpiv.scale.pixel if dpiv.kind == "vectors" else px)
    # one scale for all sides, although their windows differ
    scale = settings["scale"] or max(WIDE * kinematics.tip_width, 0.5 * window)
    vortices = VortexSettings(**settings | {"scale": scale, "correlation_length": window})
    return Sides(data, virtual, direct, vortices, window)


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


def _of_pictures(
    files: LabFiles,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    options: dict[str, Any],
) -> tuple[xr.Dataset, xr.Dataset]:
    law, pose = registration.law, registration.pose
    with LabRecording(dpiv) as recording:
        span = float(sheet["time"][0]), float(sheet["time"][-1])
        index, times = _used_frames(dpiv, recording.times, law.delay, span)
        theirs = law_pressure(kinematics, times + law.delay, law.values)
        shapes = outlines_px(kinematics, pose, theirs)
        known = pose, dpiv.piv
        output = files.folder / "data_piv.h5"
        data = evaluate(recording, index, times, shapes, *known, output, **options)
        middle = data["time"].values
        pressures = law_pressure(kinematics, middle + law.delay, law.values)
        data = with_finger(data, kinematics, pose, pressures)
        first = np.searchsorted(times, middle) - 1
        pairs = np.column_stack([middle, middle]) + dpiv.interval * np.array([-0.5, 0.5])
        # the recording's finger hides particles from the simulation's flow
        ours = outlines_px(kinematics, pose, kinematics.law(np.clip(pairs.ravel(), *span)))
        both = [
            np.concatenate([one, shapes[k]])
            for one, k in zip(ours, np.repeat(first, 2), strict=True)
        ]
        moved = recording, index[first], pairs.ravel(), sheet, pose, both, dpiv.piv
        virtual = virtual_experiment(*moved, files.folder / "virtual_piv.h5", **options)
        return data, with_finger(virtual, kinematics, pose, kinematics.law(middle))


def _of_vectors(
    files: LabFiles,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    options: dict[str, Any],
) -> tuple[xr.Dataset, xr.Dataset]:
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
    # pictures of a camera whose windows reach beyond the vectors on all sides
    px, border = dpiv.scale.pixel * scale, 2 * dpiv.piv.window
    x, y = plane["x"].values, plane["y"].values
    corner = np.array([x[0], y[0]]) - border * px
    at = (np.asarray(pose.at_px) * scale - corner) / px
    seen = replace(pose, scale_mm_per_px=1e3 * px, at_px=(float(at[0]), float(at[1])))
    rows, columns = (int(np.ptp(axis) / px) + 2 * border for axis in (y, x))
    pairs = np.column_stack([times - margin, times + margin]).ravel()
    ours = outlines_px(kinematics, seen, kinematics.law(pairs))
    piv = dpiv.piv.model_copy(update={"smoothing": dpiv.piv.smoothing is True})
    still = Still((rows, columns), times.size), np.arange(times.size)
    moved = *still, pairs, sheet, seen, ours, piv, files.folder / "virtual_piv.h5"
    virtual = virtual_experiment(*moved, **options)
    virtual = virtual.where(usable(virtual))[["u", "v", "u_std", "v_std"]]
    virtual = virtual.assign_coords(x=virtual["x"] + corner[0], y=virtual["y"] + corner[1])
    virtual = virtual.interp(x=x, y=y).assign_coords(time=times)
    virtual = virtual.assign(valid=np.isfinite(virtual["u"]))
    return data, with_finger(virtual, kinematics, pose, pressures)
