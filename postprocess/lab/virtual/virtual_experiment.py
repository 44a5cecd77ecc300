"""The same PIV of a laboratory's pictures and of virtual pictures of the simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.formats.plane_series import read_plane
from fileio.formats.recording import RecordingWriter
from piv.correlation.options import Options
from piv.images.open_recording import open_recording
from piv.images.recording import Recording
from piv.sequence.sequence import SequenceOptions, correlate_recording
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.virtual_camera import Recorder
from postprocess.lab.data.dpiv_toml import Evaluation
from postprocess.lab.data.pictures import MaskedRecording
from postprocess.lab.data.pose import Pose, camera_series

RENDER_MARGIN = 0.004  # m beyond the picture, from where particles enter it


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


def virtual_recording(
    sheet: xr.Dataset,
    pose: Pose,
    camera: Camera,
    seeding: Seeding,
    times: np.ndarray,
    path: Path,
    *,
    paired: bool = False,
    seed: int = 1,
) -> Path:
    """Pictures of the simulation through the laboratory's camera at `times` (s of the simulation).

    `paired`: each pair of frames 1-2, 3-4 … is seeded anew; else frames are evenly spaced.
    """
    step = float(sheet["x"][1] - sheet["x"][0])
    x, y = (
        np.arange(-RENDER_MARGIN, size * pose.pixel + RENDER_MARGIN + step, step)
        for size in (camera.width_px, camera.height_px)
    )
    seen = replace(camera, scale_mm_per_px=pose.scale_mm_per_px, origin_px=(0.0, 0.0))
    dtype = np.uint8 if camera.bits <= 8 else np.uint16
    attrs = {"bits": camera.bits, "seed": seed, "frame_rate_hz": camera.frame_rate_hz}
    parts = times.reshape(-1, 2) if paired else [times]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.with_name(path.name + ".part").unlink(missing_ok=True)  # of another sheet, perhaps
    shape = camera.height_px, camera.width_px
    with RecordingWriter(path, shape, dtype, times.size, attrs, times=times) as writer:
        number = 0
        for k, part in enumerate(parts):
            series = camera_series(sheet, pose, x, y, part)
            taken = replace(seen, frame_rate_hz=float(1 / np.mean(np.diff(part))))
            for frame in Recorder(series, taken, seeding, seed + 7919 * k).frames():
                writer.write(number, frame.image)
                number += 1
        writer.finish()
    return path


def virtual_experiment(
    sheet: xr.Dataset,
    pose: Pose,
    camera: Camera,
    seeding: Seeding,
    times: np.ndarray,
    outlines: list[np.ndarray],
    piv: Evaluation,
    folder: Path,
    *,
    seed: int = 1,
    **speed: Any,
) -> xr.Dataset:
    """PIV of the simulation with the laboratory's camera, seeding and settings, camera frame.

    `speed`: threads and quiet of `evaluate`.
    """
    path, paired = folder / "virtual_recording.h5", piv.pairing == "1-2,3-4"
    virtual_recording(sheet, pose, camera, seeding, times, path, paired=paired, seed=seed)
    with open_recording(str(path)) as recording:
        every, output = np.arange(times.size), folder / "virtual_piv.h5"
        return evaluate(recording, every, times, outlines, pose, piv, output, **speed)
