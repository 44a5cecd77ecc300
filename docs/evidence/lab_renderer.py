"""A second renderer of a laboratory's pictures, for blind comparisons and tests.

Independent of the product's camera, flow interpolation and particles: a pinhole camera of its own,
spots integrated over pixels, particles that a flow carries by the midpoint rule. Faults of real
recordings are added one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import xarray as xr
from scipy import ndimage, special

from pipeline.formats.kinematics import Kinematics
from piv.images.recording import Recording
from postprocess.lab.pose import Pose

REACH = 0.004  # m beyond the picture that particles are strewn over
SPOT = 3  # px on each side of a particle that its light reaches
PEAK = 190.0  # grey levels of a particle in the middle of the sheet


@dataclass(frozen=True)
class Faults:
    """What is wrong with a recording; nothing by default. Lengths in m.

    `shadow`: share of the light that is lost on the side of `shadow_to` (unit vector, tank frame)
    over half of `shadow_width`, falling to none over the other half. `reflection`: peak of a bright
    line along the dorsal edge, as a share of a particle's. `holder`: length that a dark holder
    hides from the root on. `beside`: density within 1 mm of the wall over that beyond 2 mm.
    `flicker`: relative standard deviation of the light from picture to picture. `lost`: share of
    the particles that the second exposure has anew. `light`, `density`: factors of the usual ones.
    `bump`: shift (px, px) and turn (rad) of the camera from the middle picture on. `tilt`: rad, of
    a camera half a metre away. `mirrored`: left is right.
    """

    shadow: float = 0.0
    shadow_to: tuple[float, float] = (1.0, 0.0)
    shadow_width: float = 0.006
    reflection: float = 0.0
    holder: float = 0.0
    beside: float = 1.0
    flicker: float = 0.0
    lost: float = 0.0
    light: float = 1.0
    density: float = 1.0
    bump: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: float = 0.0
    mirrored: bool = False


class Rendered(Recording):
    """Pictures (8 bit, fresh particles) of a finger at `pressures` (frame,) Pa.

    Of `pose` only its numbers are used: mm per px, angle, and the px (y up) of its anchor.
    """

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
        self._kinematics, self._pressures = kinematics, pressures
        self._size, self._faults, self._seed = shape, faults or Faults(), seed
        self._pixel, self._anchor = 1e-3 * pose.scale_mm_per_px, np.array(pose.anchor)
        self._at, (c, s) = np.array(pose.at_px), (np.cos(pose.angle), np.sin(pose.angle))
        self._turn = np.array([[c, -s], [s, c]])
        rows, columns = shape
        corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float)
        places = (corners - self._at) @ self._turn * self._pixel + self._anchor
        self._low, self._high = places.min(axis=0) - REACH, places.max(axis=0) + REACH
        expected = 0.06 * np.prod(self._high - self._low) / self._pixel**2
        self._expected = expected * self._faults.density

    def _seen(self, places: np.ndarray, i: int) -> np.ndarray:
        """Where the camera sees places (n, 2) m in frame `i`, px with y up."""
        rows, columns = self._size
        centre, faults = np.array([columns, rows]) / 2, self._faults
        away = (places - self._anchor) @ self._turn.T / self._pixel + self._at - centre
        nearer = 1 + away[:, [0]] * self._pixel * np.sin(faults.tilt) / 0.5
        away = away * [np.cos(faults.tilt), 1.0] / nearer
        if i >= len(self) // 2:
            x, y, turn = faults.bump
            c, s = np.cos(turn), np.sin(turn)
            away = away @ np.array([[c, s], [-s, c]]) + [x, y]
        return away + centre

    def _bodies(self, pressure: float) -> shapely.MultiPolygon:
        outlines = self._kinematics.fingers("outline", pressure)
        return shapely.MultiPolygon([shapely.Polygon(outline) for outline in outlines])

    def _strewn(self, rng: np.random.Generator, pressure: float) -> np.ndarray:
        """Particles (n, 3) in the picture: x, y (m) and z in standard deviations of the light."""
        beside = self._faults.beside
        count = rng.poisson(self._expected * max(beside, 1.0))
        places = rng.uniform(self._low, self._high, (count, 2))
        particles = np.column_stack([places, rng.uniform(-2, 2, count)])
        if beside != 1.0:
            body = self._bodies(pressure)
            away = shapely.distance(body, shapely.points(places))
            density = 1 + (beside - 1) * np.clip(2 - away / 1e-3, 0, 1)
            particles = particles[rng.random(count) < density / max(beside, 1.0)]
        return particles

    def _particles(self, i: int) -> np.ndarray:
        """Particles of a frame, fresh in each."""
        return self._strewn(np.random.default_rng([self._seed, i]), float(self._pressures[i]))

    def _read(self, i: int) -> np.ndarray:
        rng, faults = np.random.default_rng([self._seed, i, 1]), self._faults
        outline = self._kinematics.shape("outline", float(self._pressures[i]))
        body, particles = self._bodies(float(self._pressures[i])), self._particles(i)
        shapely.prepare(body)
        particles = particles[~shapely.contains_xy(body, particles[:, 0], particles[:, 1])]
        places, light = particles[:, :2], PEAK * np.exp(-0.5 * particles[:, 2] ** 2)
        if faults.shadow:
            light *= 1 - self._shadow(places, body)
        size = np.full(len(light), 0.6)  # px, standard deviation
        if faults.reflection:
            line = self._dorsal_line(outline)
            places = np.vstack([places, line])
            bright = faults.reflection * PEAK * rng.uniform(0.5, 1.5, len(line))
            light = np.concatenate([light, bright])
            size = np.concatenate([size, np.full(len(line), 0.8)])
        image = self._spots(self._seen(places, i), light, size)
        image *= faults.light * max(1 + faults.flicker * rng.normal(), 0.1)
        if faults.holder:
            image = np.where(self._held(), 0.0, image)
        image += (
            8
            + rng.normal(0, 2, self._size)
            + np.sqrt(np.maximum(image, 0) / 50) * rng.normal(size=self._size)
        )
        image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        return np.ascontiguousarray(image[:, ::-1]) if faults.mirrored else image

    def _shadow(self, places: np.ndarray, body: shapely.MultiPolygon) -> np.ndarray:
        """Share of the light (particle,) that the finger takes of places behind it."""
        away = shapely.distance(body, shapely.points(places))
        reach = np.asarray(self._faults.shadow_to) * 4 * self._faults.shadow_width
        rays = shapely.linestrings(np.stack([places, places - reach], axis=1))
        behind = shapely.intersects(body, rays)
        lost = self._faults.shadow * np.clip(2 - 2 * away / self._faults.shadow_width, 0, 1)
        return np.where(behind, lost, 0.0)

    def _dorsal_line(self, outline: np.ndarray) -> np.ndarray:
        """Points a pixel apart along the dorsal side of the finger's edge."""
        rest = self._kinematics.shape("outline", self._kinematics.low)
        dorsal = self._kinematics.shape("dorsal_direction", self._kinematics.low)
        across = (rest - np.asarray(self._kinematics.root)) @ dorsal
        side = np.flatnonzero(across > across.max() - 1e-3)
        ends = [(k, (k + 1) % len(outline)) for k in side if (k + 1) % len(outline) in side]
        pieces = []
        for a, b in (outline[list(k)] for k in ends):
            count = max(round(np.hypot(*(b - a)) / self._pixel), 1)
            pieces.append(np.linspace(a, b, count, endpoint=False))
        return np.vstack(pieces)

    def _held(self) -> np.ndarray:
        """Pixels (rows, columns) of the holder: all beyond a line across the finger at rest."""
        rows, columns = self._size
        x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
        along = self._kinematics.shape("tip_direction", self._kinematics.low)
        arm = (np.stack([x, y], axis=-1) - self._at) @ self._turn * self._pixel
        return np.asarray(arm @ along < self._faults.holder)

    def _spots(self, at: np.ndarray, light: np.ndarray, size: np.ndarray) -> np.ndarray:
        """An image of Gaussian spots at positions (particle, 2) px, y up, integrated by pixel."""
        rows, columns = self._size
        at = np.column_stack([at[:, 0], rows - 1 - at[:, 1]])
        ok = np.all((at > -SPOT) & (at < np.array([columns, rows]) + SPOT - 1), axis=1)
        at, light, size = at[ok], light[ok], size[ok]
        first = np.rint(at).astype(int) - SPOT
        edges = first[..., None] + np.arange(2 * SPOT + 2) - 0.5 - at[..., None]
        parts = np.diff(0.5 * special.erf(edges / (2**0.5 * size[:, None, None])), axis=-1)
        total = 2 * np.pi * (size**2 * light)[:, None, None]  # as a point's peak
        values = total * parts[:, 1, :, None] * parts[:, 0, None, :]
        j, i = (first[:, k, None] + np.arange(2 * SPOT + 1) + 2 * SPOT for k in (1, 0))
        wide = columns + 4 * SPOT + 2
        pixels = j[:, :, None] * wide + i[:, None, :]
        count = (rows + 4 * SPOT + 2) * wide
        image = np.bincount(pixels.ravel(), values.ravel(), count)[:count].reshape(-1, wide)
        return image[2 * SPOT : 2 * SPOT + rows, 2 * SPOT : 2 * SPOT + columns]


