"""The same PIV of a laboratory's pictures and of these pictures moved by the simulation's flow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr
from scipy.ndimage import distance_transform_edt

from fileio.formats.plane_series import read_plane
from piv.correlation.options import Options
from piv.images.recording import Recording
from piv.sequence.sequence import SequenceOptions, correlate_recording
from piv.synthetic.plane_spline import PlaneField
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.pictures import MaskedRecording
from postprocess.lab.data.pose import Pose, camera_series

DENSITY, DIAMETER = 0.05, 2.5  # particles in a pixel, and their diameter at 1/e² (px)


def evaluate(
    recording: Recording,
    indices: np.ndarray,
    times: np.ndarray,
    outlines: list[np.ndarray],
    pose: Pose,
    piv: Evaluation,
    output: Path,
    *,
    threads: int = 1,
    quiet: bool = True,
) -> xr.Dataset:
    """PIV of some frames (at `times`, s) masked by the finger's outlines (px), camera frame."""
    assert piv.pairing is not None  # the schema's own check
    frames = MaskedRecording(recording, indices, times, outlines, pose)
    options = Options(
        window=piv.window,
        spacing=piv.spacing,
        preset=piv.preset,
        smoothing=piv.smoothing is not False,
    )
    how: dict[str, Any] = {"preprocess": piv.preprocess, "threads": threads}
    sequence = SequenceOptions(piv.pairing, 0, piv.every, **how)
    output.with_name(output.name + ".part").unlink(missing_ok=True)  # of other outlines, perhaps
    correlate_recording(frames, output, options, sequence, quiet=quiet)
    with read_plane(output) as plane:
        return plane.load()


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


class MovedRecording(Recording):
    """Pairs of each of the pictures `first` and the same moved by a flow, at `times` (2 × pair,) s.

    `sheet`: the flow in the tank frame; the water beside the finger moves with the nearest.
    """

    def __init__(
        self,
        source: Recording,
        first: np.ndarray,
        times: np.ndarray,
        sheet: xr.Dataset,
        pose: Pose,
    ) -> None:
        super().__init__(f"{source.name}, moved", 2 * len(first))
        self._source, self._first, self._times = source, first, times
        self._sheet, self._field, self._pose = sheet, PlaneField(sheet), pose

    def _read(self, i: int) -> np.ndarray:
        image = self._source.frame(int(self._first[i // 2]))
        if i % 2 == 0:
            return image
        (before, after), px = self._times[i - 1 : i + 1], self._pose.pixel
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


def virtual_experiment(
    recording: Recording,
    first: np.ndarray,
    times: np.ndarray,
    sheet: xr.Dataset,
    pose: Pose,
    outlines: list[np.ndarray],
    piv: Evaluation,
    output: Path,
    **speed: Any,
) -> xr.Dataset:
    """PIV of the pictures `first`, moved by the flow of a sheet, camera frame.

    `times` (2 × pair,) s; `outlines` (px) of each picture; `speed`: threads and quiet of
    `evaluate`.
    """
    moved = MovedRecording(recording, first, times, sheet, pose)
    pairs = piv.model_copy(update={"pairing": "1-2,3-4", "every": 1})
    return evaluate(moved, np.arange(times.size), times, outlines, pose, pairs, output, **speed)
