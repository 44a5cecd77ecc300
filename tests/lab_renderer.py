"""A second renderer of a laboratory's pictures, for the tests of its comparison alone: plain numpy, nothing of the virtual laboratory.

Particles are points of light behind a pinhole camera; faults that real recordings have are added one by one. In one history of
particles those near the finger stay beside the same part of its surface, so that successive pictures share them, while each
picture by itself is evenly strewn, as in water.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from fileio.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.data.pose import Pose

REACH = 0.004  # m beyond the picture that particles are strewn over
SPOT = 3  # px on each side of a particle that its light reaches
LOST = 0.15  # share of the particles that leave the light sheet from one picture to the next, and others come
CARRIED = 0.006  # m from the finger's surface within which particles go along with it; further off each picture has others


@dataclass(frozen=True)
class Faults:
    """What is wrong with a recording; nothing by default. Lengths in m.

    `shadow`: share of the light that is lost beside the finger, on the side that `shadow_to` (unit vector, tank frame) points to,
    the whole of it over half of `shadow_width`, falling to none over the other half. `reflection`: peak of a bright line along the dorsal edge, as a share of a particle's.
    `holder`: length of the finger that a dark holder hides from the root on. `perspective` (1/m): the magnification's relative
    change along x and y of the tank frame.
    """

    shadow: float = 0.0
    shadow_to: tuple[float, float] = (1.0, 0.0)
    shadow_width: float = 0.006
    reflection: float = 0.0
    holder: float = 0.0
    perspective: tuple[float, float] = (0.0, 0.0)


def _away(particles: np.ndarray, outline: np.ndarray, reach: float) -> np.ndarray:
    """Distances (particle,) m from an outline (point, 2) m, 0 within it; infinite where they are surely beyond `reach` (m)."""
    low, high = outline.min(axis=0) - reach, outline.max(axis=0) + reach
    near = ((particles[:, :2] >= low) & (particles[:, :2] <= high)).all(axis=1)
    away = np.full(len(particles), np.inf)
    away[near] = shapely.distance(shapely.Polygon(outline), shapely.points(particles[near, :2]))
    return away


def _directions(outline: np.ndarray) -> np.ndarray:
    """Directions of an outline (point, 2) at its points as complex numbers of size 1."""
    along = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    return (along[:, 0] + 1j * along[:, 1]) / np.hypot(*along.T)


class Rendered(Recording):
    """Pictures (8 bit) of a finger at `pressures` (frame,) Pa; `fresh`: new particles for each, else one history of them.

    `flow`: velocities (n, 2) m/s at points (n, 2) m and a time (s). Pictures 1-2, 3-4 … at `times` (frame,) s then show the same
    particles, which it carries, and each pair has others.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        pose: Pose,
        pressures: np.ndarray,
        shape: tuple[int, int],
        faults: Faults | None = None,
        *,
        density_ppp: float = 0.06,
        fresh: bool = True,
        flow: Callable[[np.ndarray, float], np.ndarray] | None = None,
        times: np.ndarray | None = None,
        seed: int = 1,
    ) -> None:
        super().__init__("rendered", len(pressures), None)
        self._kinematics, self._pose, self._pressures = (
            kinematics,
            pose,
            np.asarray(pressures, float),
        )
        self._flow, self._times = flow, times
        self._size, self._faults, self._fresh, self._seed = shape, faults or Faults(), fresh, seed
        rows, columns = shape
        corners = pose.to_tank(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float))
        self._low, self._high = corners.min(axis=0) - REACH, corners.max(axis=0) + REACH
        self._expected = density_ppp * np.prod(self._high - self._low) / pose.scale_m_per_px**2
        self._history: list[np.ndarray] = []
        if not fresh:
            rng = np.random.default_rng(seed)
            self._history = [self._strewn(rng)]
            for before, after in zip(self._pressures, self._pressures[1:], strict=False):
                self._history.append(
                    self._moved(self._history[-1], float(before), float(after), rng)
                )

    def _strewn(self, rng: np.random.Generator) -> np.ndarray:
        """Particles (n, 3): x, y (m) and z in standard deviations of the sheet's light."""
        count = rng.poisson(self._expected)
        return np.column_stack(
            [rng.uniform(self._low, self._high, (count, 2)), rng.uniform(-2, 2, count)]
        )

    def _moved(
        self, particles: np.ndarray, before: float, after: float, rng: np.random.Generator
    ) -> np.ndarray:
        """The particles a picture later: those near the finger stay beside the same part of it, but for the share `LOST`."""
        first, then = (self._kinematics.shape("outline", pressure) for pressure in (before, after))
        away = _away(particles, first, CARRIED)
        near = particles[(away > 0) & (away <= CARRIED)]
        near = near[rng.random(len(near)) > LOST]
        beside = cKDTree(first).query(near[:, :2])[1]
        turned = (_directions(then) / _directions(first))[beside]
        arm = (near[:, 0] - first[beside, 0] + 1j * (near[:, 1] - first[beside, 1])) * turned
        near[:, :2] = then[beside] + np.column_stack([arm.real, arm.imag])
        others = self._strewn(rng)
        beyond = _away(others, then, CARRIED) > CARRIED
        return np.vstack([near, others[beyond | (rng.random(len(others)) < LOST)]])

    def to_px(self, points: np.ndarray) -> np.ndarray:
        """Positions (…, 2) of the tank frame in the picture, with the perspective."""
        pose = self._pose
        at = np.asarray(points) - pose.anchor
        shrunk = at / (1 + at @ np.asarray(self._faults.perspective))[..., None]
        return shrunk @ pose.rotation.T / pose.scale_m_per_px + np.asarray(pose.at_px)

    def _carried(self, i: int) -> np.ndarray:
        """Particles of picture `i` where they come in pairs; none comes out of the body."""
        particles = self._strewn(np.random.default_rng([self._seed, i // 2, 1]))
        if i % 2 == 0:
            return particles
        body = shapely.Polygon(self._kinematics.shape("outline", float(self._pressures[i - 1])))
        particles = particles[~shapely.contains_xy(body, particles[:, 0], particles[:, 1])]
        assert self._flow
        begin, step = self._times[i - 1], self._times[i] - self._times[i - 1]
        at = particles[:, :2]
        particles[:, :2] = at + step * self._flow(
            at + 0.5 * step * self._flow(at, begin), begin + 0.5 * step
        )
        return particles

    def _read(self, i: int) -> np.ndarray:
        rng = np.random.default_rng([self._seed, i])
        faults, outline = self._faults, self._kinematics.shape("outline", float(self._pressures[i]))
        body = shapely.Polygon(outline)
        if self._flow:
            particles = self._carried(i)
        elif self._fresh:
            particles = self._strewn(rng)
        else:
            particles = self._history[i]
        particles = particles[~shapely.contains_xy(body, particles[:, 0], particles[:, 1])]
        light = 170 * np.exp(-0.5 * particles[:, 2] ** 2)
        if faults.shadow:
            light *= 1 - self._shadow(particles[:, :2], body)
        size = np.full(len(light), 0.62)  # px, standard deviation
        places = particles[:, :2]
        if faults.reflection:
            line = self._dorsal_line(outline, float(self._pressures[i]))
            places = np.vstack([places, line])
            light = np.concatenate(
                [light, faults.reflection * 170 * rng.uniform(0.5, 1.5, len(line))]
            )
            size = np.concatenate([size, np.full(len(line), 0.8)])
        image = self._spots(self.to_px(places), light, size)
        image += 8 + rng.normal(0, 2, self._size)
        if faults.holder:
            image = np.where(self._held(), 8 + rng.normal(0, 2, self._size), image)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _shadow(self, places: np.ndarray, body: shapely.Polygon) -> np.ndarray:
        """Share of the light (particle,) that the finger takes: of what lies behind it, the more the nearer."""
        away = shapely.distance(body, shapely.points(places))
        reach = np.asarray(self._faults.shadow_to) * 4 * self._faults.shadow_width
        rays = shapely.linestrings(np.stack([places, places - reach], axis=1))
        behind = shapely.intersects(body, rays)
        return np.where(
            behind,
            self._faults.shadow * np.clip(2 - 2 * away / self._faults.shadow_width, 0, 1),
            0.0,
        )

    def _dorsal_line(self, outline: np.ndarray, pressure: float) -> np.ndarray:
        """Points a pixel apart along the dorsal side of the finger's edge."""
        rest = self._kinematics.shape("outline", self._kinematics.low)
        dorsal = self._kinematics.shape("dorsal_direction", self._kinematics.low)
        across = (rest - np.asarray(self._kinematics.root)) @ dorsal
        side = np.flatnonzero(across > across.max() - 1e-3)
        ends = [(k, (k + 1) % len(outline)) for k in side if (k + 1) % len(outline) in side]
        step = self._pose.scale_m_per_px
        pieces = [np.linspace(outline[a], outline[b], max(round(np.hypot(*(outline[b] - outline[a])) / step), 1), endpoint=False)
                  for a, b in ends]  # fmt: skip
        return np.vstack(pieces)

    def _held(self) -> np.ndarray:
        """Pixels (rows, columns) of the holder: all beyond a line across the finger at rest."""
        rows, columns = self._size
        x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
        along = self._kinematics.shape("tip_direction", self._kinematics.low)
        from_root = self._pose.to_tank(np.stack([x, y], axis=-1)) - np.asarray(
            self._kinematics.root
        )
        return np.asarray(from_root @ along < self._faults.holder)

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
                np.add.at(
                    image,
                    (j + dj + SPOT + 1, i + di + SPOT + 1),
                    light * np.exp(-0.5 * far2 / size**2),
                )
        return image[SPOT + 1 : -SPOT - 1, SPOT + 1 : -SPOT - 1]
