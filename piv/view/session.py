"""What is seen at each step: an image, vectors, or both in one frame of coordinates, y up."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import xarray as xr

from piv.correlation.options import Options
from piv.files.hdf5 import open_hdf5
from piv.foreign.read import open_vectors
from piv.formats.plane_series import check_vectors, usable
from piv.formats.recording import pixel_of
from piv.images.file_names import PAIRINGS
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.images.recording import Recording
from piv.sequence.frame_sets import SequenceOptions, frame_sets
from piv.vortices.criteria import gradients, vorticity

_LARGEST_SIDE = 1600  # px of an image that is sent to the browser; larger ones are thinned out
VECTOR_SUFFIXES = (".nc", ".csv", ".txt", ".dat", ".vti", ".pvd", ".mat", ".vc7")


@dataclass
class Session:
    """Images, vectors, or both; `count` steps."""

    name: str
    recording: Recording | None
    series: xr.Dataset | None
    mask: str | None = None  # of the recording, as of `piv correlate`

    @property
    def count(self) -> int:
        """Steps in time: of the vectors where there are some, else frames."""
        if self.series is None:
            return len(self.recording) if self.recording else 0
        return self.series.sizes.get("time", 1)

    @property
    def unit(self) -> str:
        """Unit of the coordinates: px or m."""
        return "px" if self.series is None else str(self.series["x"].attrs.get("units", "m"))

    @cached_property
    def made(self) -> tuple[Options, SequenceOptions]:
        """The settings that the vectors were made with; defaults where they do not state them."""
        stated = {} if self.series is None else json.loads(self.series.attrs.get("settings", "{}"))
        if isinstance(steps := stated.get("preprocess"), list):
            stated["preprocess"] = ",".join(steps) or "none"
        own, of_sets = (
            {f.name: stated[f.name] for f in fields(kind) if f.name in stated}
            for kind in (Options, SequenceOptions)
        )
        options, sequence = Options(**own), SequenceOptions(**of_sets)
        if sequence.pairing is None and self.recording is not None:
            sequence = replace(sequence, pairing=self.recording.pairing or PAIRINGS[0])
        return options, sequence

    @cached_property
    def sets(self) -> list[tuple[int, ...]]:
        """Frames of every field, as `piv correlate` takes them."""
        assert self.recording is not None
        return frame_sets(len(self.recording), self.made[1])

    def frames_of(self, step: int) -> tuple[int, int]:
        """The two frames of the pair at a step, or in the middle of its multi-frame set."""
        assert self.recording is not None
        if len(self.recording) < 2:
            return 0, 0
        if self.series is None and self.made[1].pairing == PAIRINGS[1]:
            step //= 2  # steps are frames
        frames = self.sets[min(step, len(self.sets) - 1)]
        middle = (len(frames) - 1) // 2
        return frames[middle], frames[middle + 1]

    def frame_number(self, step: int) -> int:
        """The frame that masks of a step belong to."""
        return step if self.series is None or self.recording is None else self.frames_of(step)[0]

    def extent(self) -> tuple[float, float, float, float]:
        """left, bottom, right, top: outer edges of pixels, or half a step beyond the vectors."""
        if self.recording is None:
            assert self.series is not None
            x, y = self.series["x"].values, self.series["y"].values
            half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
            return x[0] - half_x, y[0] - half_y, x[-1] + half_x, y[-1] + half_y
        rows, columns = self.recording.shape
        edges = np.array([-0.5, -0.5, columns - 0.5, rows - 0.5])
        if self.unit == "px":
            return tuple(edges.tolist())
        pixel, origin = self.scale()
        return tuple(((edges - np.tile(origin, 2)) * pixel).tolist())

    def scale(self) -> tuple[float, list[float]]:
        """Size of a pixel (m) and the origin (px); ValueError where the scale is not known."""
        known = (self.series.attrs if self.series is not None else {}) | (
            self.recording.attrs if self.recording is not None else {}
        )
        pixel = pixel_of(known)
        if pixel is None:
            raise ValueError(
                f"{self.name}: its scale is not known; give vectors in px, or a recording with a "
                "scale"
            )
        return pixel, [float(known.get(f"origin_{k}_px", 0.0)) for k in "xy"]

    def image(self, step: int, second: bool = False, low: float = 1.0, high: float = 99.5) -> bytes:
        """A frame of the pair as PNG, stretched between two percentages of its grey values."""
        if self.recording is None:
            raise ValueError(f"{self.name}: no images; give --images")
        frames = self.frames_of(step)
        shown = step if self.series is None else frames[0]
        frame = self.recording.frame(frames[1] if second else shown)
        thin = max(1, int(np.ceil(max(frame.shape) / _LARGEST_SIDE)))
        grey = frame[::thin, ::thin].astype(np.float32)
        dark, bright = np.percentile(grey, [low, high])
        shades = np.clip((grey - dark) * (255 / max(bright - dark, 1.0)), 0, 255)
        return cv2.imencode(".png", shades.astype(np.uint8))[1].tobytes()

    def plane(self, step: int) -> xr.Dataset:
        """The vectors of a step, loaded and checked; with the vorticity where it is not there."""
        if self.series is None:
            raise ValueError(f"{self.name}: holds images; vectors come of piv correlate")
        series = self.series
        plane = (series.isel(time=step) if "time" in series.dims else series).load()
        check_vectors(plane)
        return with_vorticity(plane)

    def time_text(self, step: int) -> str:
        """The instant of a step in words."""
        if self.series is not None and "time" in self.series.dims:
            time = self.series["time"]
            return f"{float(time[step]):.6g} {time.attrs.get('units', 's')}"
        return f"frame {self.frame_number(step)}"


def with_vorticity(plane: xr.Dataset) -> xr.Dataset:
    """The plane with its vorticity, as `piv derive` has it."""
    if "vorticity" in plane:
        return plane
    dx, dy = (float(plane[n][1] - plane[n][0]) for n in ("x", "y"))
    u, v = (plane[n].transpose("y", "x").values for n in ("u", "v"))
    found = vorticity(gradients(u, v, usable(plane).transpose("y", "x").values, dx, dy))
    unit = "1/frame" if plane["x"].attrs.get("units") == "px" else "1/s"
    return plane.assign(vorticity=(("y", "x"), found, {"units": unit}))


def open_session(
    source: Sequence[str], images: Sequence[str] | None = None, mask: str | None = None
) -> Session:
    """Open vectors or a recording, the images behind the vectors, and their mask."""
    session = _open_session(source, images)
    if mask is None:
        return session
    if session.recording is None:
        raise ValueError(f"{mask}: a mask is of images; give --images")
    return replace(session, recording=part_of_recording(session.recording, mask), mask=mask)


def _open_session(source: Sequence[str], images: Sequence[str] | None) -> Session:
    path = Path(source[0])
    vectors = path.suffix.lower() in VECTOR_SUFFIXES
    if path.suffix.lower() == ".h5" and path.is_file():
        with open_hdf5(path) as file:
            vectors = file.attrs.get("format") != "recording"
    if not vectors:
        if images is not None:
            raise ValueError(f"{path}: is a recording; --images goes with a file of vectors")
        return Session(str(path), open_recording(source), None)
    if len(source) > 1:
        raise ValueError(f"{source[1]}: give one file of vectors, and images with --images")
    session = Session(str(path), open_recording(images) if images else None, open_vectors(path))
    if session.recording is not None and len(session.recording) > 1:
        pairs = len(session.sets)
        if session.count > pairs:
            raise ValueError(
                f"{path}: {session.count} fields, but the images give {pairs}; give --images all "
                "that the fields were made of, in the same order"
            )
    return session
