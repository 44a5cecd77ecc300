"""The tank frame in a camera's picture: a similarity, and plane series seen through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
import xarray as xr

from piv.formats.plane_series import FINGER_VARIABLES, make_plane
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

    def view(self, corners: np.ndarray, margin: float) -> tuple[float, float, float, float]:
        """x0, x1, y0, y1 (m, tank) around two corners (2, 2) of the picture (px) and a margin (m).

        In steps of `STEP`, so that recordings of one set-up share it.
        """
        (left, bottom), (right, top) = corners
        around = [[left, bottom], [right, bottom], [right, top], [left, top]]
        places = self.to_tank(np.array(around, float))
        low = STEP * np.floor((places.min(axis=0) - margin) / STEP)
        high = STEP * np.ceil((places.max(axis=0) + margin) / STEP)
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
    variables are turned as well. `field`: of the series, where many calls share it.
    """
    field = field or PlaneField(series)
    finger = {
        name: in_camera(name, np.array([finger_at(series, name, t) for t in times]), pose)
        for name in FINGER_VARIABLES
        if name in series
    }
    gx, gy = np.meshgrid(x, y)
    at = pose.from_camera(np.stack([gx, gy], axis=-1))
    low, high = (field.x[0], field.y[0]), (field.x[-1], field.y[-1])
    inside = np.all((at >= low) & (at <= high), axis=-1)
    valid = np.repeat(inside[np.newaxis], len(times), axis=0)
    for k, outlines in enumerate(finger.get("outline", ())):
        for outline in outlines:
            valid[k] &= ~shapely.contains_xy(shapely.Polygon(outline), gx, gy)

    tank = [field.sample(field.at(float(t)), at[..., 0], at[..., 1])[:2] for t in times]
    velocity = pose.rotation @ np.array(tank)
    velocity = velocity.reshape(len(times), 2, *gx.shape).astype(np.float32)
    u, v = np.where(valid[:, None], velocity, np.nan).swapaxes(0, 1)
    return make_plane(x, y, u, v, time=times, valid=valid, **finger).assign_attrs(series.attrs)


def in_camera(name: str, values: np.ndarray, pose: Pose) -> np.ndarray:
    """A finger's variable of the tank frame in the camera frame."""
    if name in ("outline", "tip"):
        return pose.to_camera(values)
    return values if name == "bend" else values @ pose.rotation.T
