"""What is seen at each step: an image, vectors, or both in one frame of coordinates, y up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from fileio.child_process import check_walkable
from fileio.formats.plane_series import check_vectors, usable
from fileio.formats.recording import pixel_of
from piv.foreign.read import open_vectors
from piv.images.open_recording import open_recording
from piv.images.recording import Recording

LARGEST_SIDE = 1600  # px of an image that is sent to the browser; larger ones are thinned out
SHOWN = (
    "u",
    "v",
    "u_std",
    "v_std",
    "flag",
    "correlation",
    "vorticity",
    "n",
)  # of a vector that is clicked on
VECTOR_SUFFIXES = (".nc", ".csv", ".txt", ".dat")


@dataclass
class Scene:
    """Images, vectors, or both; `count` steps."""

    recording: Recording | None
    series: xr.Dataset | None

    @property
    def count(self) -> int:
        """Steps in time: of the vectors where there are some, else frames."""
        if self.series is None:
            return len(self.recording) if self.recording else 0
        return self.series.sizes.get("time", 1)

    @property
    def unit(self) -> str:
        """Of the coordinates: px or m."""
        return "px" if self.series is None else str(self.series["x"].attrs.get("units", "m"))

    def frame_number(self, step: int) -> int:
        """The frame that is shown at a step: of vectors the first of their pair."""
        if self.series is None or self.recording is None or "time" not in self.series.dims:
            return step
        time = float(self.series["time"][step])
        times = self.recording.times if self.unit != "px" else np.arange(len(self.recording))
        frame = (
            step if times is None else int(np.searchsorted(times, time + 1e-9, side="right")) - 1
        )
        return min(max(frame, 0), len(self.recording) - 1)

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
        known = self.recording.attrs
        if self.series is not None:
            known = self.series.attrs | known
        pixel = pixel_of(known)
        if pixel is None:
            raise ValueError(
                f"{self.recording.name}: its scale is not known; give vectors in px, or a "
                "recording with a scale"
            )
        origin = np.tile([known.get(f"origin_{k}_px", 0.0) for k in "xy"], 2)
        return tuple(((edges - origin) * pixel).tolist())

    def image(self, step: int) -> np.ndarray | None:
        """Grey values (uint8, row 0 at the bottom) at a step, stretched; None without images."""
        if self.recording is None:
            return None
        frame = self.recording.frame(self.frame_number(step))
        thin = max(1, int(np.ceil(max(frame.shape) / LARGEST_SIDE)))
        grey = frame[::-1][::thin, ::thin].astype(np.float32)
        low, high = np.percentile(grey, [1, 99.5])
        return np.clip((grey - low) * (255 / max(high - low, 1.0)), 0, 255).astype(np.uint8)

    def vectors(self, step: int) -> dict[str, np.ndarray]:
        """Columns x, y and what is known of each vector at a step, absent ones left out."""
        if self.series is None:
            return {"x": np.empty(0), "y": np.empty(0), "u": np.empty(0), "v": np.empty(0)}
        plane = (self.series.isel(time=step) if "time" in self.series.dims else self.series).load()
        check_vectors(plane)
        ok = usable(plane).values
        xx, yy = np.meshgrid(plane["x"].values, plane["y"].values)
        return {"x": xx[ok], "y": yy[ok]} | {
            n: plane[n].values[ok].astype(float) for n in SHOWN if n in plane
        }

    def time_text(self, step: int) -> str:
        """The instant of a step in words."""
        if self.series is not None and "time" in self.series.dims:
            time = self.series["time"]
            return f"{float(time[step]):g} {time.attrs.get('units', 's')}"
        return f"frame {self.frame_number(step)}"


def open_scene(source: str, images: str | None = None, frame_rate_hz: float | None = None) -> Scene:
    """A scene from a file of vectors or a recording, and the images behind the vectors."""
    path = Path(source)
    vectors = path.suffix.lower() in VECTOR_SUFFIXES
    if path.suffix.lower() == ".h5" and path.is_file():
        check_walkable(path)
        with h5py.File(path, "r") as file:
            vectors = file.attrs.get("format") != "recording"
    if not vectors:
        if images is not None:
            raise ValueError(f"{source}: is a recording; --images goes with a file of vectors")
        return Scene(open_recording(source, frame_rate_hz=frame_rate_hz), None)
    recording = open_recording(images, frame_rate_hz=frame_rate_hz) if images else None
    return Scene(recording, open_vectors(path))
