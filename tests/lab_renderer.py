"""A second renderer of a laboratory's pictures, for tests alone.

Plain numpy, independent of the virtual laboratory: points of light behind a pinhole camera, fresh
in each picture, with faults of real recordings added one by one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from fileio.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.data.pose import Pose

REACH = 0.004  # m beyond the picture that particles are strewn over
SPOT = 3  # px on each side of a particle that its light reaches


@dataclass(frozen=True)
class Faults:
    """What is wrong with a recording; nothing by default. Lengths in m.

    `shadow`: share of the light that is lost on the side of `shadow_to` (unit vector, tank frame)
    over half of `shadow_width`, falling to none over the other half. `reflection`: peak of a bright
    line along the dorsal edge, as a share of a particle's. `holder`: length that a dark holder
    hides from the root on.
    """

    shadow: float = 0.0
    shadow_to: tuple[float, float] = (1.0, 0.0)
    shadow_width: float = 0.006
    reflection: float = 0.0
    holder: float = 0.0


class Rendered(Recording):
    """Pictures (8 bit, fresh particles) of a finger at `pressures` (frame,) Pa."""

    def __init__(
        self,
        kinematics: Kinematics,
        pose: Pose,
        pressures: np.ndarray,
        shape: tuple[int, int],
        faults: Faults | None = None,
    ) -> None:
        super().__init__("rendered", len(pressures))
        self._kinematics, self._pose, self._pressures = kinematics, pose, pressures
        self._size, self._faults = shape, faults or Faults()
        rows, columns = shape
        corners = pose.to_tank(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float))
        self._low, self._high = corners.min(axis=0) - REACH, corners.max(axis=0) + REACH
        self._expected = 0.06 * np.prod(self._high - self._low) / pose.pixel**2

    def _strewn(self, rng: np.random.Generator) -> np.ndarray:
        """Particles (n, 3): x, y (m) and z in standard deviations of the sheet's light."""
        count = rng.poisson(self._expected)
        places = rng.uniform(self._low, self._high, (count, 2))
        return np.column_stack([places, rng.uniform(-2, 2, count)])

    def to_px(self, points: np.ndarray) -> np.ndarray:
        """Positions (…, 2) of the tank frame in the picture."""
        pose = self._pose
        at = np.asarray(points) - pose.anchor
        return at @ pose.rotation.T / pose.pixel + np.asarray(pose.at_px)

    def _read(self, i: int) -> np.ndarray:
        rng = np.random.default_rng([1, i])
        faults, outline = self._faults, self._kinematics.shape("outline", float(self._pressures[i]))
        body = shapely.Polygon(outline)
        particles = self._strewn(rng)
        particles = particles[~shapely.contains_xy(body, particles[:, 0], particles[:, 1])]
        light = 170 * np.exp(-0.5 * particles[:, 2] ** 2)
        if faults.shadow:
            light *= 1 - self._shadow(particles[:, :2], body)
        size = np.full(len(light), 0.62)  # px, standard deviation
        places = particles[:, :2]
        if faults.reflection:
            line = self._dorsal_line(outline, float(self._pressures[i]))
            places = np.vstack([places, line])
            bright = faults.reflection * 170 * rng.uniform(0.5, 1.5, len(line))
            light = np.concatenate([light, bright])
            size = np.concatenate([size, np.full(len(line), 0.8)])
        image = self._spots(self.to_px(places), light, size)
        image += 8 + rng.normal(0, 2, self._size)
        if faults.holder:
            image = np.where(self._held(), 8 + rng.normal(0, 2, self._size), image)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _shadow(self, places: np.ndarray, body: shapely.Polygon) -> np.ndarray:
        """Share of the light (particle,) that the finger takes of places behind it."""
        away = shapely.distance(body, shapely.points(places))
        reach = np.asarray(self._faults.shadow_to) * 4 * self._faults.shadow_width
        rays = shapely.linestrings(np.stack([places, places - reach], axis=1))
        behind = shapely.intersects(body, rays)
        lost = self._faults.shadow * np.clip(2 - 2 * away / self._faults.shadow_width, 0, 1)
        return np.where(behind, lost, 0.0)

    def _dorsal_line(self, outline: np.ndarray, pressure: float) -> np.ndarray:
        """Points a pixel apart along the dorsal side of the finger's edge."""
        rest = self._kinematics.shape("outline", self._kinematics.low)
        dorsal = self._kinematics.shape("dorsal_direction", self._kinematics.low)
        across = (rest - np.asarray(self._kinematics.root)) @ dorsal
        side = np.flatnonzero(across > across.max() - 1e-3)
        ends = [(k, (k + 1) % len(outline)) for k in side if (k + 1) % len(outline) in side]
        step = self._pose.pixel
        pieces = []
        for a, b in (outline[list(k)] for k in ends):
            count = max(round(np.hypot(*(b - a)) / step), 1)
            pieces.append(np.linspace(a, b, count, endpoint=False))
        return np.vstack(pieces)

    def _held(self) -> np.ndarray:
        """Pixels (rows, columns) of the holder: all beyond a line across the finger at rest."""
        rows, columns = self._size
        x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
        along = self._kinematics.shape("tip_direction", self._kinematics.low)
        places = self._pose.to_tank(np.stack([x, y], axis=-1))
        return np.asarray((places - self._kinematics.root) @ along < self._faults.holder)

    def _spots(self, at: np.ndarray, light: np.ndarray, size: np.ndarray) -> np.ndarray:
        """An image of Gaussian spots at positions (particle, 2) px, y up."""
        rows, columns = self._size
        image = np.zeros((rows + 2 * SPOT + 2, columns + 2 * SPOT + 2))
        x, y = at[:, 0], rows - 1 - at[:, 1]
        ok = (x > -1) & (x < columns) & (y > -1) & (y < rows)
        x, y, light, size = x[ok], y[ok], light[ok], size[ok]
        i, j = np.rint(x).astype(int), np.rint(y).astype(int)
        for dj in range(-SPOT, SPOT + 1):
            for di in range(-SPOT, SPOT + 1):
                far2 = (i + di - x) ** 2 + (j + dj - y) ** 2
                pixels = j + dj + SPOT + 1, i + di + SPOT + 1
                np.add.at(image, pixels, light * np.exp(-0.5 * far2 / size**2))
        return image[SPOT + 1 : -SPOT - 1, SPOT + 1 : -SPOT - 1]
