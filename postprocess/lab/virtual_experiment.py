"""Both sides of a comparison: the recording's flow, and the simulation's seen in the same way.

A laboratory's pictures are moved by the simulation's flow, and both are evaluated by the same PIV.
A recorded stroke of another duration is seen at equal phase: the flow is the same there, at a speed
that goes with 1/duration, and the two fingers hide the same water. No run tells that as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr
from scipy.ndimage import distance_transform_edt

from pipeline.formats.kinematics import Kinematics
from piv.correlation.options import Options
from piv.files.errors import StageError
from piv.formats.plane_series import AXES, read_plane, usable, write_plane
from piv.images.masks import polygons_mask
from piv.images.recording import Recording
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording
from piv.synthetic.plane_spline import PlaneField
from piv.vortices.find import VortexSettings
from postprocess.lab.dpiv_toml import Dpiv, Evaluation
from postprocess.lab.fit_outline import law_pressure
from postprocess.lab.pose import Pose, camera_series, in_camera
from postprocess.lab.recorded import LabRecording, lab_vectors
from postprocess.lab.register import Registration

# Of the tip's width: smoothing length, of which the circle of the circulation has three. Wider than
# where a vortex is found in one flow, since meshes and windows then change less of it.
WIDE = 2 / 9
GROW_PX = 2  # of the mask beyond the outline: particle images reach over the body's edge
KEPT = 64  # moved pictures
DENSITY, DIAMETER = 0.05, 2.5  # particles in a pixel, and their diameter at 1/e² (px)


@dataclass(frozen=True)
class Sides:
    """Plane series in the camera frame with the same axes and times, of equally long strokes."""

    data: xr.Dataset
    virtual: xr.Dataset
    direct: xr.Dataset
    vortices: VortexSettings
    window_m: float  # interrogation window


def both_sides(
    folder: Path,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    vortices: dict[str, Any],
    **speed: Any,
) -> Sides:
    """Evaluate both sides alike; writes data.h5, virtual.h5 and direct.h5 to `folder`.

    `sheet`: the simulation's over the registration's view. `vortices`: the scene's settings.
    `speed`: threads and quiet of `evaluate`.
    """
    sheet = at_duration(sheet, registration.law.values[2])
    make = _of_pictures if dpiv.kind == "pictures" else _of_vectors
    data, virtual = make(folder, dpiv, kinematics, registration, sheet, speed)
    x, y, times = (data[name].values for name in ("x", "y", "time"))
    direct = camera_series(sheet, registration.pose, x, y, times)
    for name, source, plane in (
        ("data", "lab", data),
        ("virtual", "piv", virtual),
        ("direct", "cfd", direct),
    ):
        write_plane(plane, folder / f"{name}.h5", source=source)

    px = registration.pose.pixel  # m; of vectors the picture's unit is the stated metre
    window = dpiv.piv.window * (px * dpiv.scale.pixel if dpiv.kind == "vectors" else px)
    # one scale for all sides, although their windows differ
    scale = vortices["scale"] or max(WIDE * kinematics.tip_width, 0.5 * window)
    how = VortexSettings(**vortices | {"scale": scale, "correlation_length": window})
    return Sides(data, virtual, direct, how, window)


def at_duration(sheet: xr.Dataset, stretch: float) -> xr.Dataset:
    """The flow of a stroke `stretch` times as long."""
    rates = [n for n in ("u", "v", "w", "dwdz", "outline_velocity") if n in sheet]
    slower = sheet.assign({n: sheet[n].copy(data=sheet[n].values / stretch) for n in rates})
    time = sheet["time"].values * stretch
    return slower.assign_coords(time=("time", time, sheet["time"].attrs))


def _of_pictures(
    folder: Path,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    speed: dict[str, Any],
) -> tuple[xr.Dataset, xr.Dataset]:
    law, pose = registration.law, registration.pose
    span = float(sheet["time"][0]), float(sheet["time"][-1])

    def recorded(times: np.ndarray) -> np.ndarray:
        return law_pressure(kinematics, times + law.delay, law.values)

    def simulated(times: np.ndarray) -> np.ndarray:
        return np.asarray(kinematics.law(np.clip(times, *span) / law.values[2]))

    with LabRecording(dpiv) as recording:
        at = recording.times - law.delay
        ok = (at >= span[0] - 1e-9) & (at <= span[1] + 1e-9)
        if dpiv.piv.pairing == "1-2,3-4":  # whole pairs only
            ok = ok[: ok.size // 2 * 2]
            ok = np.repeat(ok[::2] & ok[1::2], 2)
        index = _enough(ok, at, span)
        times = np.clip(at[index], *span)
        theirs = outlines_px(kinematics, pose, recorded(times))
        frames = MaskedRecording(recording, index, times, theirs, pose)
        data = evaluate(frames, dpiv.piv, folder / "data_piv.h5", **speed)
        middle = data["time"].values
        data = with_finger(data, kinematics, pose, recorded(middle))

        first = np.searchsorted(times, middle) - 1
        pairs = (middle[:, None] + dpiv.interval * np.array([-0.5, 0.5])).ravel()
        # the recording's finger hides particles from the simulation's flow
        ours = outlines_px(kinematics, pose, simulated(pairs))
        both = [
            np.concatenate([one, theirs[k]])
            for one, k in zip(ours, np.repeat(first, 2), strict=True)
        ]
        moved = MovedRecording(recording, index[first], pairs, both, pose, sheet=sheet)
        virtual = evaluate(moved, dpiv.piv, folder / "virtual_piv.h5", **speed)
    return data, with_finger(virtual, kinematics, pose, simulated(middle))


def _of_vectors(
    folder: Path,
    dpiv: Dpiv,
    kinematics: Kinematics,
    registration: Registration,
    sheet: xr.Dataset,
    speed: dict[str, Any],
) -> tuple[xr.Dataset, xr.Dataset]:
    pose, plane = registration.pose, lab_vectors(dpiv)
    times = plane["time"].values - registration.law.delay
    span = float(sheet["time"][0]), float(sheet["time"][-1])
    margin, scale = 0.5 * dpiv.interval, pose.pixel
    keep = _enough((times >= span[0] + margin) & (times <= span[1] - margin), times, span)
    plane, times = plane.isel(time=keep), times[keep]
    # the vectors' metres are the stated ones: the pose holds what is known of the true scale
    plane = plane.assign_coords(x=plane["x"] * scale, y=plane["y"] * scale, time=times)
    velocities = (n for n in ("u", "v", "u_std", "v_std") if n in plane)
    plane = plane.assign({n: plane[n] * scale for n in velocities})
    pressures = kinematics.law(times)

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
    still = Still((rows, columns), times.size)
    moved = MovedRecording(still, np.arange(times.size), pairs, ours, seen, sheet=sheet)
    virtual = evaluate(moved, piv, folder / "virtual_piv.h5", **speed)
    virtual = virtual.where(usable(virtual))[["u", "v", "u_std", "v_std"]]
    virtual = virtual.assign_coords(x=virtual["x"] + corner[0], y=virtual["y"] + corner[1])
    virtual = virtual.interp(x=x, y=y).assign_coords(time=times)
    virtual = virtual.assign(valid=np.isfinite(virtual["u"]).astype(np.uint8))
    fingers = kinematics, pose, pressures
    return with_finger(plane, *fingers), with_finger(virtual, *fingers)


def _enough(ok: np.ndarray, at: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Indices of the instants that are `ok`; StageError where there are fewer than four."""
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
    """The vectors of a camera-frame series with the finger's shape at each pressure (Pa)."""
    finger = {
        name: (
            AXES[name],
            in_camera(name, np.array([kinematics.fingers(name, p) for p in pressures]), pose),
        )
        for name in kinematics.splines
    }
    vectors = plane[[name for name in plane.data_vars if plane[name].dims == AXES["u"]]]
    return vectors.assign(finger).assign_attrs(tip_width=kinematics.tip_width)