class Filmed(Rendered):
    """Pairs of pictures at `times` (frame,) s whose particles go with a `flow` (plane series)."""

    def __init__(self, *args: Any, flow: xr.Dataset, times: np.ndarray, **more: Any) -> None:
        super().__init__(*args, **more)
        self._times, self._clock = times, flow["time"].values
        self._axes = [(float(flow[n][0]), float(flow[n][1] - flow[n][0])) for n in ("y", "x")]
        self._velocity = np.stack([flow["u"].values, flow["v"].values])
        for k, inside in enumerate(~np.isfinite(self._velocity[0])):  # the water sticks to the body
            j, i = ndimage.distance_transform_edt(
                inside, return_distances=False, return_indices=True
            )
            self._velocity[:, k] = self._velocity[:, k, j, i]

    def _water(self, places: np.ndarray, time: float) -> np.ndarray:
        """Velocity (n, 2) m/s at places (n, 2) m, linear in space and time."""
        clock = np.interp(time, self._clock, np.arange(self._clock.size))
        k = min(int(clock), self._clock.size - 2)
        (y0, dy), (x0, dx) = self._axes
        at = [(places[:, 1] - y0) / dy, (places[:, 0] - x0) / dx]
        seen = [
            [ndimage.map_coordinates(plane[n], at, order=1, mode="nearest") for plane in
             self._velocity] for n in (k, k + 1)
        ]  # fmt: skip
        return np.asarray((1 - clock + k) * np.array(seen[0]) + (clock - k) * np.array(seen[1])).T

    def _particles(self, i: int) -> np.ndarray:
        rng, first = np.random.default_rng([self._seed, i // 2]), i // 2 * 2
        particles = self._strewn(rng, float(self._pressures[first : first + 2].mean()))
        begin = float(self._times[first])
        step = float(self._times[min(first + 1, len(self) - 1)]) - begin
        # half of the way back from the middle of the exposures, half of it forth
        sign = -0.5 if i == first else 0.5
        middle, places = begin + step / 2, particles[:, :2]
        half = places + sign / 2 * step * self._water(places, middle)
        particles[:, :2] += sign * step * self._water(half, middle + sign / 2 * step)
        if i > first and self._faults.lost:
            anew = rng.random(len(particles)) < self._faults.lost
            particles[anew, :2] = rng.uniform(self._low, self._high, (int(anew.sum()), 2))
        return particles
