"""Synthetic PIV recordings: pairs from a displacement function, recordings from a plane series."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

from fileio.atomic import write_bytes
from fileio.formats.plane_series import FINGER_VARIABLES, UNITS, provenance, usable
from fileio.formats.recording import RecordingWriter
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.particle_images import (
    SLAB_HALF_WIDTH,
    add_particles,
    expose,
    in_mask,
    sheet_light,
)
from piv.synthetic.particles import Box, seed_particles
from piv.synthetic.truth import write_truth
from piv.synthetic.virtual_camera import Recorder, finger_at

__all__ = ["Camera", "Recorder", "Seeding", "render_pair", "render_recording"]

Displacement = Callable[[np.ndarray, np.ndarray], tuple[Any, ...]]
CHECKPOINT_FRAMES = (
    50  # an interrupted rendering carries the particles over at most so many frames again
)


def render_pair(
    displacement: Displacement,
    shape: tuple[int, int] = (1024, 1280),
    *,
    density_ppp: float = 0.04,
    diameter_px: float = 2.5,
    diameter_std_px: float = 0.0,
    noise: float = 0.0,
    peak: float = 0.8,
    background: float = 0.0,
    electrons_per_level: float = 0.0,
    sheet_thickness_px: float = 12.0,
    bits: int = 8,
    mask: np.ndarray | None = None,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Two pictures (row 0 at the top) of particles displaced by `displacement`, for benchmarks and tests.

    `displacement(x_px, y_px)` gives (dx, dy) or (dx, dy, dz) in px, x right, y up from the centre of the bottom row; a
    particle drawn at (x, y, z) is at (x, y, z) -/+ d/2 in the first/second picture, so the function itself is the exact
    mid-point truth. `noise`: standard deviation of read noise as a part of the grey scale (0.05 = 5 %); `background` in
    grey levels; `mask` (row 0 at the top, 1 = body) holds no particles and stays black.
    """
    rows, columns = shape
    rng = np.random.default_rng(seed)
    full = 2**bits - 1
    corners = np.meshgrid(np.linspace(0, columns - 1, 65), np.linspace(0, rows - 1, 65))
    largest = max(float(np.abs(d).max()) for d in displacement(*corners)[:2])
    margin = largest + 4 * diameter_px
    low, right, top = -0.5 - margin, columns - 0.5 + margin, rows - 0.5 + margin
    box = Box(low, right, low, top, SLAB_HALF_WIDTH * sheet_thickness_px)
    p = seed_particles(box, density_ppp / sheet_thickness_px, diameter_px, diameter_std_px, rng)
    d = np.zeros((3, p.shape[1]))
    for k, component in enumerate(displacement(p[0], p[1])):
        d[k] = component
    body = None if mask is None else np.asarray(mask).astype(bool)
    pictures = []
    for side in (-0.5, 0.5):
        x, y, z = p[:3] + side * d
        light = peak * full * sheet_light(z, sheet_thickness_px) * (p[3] / diameter_px) ** 2
        if body is not None:
            light = np.where(in_mask(body, x, rows - 1 - y), 0.0, light)
        image = np.zeros(shape, np.float32)
        add_particles(image, x, rows - 1 - y, light, p[3])
        if body is not None:
            image[body] = 0
        pictures.append(expose(image, rng, bits, background, noise * full, electrons_per_level))
    return pictures[0], pictures[1]


def render_recording(
    series: xr.Dataset,
    path: str | Path,
    camera: Camera | None = None,
    seeding: Seeding | None = None,
    *,
    seed: int = 0,
    truth: bool = True,
    quiet: bool = True,
) -> Path:
    """Render a plane series (docs/formats.md; may be lazy) to a recording `path`, with `truth` in `<stem>_truth.h5` beside.

    Frames from the first to the last instant of the series at the camera's rate, or those in pairs that it takes. The truth is a plane series at the
    middle of each frame interval: exact particle displacement over the interval, put where the middle of the
    displacement is. An interrupted rendering resumes; the result does not depend on where. Raises ValueError where the
    camera looks past the plane series.
    """
    recorder = Recorder(series, camera or Camera(), seeding or Seeding(), seed)
    path = Path(path)
    if truth:
        write_truth(recorder, path.with_name(path.stem + "_truth.h5"), quiet=quiet)
    c = recorder.camera
    attrs = recorder.attributes() | provenance(**recorder.attributes())
    attrs |= {
        k: series.attrs[k] for k in ("scene_hash", "tip_width", "source") if k in series.attrs
    }
    attrs["field_digest"] = _digest(series)
    masked = "outline" in series or not usable(series.isel(time=0)).all()
    dtype = np.uint8 if c.bits <= 8 else np.uint16
    shape, times = (c.height_px, c.width_px), recorder.time[recorder.taken]
    with RecordingWriter(path, shape, dtype, len(times), attrs, times=times, mask=masked) as writer:
        _add_finger(writer, recorder)
        state_path = path.with_name(path.name + ".particles.npz")
        missing = [i for i in range(len(times)) if i not in writer.done]
        if missing:
            first = int(recorder.taken[missing[0]])
            state = _load_state(state_path, first) if writer.resumed else None
            bar = tqdm(
                total=len(times),
                initial=len(writer.done),
                unit="frame",
                disable=quiet or None,
                desc="render",
            )
            for i, frame in enumerate(recorder.frames(first, state), missing[0]):
                if i not in writer.done:
                    writer.write(i, frame.image, frame.mask if masked else None)
                    bar.update()
                if i % CHECKPOINT_FRAMES == 0:
                    _save_state(state_path, frame.number, frame.particles)
            bar.close()
        writer.finish()
    state_path.unlink(missing_ok=True)
    return path


def _digest(series: xr.Dataset) -> str:
    """Tells one plane series from another of the same shape: its axes and three of its planes."""
    h = hashlib.sha256()
    for name in ("time", "y", "x"):
        h.update(np.ascontiguousarray(series[name].values, float).tobytes())
    n = series.sizes["time"]
    for i in (0, n // 2, n - 1):
        h.update(np.ascontiguousarray(series["u"].isel(time=i).values, float).tobytes())
        h.update(np.ascontiguousarray(series["v"].isel(time=i).values, float).tobytes())
    return h.hexdigest()[:16]


def _add_finger(writer: RecordingWriter, recorder: Recorder) -> None:
    """Pass the finger's variables on, at the instants of the frames."""
    for name in FINGER_VARIABLES:
        if name in recorder.series:
            times = recorder.time[recorder.taken]
            values = np.array([finger_at(recorder.series, name, t) for t in times])
            writer.add(name, [str(d) for d in recorder.series[name].dims], values, UNITS[name])


def _save_state(path: Path, index: int, particles: np.ndarray) -> None:
    content = io.BytesIO()  # a zip file complains once more where it cannot be closed
    np.savez(content, index=index, particles=particles)
    write_bytes(path, content.getbuffer())


def _load_state(path: Path, before: int) -> tuple[int, np.ndarray] | None:
    """Particles of the last checkpoint, where it is not later than frame `before`."""
    if not path.exists():
        return None
    with np.load(path) as stored:
        index = int(stored["index"])
        return (index, stored["particles"]) if index <= before else None