def outlines_px(kinematics: Kinematics, pose: Pose, pressures: np.ndarray) -> list[np.ndarray]:
    """The outlines (finger, point, 2) in the picture at pressures (Pa)."""
    return [pose.to_px(kinematics.fingers("outline", p)) for p in pressures]


def evaluate(
    frames: MaskedRecording, piv: Evaluation, output: Path, *, threads: int = 1, quiet: bool = True
) -> xr.Dataset:
    """PIV of masked frames, camera frame; a moved recording is of pairs, all of which count."""
    options = Options(
        window=piv.window,
        spacing=piv.spacing,
        preset=piv.preset,
        smoothing=piv.smoothing is not False,
    )
    moved = isinstance(frames, MovedRecording)  # no camera repeats its pictures
    pairing, every = ("1-2,3-4", 1) if moved or not piv.pairing else (piv.pairing, piv.every)
    sequence = SequenceOptions(
        pairing, 0, every, keep_doubles=moved, preprocess=piv.preprocess, threads=threads
    )
    output.with_name(output.name + ".part").unlink(missing_ok=True)  # of other outlines, perhaps
    correlate_recording(frames, output, options, sequence, quiet=quiet)
    with read_plane(output) as plane:
        return plane.load()


class MaskedRecording(Recording):
    """Frames `indices` of a recording at `times` (s), masked by outlines (body, point, 2) px."""

    def __init__(
        self,
        source: Recording,
        indices: np.ndarray,
        times: np.ndarray,
        outlines: list[np.ndarray],
        pose: Pose,
    ) -> None:
        super().__init__(source.name, len(indices))
        self._source, self._indices, self._outlines = source, indices, outlines
        self.times = self._clock = np.asarray(times, float)
        self._pose = pose
        self.attrs = {
            "scale_mm_per_px": pose.scale_mm_per_px,
            "origin_x_px": 0.0,
            "origin_y_px": 0.0,
        }

    def _read(self, i: int) -> np.ndarray:
        return self._source.frame(int(self._indices[i]))

    def mask(self, i: int) -> np.ndarray:
        """The finger of frame `i`, a little grown."""
        mask = polygons_mask(list(self._outlines[i]), self.shape).astype(np.uint8)
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * GROW_PX + 1,) * 2)
        return cv2.dilate(mask, around).astype(bool)


