"""A plane series as a camera sees it: persistent particles, and the exact truth."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.formats.plane_series import FINGER_VARIABLES, usable
from piv.formats.recording import CAMERA
from piv.images.masks import inside_polygon
from piv.synthetic.camera import CARRIED, Camera, Seeding
from piv.synthetic.particle_images import (
    SLAB_HALF_WIDTH,
    Body,
    add_particles,
    expose,
    in_mask,
    shadow_of,
    sheet_light,
)
from piv.synthetic.particles import (
    MARGIN,
    Box,
    Motion,
    advance,
    arriving,
    by_tiles,
    exact_displacement,
    motion,
    seed_particles,
)
from piv.synthetic.plane_spline import PlaneField

_TRUTH_SPACING_PX = 8.0


class Frame(NamedTuple):
    """A picture (row 0 at the top), its body mask, its particles (x, y, z in m, diameter in px)."""

    number: int
    image: ndarray
    mask: ndarray
    particles: ndarray


class Recorder:
    """Renders a plane series as a camera would see it, frame by frame, with particles that persist.

    Particles fill a slab of 2.5 sheet thicknesses a little larger than the picture. At each step
    the surroundings of that slab - a rim, and the inside of the body - are filled with fresh
    particles; those that the flow carries in stay, those that leave are dropped, so the density
    keeps its mean wherever the flow is free of divergence. Between pairs that are far apart they
    are all drawn anew. Random numbers depend on the seed and the frame's number only.
    """

    def __init__(self, series: xr.Dataset, camera: Camera, seeding: Seeding, seed: int = 0) -> None:
        # read once: opening a variable costs more than drawing an outline
        series = series.assign({n: series[n].load() for n in FINGER_VARIABLES if n in series})
        self.field = PlaneField(series)
        fixed = json.loads(series.attrs.get("fixed_bodies", "[]"))
        self._fixed = [np.array(polygon, float) for polygon in fixed]
        self.series, self.camera, self.seeding, self.seed = series, camera, seeding, seed
        self.origin_px = camera.origin_px or _centred(self.field, camera)
        first, last = self.field.time[[0, -1]]
        self.n_frames = math.floor((last - first) * camera.frame_rate_hz + 1e-6) + 1
        self.time = first + np.arange(self.n_frames) / camera.frame_rate_hz
        half_pair = self.n_frames % camera.pairs_every == 1  # at the end
        number = np.arange(self.n_frames - half_pair)
        self.taken = number[number % camera.pairs_every < 2]
        scale = camera.pixel
        self.rim_px = math.ceil(3 * seeding.diameter_px)
        left, bottom = ((-0.5 - self.rim_px - o) * scale for o in self.origin_px)
        self.box = Box(
            left,
            left + (camera.width_px + 2 * self.rim_px) * scale,
            bottom,
            bottom + (camera.height_px + 2 * self.rim_px) * scale,
            SLAB_HALF_WIDTH * seeding.sheet_thickness,
        )
        self._check_view()

    def _check_view(self) -> None:
        f, b, rim = self.field, self.box, self.rim_px * self.camera.pixel
        for axis, low, high, nodes, step in (
            ("x", b.x0 + rim, b.x1 - rim, f.x, f.dx),
            ("y", b.y0 + rim, b.y1 - rim, f.y, f.dy),
        ):
            if low < nodes[0] - 2 * step or high > nodes[-1] + 2 * step:
                raise ValueError(
                    f"the camera sees {axis} from {low:.4g} to {high:.4g} m but the plane series "
                    "reaches only from "
                    f"{nodes[0]:.4g} to {nodes[-1]:.4g} m; change origin_px, the scale or the "
                    "picture's size"
                )

    def to_px(self, x: ndarray, y: ndarray) -> tuple[ndarray, ndarray]:
        """Tank coordinates (m) to column and row of the picture (row 0 at the top)."""
        scale = self.camera.pixel
        return x / scale + self.origin_px[0], self.camera.height_px - 1 - (
            y / scale + self.origin_px[1]
        )

    def body(self, t: float) -> Body:
        """The body at time `t` on the picture with its rim: from `outline`, else absent vectors."""
        rim = self.rim_px
        mask = np.zeros((self.camera.height_px + 2 * rim, self.camera.width_px + 2 * rim), np.uint8)
        if "outline" in self.series:
            polygons = []
            for points in (*finger_at(self.series, "outline", t), *self._fixed):
                ok = np.isfinite(points).all(axis=1)
                polygons.append(np.stack(self.to_px(*points[ok].T), axis=1) + rim)
                mask |= inside_polygon(
                    polygons[-1], np.arange(mask.shape[1]), np.arange(mask.shape[0])
                )
            return Body(mask, tuple(polygons))
        f, scale = self.field, self.camera.pixel
        absent = ~usable(self.series.isel(time=int(np.argmin(np.abs(f.time - t))))).values
        if absent.any():
            x = (np.arange(mask.shape[1]) - rim - self.origin_px[0]) * scale
            y = (
                self.camera.height_px - 1 - (np.arange(mask.shape[0]) - rim) - self.origin_px[1]
            ) * scale
            i = np.clip(np.rint((x - f.x[0]) / f.dx).astype(int), 0, f.x.size - 1)
            j = np.clip(np.rint((y - f.y[0]) / f.dy).astype(int), 0, f.y.size - 1)
            mask[:] = absent[np.ix_(j, i)]
        return Body(mask)

    def _in_body(self, body: Body, p: ndarray) -> ndarray:
        column, row = self.to_px(p[0], p[1])
        return body.holds(column + self.rim_px, row + self.rim_px)

    def _draw(self, index: int, margin: float = 0.0, margin_z: float = 0.0) -> ndarray:
        s, scale = self.seeding, self.camera.pixel
        per_volume = s.density_ppp / (scale**2 * s.sheet_thickness)
        rng = np.random.default_rng([self.seed, index, 0])
        return seed_particles(
            self.box, per_volume, s.diameter_px, s.diameter_std_px, rng, margin, margin_z
        )

    def step(self, particles: ndarray, index: int, body: Body, next_body: Body) -> ndarray:
        """Particles of frame `index` + 1 from those of frame `index`."""
        t0, t1 = self.time[index], self.time[index + 1]
        most = self.motion(index)
        slack = self.camera.pixel
        fresh = self._draw(
            index + 1, MARGIN * most.along + slack, min(MARGIN * most.across, self.box.half_width)
        )
        fresh = fresh[:, arriving(self.field, fresh, self.box, t0, t1, most.along, slack)]
        fresh = fresh[:, ~self.box.holds(fresh) | self._in_body(body, fresh)]
        carried = by_tiles(np.concatenate([particles, fresh], axis=1), self.box)
        moved = advance(self.field, carried, t0, t1, most.substeps)
        return moved[:, self.box.holds(moved) & ~self._in_body(next_body, moved)]

    def motion(self, index: int) -> Motion:
        """Reach of particles from frame `index` to the next, and the integration steps."""
        return motion(self.field, self.time[index], self.time[index + 1], self.box.half_width)

    def picture(self, particles: ndarray, index: int, mask: ndarray) -> ndarray:
        """The camera's picture of `particles` at frame `index`; `mask` of the `body` then."""
        c, s, rim = self.camera, self.seeding, self.rim_px
        column, row = self.to_px(particles[0], particles[1])
        peak = s.peak * (2**c.bits - 1)
        light = (
            peak
            * sheet_light(particles[2], s.sheet_thickness)
            * (particles[3] / s.diameter_px) ** 2
        )
        if s.shadow > 0:
            dark = in_mask(shadow_of(mask), column + rim, row + rim)
            light[dark] *= 1 - s.shadow
        image = np.zeros((c.height_px, c.width_px), np.float32)
        add_particles(image, column, row, light, particles[3])
        rng = np.random.default_rng([self.seed, index, 1])
        return expose(image, rng, c.bits, c.background, c.read_noise, c.electrons_per_level)

    def frames(self, start: int = 0, state: tuple[int, ndarray] | None = None) -> Iterator[Frame]:
        """Frames taken from `start` on; `state`: number and particles of an earlier frame."""
        index, particles = state if state is not None else (0, self._draw(0))
        body = self.body(self.time[index])
        if state is None:
            particles = particles[:, ~self._in_body(body, particles)]
        inner = (slice(self.rim_px, -self.rim_px),) * 2
        taken, last = set(self.taken.tolist()), int(self.taken[-1])
        while True:
            if index >= start and index in taken:
                mask = body.mask
                yield Frame(
                    index, self.picture(particles, index, mask), mask[inner].copy(), particles
                )
            if index >= last:
                return
            later = index + 1
            while later not in taken:
                later += 1
            if later - index > CARRIED:
                index, body = later, self.body(self.time[later])
                particles = self._draw(index)
                particles = particles[:, ~self._in_body(body, particles)]
                continue
            next_body = self.body(self.time[index + 1])
            particles = self.step(particles, index, body, next_body)
            body, index = next_body, index + 1

    @property
    def truth_stride(self) -> int:
        """Stride of the plane's nodes whose truth is written: no finer than vectors are wanted."""
        wanted = _TRUTH_SPACING_PX * self.camera.pixel
        return max(1, int(wanted / max(self.field.dx, self.field.dy) + 1e-6))

    def truth(self, index: int) -> tuple[ndarray, ndarray, ndarray]:
        """Exact u, v (m/s; NaN where absent) and `valid` between frames `index` and `index` + 1.

        Particle displacement over the frame interval, put at the middle of its end points.
        """
        t0, t1 = self.time[index], self.time[index + 1]
        every = self.truth_stride
        x, y = np.meshgrid(self.field.x[::every], self.field.y[::every])
        dx, dy = exact_displacement(self.field, x, y, t0, t1, self.motion(index).substeps)
        time = self.field.time
        before = max(0, int(np.searchsorted(time, t0 + 1e-9, side="right")) - 1)
        after = min(time.size - 1, int(np.searchsorted(time, t1 - 1e-9)))
        near = self.series.isel(time=sorted({before, after}))
        valid = usable(near).all("time").values[::every, ::every]
        u, v = (np.where(valid, d / (t1 - t0), np.nan) for d in (dx, dy))
        return u, v, valid.astype(np.uint8)

    def attributes(self) -> dict[str, Any]:
        """Root attributes of the recording (docs/formats.md) but for provenance."""
        camera = asdict(self.camera)
        return {k: camera[k] for k in CAMERA if k in camera} | {
            "origin_x_px": float(self.origin_px[0]),
            "origin_y_px": float(self.origin_px[1]),
            "bits": self.camera.bits,
            "camera": camera,
            "seeding": asdict(self.seeding),
            "seed": self.seed,
        }


def _centred(field: PlaneField, camera: Camera) -> tuple[float, float]:
    middle = (field.x[0] + field.x[-1]) / 2, (field.y[0] + field.y[-1]) / 2
    size = camera.width_px - 1, camera.height_px - 1
    x, y = (s / 2 - m / camera.pixel for s, m in zip(size, middle, strict=True))
    return float(x), float(y)


def finger_at(series: xr.Dataset, name: str, t: float) -> ndarray:
    """A finger variable (finger, ...) at time `t`, linear between instants; constant outside."""
    time, values = series["time"].values, series[name].values
    i = int(np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(time.size - 2, 0)))
    a = values[i]
    if time.size == 1:
        return a
    s = min(max((t - time[i]) / (time[i + 1] - time[i]), 0.0), 1.0)
    if s <= 1e-9 or s >= 1 - 1e-9:
        return a if s <= 0.5 else values[i + 1]
    return (1 - s) * a + s * values[i + 1]
