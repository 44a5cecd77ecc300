"""The tank frame in a camera's picture: a similarity, and plane series seen through it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
import xarray as xr

from fileio.errors import StageError
from fileio.formats.plane_series import make_plane
from piv.synthetic.plane_spline import PlaneField
from piv.synthetic.virtual_camera import finger_at

STEP = 0.01  # m


@dataclass(frozen=True)
class Pose:
    """Where the tank frame (m) lies in a picture.

    picture = at_px + R(angle) (tank - anchor) / pixel; px, x right and y up from the
    centre of the bottom left pixel; angle in rad, counter-clockwise. The picture of vectors in
    metres is in metres: `pixel` is then close to 1.
    """

    scale_mm_per_px: float
    angle: float
    anchor: tuple[float, float]
    at_px: tuple[float, float]

    @property
    def pixel(self) -> float:
        """Size of a pixel (or of the picture's metre) in the sheet, m."""
        return self.scale_mm_per_px * 1e-3

    def scaled(self, factor: float) -> Pose:
        """The pose with another scale."""
        return replace(self, scale_mm_per_px=self.scale_mm_per_px * factor)

    @property
    def rotation(self) -> np.ndarray:
        """R(angle), (2, 2)."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([[c, -s], [s, c]])

    def to_px(self, points: np.ndarray) -> np.ndarray:
        """Positions (…, 2) of the tank frame in the picture."""
        arm = np.asarray(points) - self.anchor
        return arm @ self.rotation.T / self.pixel + self.at_px

    def to_tank(self, points_px: np.ndarray) -> np.ndarray:
        """Positions (…, 2) of the picture in the tank frame; inverse of `to_px`."""
        arm = np.asarray(points_px) - self.at_px
        return arm @ self.rotation * self.pixel + self.anchor

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Positions (…, 2) in the camera frame: the picture's axes, in true metres."""
        return self.to_px(points) * self.pixel

    def from_camera(self, points: np.ndarray) -> np.ndarray:
        """Positions (…, 2) of the camera frame in the tank frame."""
        return self.to_tank(np.asarray(points) / self.pixel)

    def view(
        self, first: tuple[float, float], last: tuple[float, float], margin: float
    ) -> tuple[float, float, float, float]:
        """x0, x1, y0, y1 (m, tank) around two corners of the picture (px) and a margin (m).

        In steps of `STEP`, so that recordings of one set-up share it.
        """
        (left, bottom), (right, top) = first, last
        around = [[left, bottom], [right, bottom], [right, top], [left, top]]
        corners = self.to_tank(np.array(around, float))
        low = STEP * np.floor((corners.min(axis=0) - margin) / STEP)
        high = STEP * np.ceil((corners.max(axis=0) + margin) / STEP)
        x0, y0, x1, y1 = (round(float(v), 3) for v in (*low, *high))
        return x0, x1, y0, y1


def camera_series(
    series: xr.Dataset,
    pose: Pose,
    x: np.ndarray,
    y: np.ndarray,
    times: np.ndarray,
    field: PlaneField | None = None,
) -> xr.Dataset:
    """A tank-frame series at `times` (s) on axes `x`, `y` (m) of the camera frame, in float32.

    Cubic in space and time; absent inside the finger and outside the series. The finger's
    variables are turned as well. `field`: of the series, where many calls share it. ValueError
    where a time lies outside the series.
    """
    field = field or PlaneField(series)
    first, last = field.time[[0, -1]]
    if np.min(times) < first - 1e-9 or np.max(times) > last + 1e-9:
        raise StageError(
            f"instants {np.min(times):.4f}…{np.max(times):.4f} s lie outside the series"
            f" {first:.4f}…{last:.4f} s"
        )
    gx, gy = np.meshgrid(x, y)
    at = pose.from_camera(np.stack([gx, gy], axis=-1))
    inside = (at[..., 0] >= field.x[0]) & (at[..., 0] <= field.x[-1])
    inside &= (at[..., 1] >= field.y[0]) & (at[..., 1] <= field.y[-1])
    planes = []
    for time in times:
        values = field.sample(field.at(float(time)), at[..., 0], at[..., 1])
        u, v, _, dwdz = values.reshape(4, *gx.shape)
        finger = _camera_finger(series, pose, float(time))
        valid = inside.copy()
        for outline in finger.get("outline", ()):
            valid &= ~shapely.contains_xy(shapely.Polygon(outline), gx, gy)
        c, s = np.cos(pose.angle), np.sin(pose.angle)
        turned = {"u": c * u - s * v, "v": s * u + c * v}
        turned = {name: np.where(valid, values, np.nan) for name, values in turned.items()}
        more = {"dwdz": np.where(valid, dwdz, np.nan)} if "dwdz" in series else {}
        plane = make_plane(x, y, **turned, valid=valid, **more, **finger)
        planes.append(plane.assign_coords(time=float(time)).astype(np.float32))
    out = xr.concat(planes, "time")
    return out.assign(valid=out["valid"].astype(np.uint8)).assign_attrs(series.attrs)


def _camera_finger(series: xr.Dataset, pose: Pose, time: float) -> dict[str, np.ndarray]:
    """The finger's variables at one instant in the camera frame; empty without a finger."""
    names = ("outline", "outline_velocity", "tip", "tip_direction", "dorsal_direction", "bend")
    return {
        name: in_camera(name, finger_at(series, name, time), pose)
        for name in names
        if name in series
    }


def in_camera(name: str, values: np.ndarray, pose: Pose) -> np.ndarray:
    """A finger's variable of the tank frame in the camera frame."""
    if name in ("outline", "tip"):
        return pose.to_camera(values)
    return values if name == "bend" else values @ pose.rotation.T