class MovedRecording(MaskedRecording):
    """Pairs of each of the pictures `first` and the same moved by a flow, at `times` (2 × pair,) s.

    `sheet`: the flow in the tank frame; the water beside the finger moves with the nearest.
    """

    def __init__(self, source: Recording, first: np.ndarray, *more: Any, sheet: xr.Dataset) -> None:
        super().__init__(source, np.repeat(first, 2), *more)
        self._sheet, self._field = sheet, PlaneField(sheet)
        self._kept = lru_cache(KEPT)(self._moved)  # PIV looks at each several times

    def _read(self, i: int) -> np.ndarray:
        return self._kept(i) if i % 2 else super()._read(i)

    def _moved(self, i: int) -> np.ndarray:
        """The second picture of a pair."""
        image = super()._read(i)
        (before, after), px = self._clock[i - 1 : i + 1], self._pose.pixel
        step = float(self._sheet["x"][1] - self._sheet["x"][0])
        x, y = (np.arange(0.0, n * px + step, step) for n in image.shape[::-1])
        middle = np.array([(before + after) / 2])
        flow = camera_series(self._sheet, self._pose, x, y, middle, self._field).isel(time=0)
        unknown = np.isnan(flow["u"].values)
        j, i_ = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        shift = [flow[n].values[j, i_] * (after - before) / px for n in ("u", "v")]
        column, row = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in image.shape[::-1]))
        up = image.shape[0] - 1 - row

        def moved(column: np.ndarray, up: np.ndarray) -> list[Any]:
            x, y = ((c * px / step).astype(np.float32) for c in (column, up))
            return [cv2.remap(s.astype(np.float32), x, y, cv2.INTER_CUBIC) for s in shift]

        u, v = moved(column, up)
        u, v = moved(column - u / 2, up - v / 2)  # half-way, as PIV has it
        from_ = (column - u).astype(np.float32), (row + v).astype(np.float32)
        return cv2.remap(image, *from_, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)


class Still(Recording):
    """Pictures (rows, columns) of usual seeding, where a laboratory gives none with its vectors."""

    def __init__(self, shape: tuple[int, int], count: int) -> None:
        super().__init__("still", count)
        self._size = shape

    def _read(self, i: int) -> np.ndarray:
        rng = np.random.default_rng(i)
        spots = np.where(rng.random(self._size) < DENSITY, rng.uniform(0, 1, self._size), 0.0)
        light = cv2.GaussianBlur(spots, (0, 0), DIAMETER / 4) * (np.pi * DIAMETER**2 / 8)
        return np.clip(8 + 170 * light + rng.normal(0, 2, self._size), 0, 255).astype(np.uint8)
