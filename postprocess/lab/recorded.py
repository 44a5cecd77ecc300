"""A laboratory's pictures, upright, rectified and with times, and its vectors in metres, y up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from pipeline.formats.kinematics import Kinematics
from piv.files.errors import StageError
from piv.formats.plane_series import MASKED, read_plane, usable
from piv.images.calibration import Calibration, calibrate_plane, load_calibration, rectify_image
from piv.images.open_recording import open_recording
from piv.images.recording import Recording
from postprocess.lab.dpiv_toml import NAME, Dpiv, Start
from postprocess.lab.pose import Pose
from postprocess.lab.register import Known, Registration


class LabRecording(Recording):
    """The pictures of a dpiv.toml, mirrored and rectified as it states."""

    times: np.ndarray

    def __init__(self, dpiv: Dpiv) -> None:
        try:
            self._source = open_recording(dpiv.sources(), colour=dpiv.colour)
        except ValueError as error:  # PIV knows no StageError
            raise StageError(str(error)) from error
        stated, paired = self._source.attrs.get("frame_rate_hz"), dpiv.piv.interval_s is not None
        if stated and not paired and abs(stated * dpiv.interval - 1) > 0.01:
            raise StageError(
                f"{dpiv.folder / NAME}: frame_rate_hz is {dpiv.frame_rate_hz:g}, but"
                f" {self._source.name} states {stated:g}; correct the one that is wrong"
            )
        super().__init__(self._source.name, len(self._source))
        frames = np.arange(len(self._source))
        self.times = frames / dpiv.frame_rate_hz
        if paired:
            self.times = frames // 2 / dpiv.frame_rate_hz + frames % 2 * dpiv.interval
        self._mirror, self._down = dpiv.axes.x == "left", dpiv.axes.y == "down"
        name = dpiv.scale.calibration
        self.calibration: Calibration | None = None
        if name:
            self.calibration = load_calibration(dpiv.folder / name)

    def _read(self, i: int) -> np.ndarray:
        image = self._source.frame(i)
        if self.calibration is not None and self.calibration.lens is not None:
            image = rectify_image(image, self.calibration)
        return np.ascontiguousarray(image[:, ::-1]) if self._mirror else image

    def turned(self, at: tuple[float, float]) -> tuple[float, float]:
        """A place (px) of the laboratory's axes in the upright picture, or the other way."""
        (rows, columns), (x, y) = self.shape, at
        return (columns - 1 - x if self._mirror else x, rows - 1 - y if self._down else y)

    def close(self) -> None:
        """Close the files."""
        self._source.close()


def known_of(dpiv: Dpiv, recording: LabRecording, kinematics: Kinematics) -> Known:
    """What is stated of the set-up of pictures."""
    light, scale = dpiv.light_from_deg, (recording.calibration or dpiv.scale).scale_mm_per_px
    assert dpiv.axes.root_px is not None
    assert scale is not None
    at, turn = recording.turned(dpiv.axes.root_px), float(np.radians(dpiv.axes.turn_deg))
    return Known(
        Pose(scale, turn, kinematics.root, at),
        dpiv.scale.std_percent / 100,
        turn_std=float(np.radians(dpiv.axes.turn_std_deg)),
        delay=(-dpiv.start.at_s, dpiv.start.std_s) if isinstance(dpiv.start, Start) else None,
        paired=dpiv.piv.pairing == "1-2,3-4",
        hidden=dpiv.root_hidden_mm * 1e-3,
        light_from=None if light is None else float(np.radians(light)),
        length_std=(dpiv.finger_length_std_mm or 0.0) * 1e-3 / kinematics.length,
        place=recording.turned,
    )


def recording_quality(
    dpiv: Dpiv, registration: Registration, plane: xr.Dataset | None
) -> dict[str, float]:
    """How good a recording is: pictures that were fitted, and their particles per pixel; fields,
    share of the vectors that count, and displacement (px) of the fastest water, of its PIV.
    """
    out = {"pictures": float(registration.times.size), "density_ppp": registration.density}
    if plane is not None:
        ok = usable(plane).values
        water = plane["flag"].values != MASKED if "flag" in plane else True
        speed = np.hypot(plane["u"].values, plane["v"].values)[ok]
        px = registration.pose.pixel * (dpiv.scale.pixel if dpiv.kind == "vectors" else 1.0)
        out["fields"] = float(plane.sizes["time"])
        out["valid"] = float(ok.sum() / np.sum(np.broadcast_to(water, ok.shape)))
        out["displacement_px"] = float(np.quantile(speed, 0.999) * dpiv.interval / px)
    return out


def lab_vectors(dpiv: Dpiv) -> xr.Dataset:
    """A plane series in stated metres, y up, times from the first instant."""
    sources = dpiv.sources()
    path = Path(sources if isinstance(sources, str) else ", ".join(sources))
    plane = read_plane(path) if path.suffix == ".h5" and path.is_file() else None
    if plane is None:
        why = "is no series of vectors" if path.exists() else "is missing (vectors are one file)"
        raise StageError(
            f"{path}: {why}; make one of your files by piv convert FILES -o vectors.h5, and state"
            f' files = "vectors.h5" in {NAME}'
        )
    if plane["x"].attrs.get("units") == "px":  # as piv correlate writes it without a calibration
        rate = None if plane["time"].attrs.get("units") == "s" else dpiv.frame_rate_hz
        plane = calibrate_plane(plane, Calibration(dpiv.scale.pixel * 1e3), dpiv.interval, rate)
    if "time" not in plane.dims:
        raise StageError(f"{path}: one instant is no motion; give a series")
    plane = plane.load()
    rate = 1 / float(np.mean(np.diff(plane["time"].values)))
    if abs(rate / dpiv.frame_rate_hz - 1) > 0.01:
        raise StageError(
            f"{dpiv.folder / NAME}: frame_rate_hz is {dpiv.frame_rate_hz:g}, but {path} holds"
            f" {rate:.4g} fields per second; correct the one that is wrong"
        )
    if dpiv.axes.x == "left":
        mirrored = -plane["u"].values[..., ::-1]
        plane = plane.isel(x=slice(None, None, -1)).assign_coords(x=-plane["x"].values[::-1])
        plane = plane.assign(u=(plane["u"].dims, mirrored))
    if "u_std" not in plane:
        if dpiv.vectors is None:
            raise StageError(
                f"{path}: the vectors carry no uncertainty; give vectors.std_px in dpiv.toml, the"
                " standard uncertainty of a displacement in px"
            )
        one = dpiv.vectors.std_px * dpiv.scale.pixel / dpiv.interval
        std = np.full(plane["u"].shape, one / dpiv.vectors.repeats**0.5)
        plane = plane.assign(u_std=(plane["u"].dims, std), v_std=(plane["u"].dims, std))
    return plane.assign_coords(time=plane["time"].values - float(plane["time"][0]))
