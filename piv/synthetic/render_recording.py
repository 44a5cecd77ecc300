"""Synthetic PIV recordings of a plane series."""

import hashlib
import io
from pathlib import Path

import numpy as np
import xarray as xr
from numpy import ndarray
from tqdm import tqdm

from piv.files.atomic import write_bytes
from piv.formats.plane_series import FINGER_VARIABLES, UNITS, provenance, usable
from piv.formats.recording import RecordingWriter
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.truth import write_truth
from piv.synthetic.virtual_camera import Recorder, finger_at

# an interrupted rendering carries the particles over at most so many frames again
CHECKPOINT_FRAMES = 50


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
    """Render a plane series to a recording `path`, with its truth in `<stem>_truth.h5` beside.

    Frames from the first to the last instant of the series at the camera's rate, or those in pairs
    that it takes. The truth is a plane series at the middle of each frame interval: exact particle
    displacement over the interval, put where the middle of the displacement is. An interrupted
    rendering resumes; the result does not depend on where. Raises ValueError where the camera looks
    past the plane series.
    """
    recorder = Recorder(series, camera or Camera(), seeding or Seeding(), seed)
    path = Path(path)
    if truth:
        write_truth(recorder, path.with_name(path.stem + "_truth.h5"), quiet=quiet)
    c = recorder.camera
    attrs = recorder.attributes() | provenance(**recorder.attributes())
    attrs |= {k: series.attrs[k] for k in ("tip_width", "source") if k in series.attrs}
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


def _save_state(path: Path, index: int, particles: ndarray) -> None:
    content = io.BytesIO()  # a zip file complains once more where it cannot be closed
    np.savez(content, index=index, particles=particles)
    write_bytes(path, content.getbuffer())


def _load_state(path: Path, before: int) -> tuple[int, ndarray] | None:
    """Particles of the last checkpoint, where it is not later than frame `before`."""
    if not path.exists():
        return None
    with np.load(path) as stored:
        index = int(stored["index"])
        return (index, stored["particles"]) if index <= before else None
