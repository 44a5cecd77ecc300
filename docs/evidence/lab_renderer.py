"""A second renderer of a laboratory's pictures, for blind comparisons and tests.

Plain numpy, independent of `piv.synthetic`: points of light behind a pinhole camera, fresh
in each picture, with faults of real recordings added one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import xarray as xr
from scipy import ndimage

from pipeline.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.pose import Pose

REACH = 0.004  # m beyond the picture that particles are strewn over
SPOT = 3  # px on each side of a particle that its light reaches


@dataclass(frozen=True)
class Faults:
    """What is wrong with a recording; nothing by default. Lengths in m.

    `shadow`: share of the light that is lost on the side of `shadow_to` (unit vector, tank frame)
    over half of `shadow_width`, falling to none over the other half. `reflection`: peak of a bright
    line along the dorsal edge, as a share of a particle's. `holder`: length that a dark holder
    hides from the root on. `beside`: density within 1 mm of the wall over that beyond 2 mm.
    """

    shadow: float = 0.0
    shadow_to: tuple[float, float] = (1.0, 0.0)
    shadow_width: float = 0.006
    reflection: float = 0.0
    holder: float = 0.0
    beside: float = 1.0


class Rendered(Recording):
    """Pictures (8 bit, fresh particles) of a finger at `pressures` (frame,) Pa."""

    def __init__(
        self,
        kinematics: Kinematics,
        pose: Pose,
        pressures: np.ndarray,
        shape: tuple[int, int],
        faults: Faults | None = None,
        seed: int = 1,
    ) -> None:
        super().__init__("rendered", len(pressures))
        self._kinematics, self._pose, self._pressures = kinematics, pose, pressures
        self._size, self._faults, self._seed = shape, faults or Faults(), seed
        rows, columns = shape
        corners = pose.to_tank(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float))
        self._low, self._high = corners.min(axis=0) - REACH, corners.max(axis=0) + REACH
        self._expected = 0.06 * np.prod(self._high - self._low) / pose.pixel**2

    def _strewn(self, seed: list[int], pressure: float) -> np.ndarray:
        """Particles (n, 3) in the picture: x, y (m) and z in standard deviations of the light."""
        rng, faults = np.random.default_rng(seed), self._faults
        count = rng.poisson(self._expected * max(faults.beside, 1.0))
        places = rng.uniform(self._low, self._high, (count, 2))
        particles = np.column_stack([places, rng.uniform(-2, 2, count)])
        if faults.beside != 1.0:
            body = shapely.Polygon(self._kinematics.shape("outline", pressure))
            away = shapely.distance(body, shapely.points(places))
            density = 1 + (faults.beside - 1) * np.clip(2 - away / 1e-3, 0, 1)
            particles = particles[rng.random(count) < density / max(faults.beside, 1.0)]
        return particles

    def _particles(self, i: int) -> np.ndarray:
        """Particles of a frame, fresh in each."""
        return self._strewn([self._seed, i], float(self._pressures[i]))

    def _read(self, i: int) -> np.ndarray:
        rng = np.random.default_rng([self._seed, i, 1])
        faults, outline = self._faults, self._kinematics.shape("outline", float(self._pressures[i]))
        body = shapely.Polygon(outline)
        particles = self._particles(i)
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
        image = self._spots(self._pose.to_px(places), light, size)
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


class Filmed(Rendered):
    """Pairs of pictures at `times` (frame,) s whose particles go with a `flow` (plane series)."""

    def __init__(self, *args: Any, flow: xr.Dataset, times: np.ndarray, **more: Any) -> None:
        super().__init__(*args, **more)
        self._times, self._clock = times, flow["time"].values
        self._axes = [(float(flow[n][0]), float(flow[n][1] - flow[n][0])) for n in ("x", "y")]
        self._velocity = np.stack([flow["u"].values, flow["v"].values], axis=1)
        absent = ~np.isfinite(self._velocity[:, 0])
        for k, inside in enumerate(absent):  # the water sticks to the body
            j, i = ndimage.distance_transform_edt(
                inside, return_distances=False, return_indices=True
            )
            self._velocity[k] = self._velocity[k][:, j, i]

    def _particles(self, i: int) -> np.ndarray:
        pair = slice(i // 2 * 2, i // 2 * 2 + 2)
        middle = float(self._times[pair].mean())
        particles = self._strewn([self._seed, i // 2], float(self._pressures[pair].mean()))
        k = int(np.clip(np.searchsorted(self._clock, middle) - 1, 0, self._clock.size - 2))
        w = (middle - self._clock[k]) / (self._clock[k + 1] - self._clock[k])
        planes = (1 - w) * self._velocity[k] + w * self._velocity[k + 1]
        (x0, dx), (y0, dy) = self._axes
        at = [(particles[:, 1] - y0) / dy, (particles[:, 0] - x0) / dx]
        speed = [ndimage.map_coordinates(p, at, order=1, mode="nearest") for p in planes]
        particles[:, :2] += (self._times[i] - middle) * np.column_stack(speed)
        return particles
