"""Fixed bodies of a scene: block above the roots, object between the tips, obstacles."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy import ndarray

from pipeline.scene.obstacle import OBSTACLE_PATCHES, Obstacle
from pipeline.scene.pinch import Pinch, Support

_CIRCLE_POINTS = 720  # of a full circle, before nodes are spread over it
_THIN_STEP = 0.3  # of a wall cell: thinner rings between the steps of a sphere are merged


@dataclass(frozen=True)
class FixedBody:
    """Outline of its footprint and reach along z.

    `pieces`: polylines (point, 2) between its corners, counter-clockwise, head to tail, m. Where
    the last does not end at the start, the outline closes along the plane between the fingers.
    """

    name: str
    pieces: tuple[ndarray, ...]
    half_width: float  # reach in |z|, m

    @property
    def polygon(self) -> shapely.Polygon:
        """Return the footprint of the body."""
        return shapely.Polygon(np.vstack(self.pieces))


def fixed_bodies(
    support: Support | None,
    pinch: Pinch | None,
    cylinder_length: float,
    wall_cell: float,
    levels: ndarray,
    obstacles: tuple[Obstacle, ...] = (),
) -> tuple[FixedBody, ...]:
    """The bodies of a scene, outer ones before those within; of a pinch their halves on x <= 0.

    An obstacle reaches as far as its depth, or to the last of the `levels` (level,) m, which are
    also the steps of a sphere. `cylinder_length` (m) along z is that of an object that is none.
    """
    bodies: list[FixedBody] = []
    mirror = pinch is not None
    if support is not None:
        width, height, depth = support.size
        low = support.bottom
        block = _block(0.5 * width, low, low + height, mirror)
        bodies.append(FixedBody("support", block, 0.5 * depth))
    for name, obstacle in zip(OBSTACLE_PATCHES, obstacles, strict=False):
        reach = obstacle.half_depth(2 * float(np.abs(levels).max()))
        bodies.append(FixedBody(name, obstacle.pieces, reach))
    thing = pinch.object if pinch is not None else None
    if thing is not None:
        radius, middle = 0.5 * thing.diameter, thing.centre_height
        steps = [(radius, 0.5 * cylinder_length)]
        if thing.shape == "sphere":
            steps = _sphere_steps(radius, levels, _THIN_STEP * wall_cell)
        bodies += [FixedBody("object", (_arc(r, middle, mirror),), reach) for r, reach in steps]
    return tuple(bodies)


def _sphere_steps(radius: float, levels: ndarray, thinnest: float) -> list[tuple[float, float]]:
    """Discs (radius, reach in |z|; m) of about a sphere's volume, the middle one as wide as it.

    Steps of less than `thinnest` are joined with the next, so that no sliver of a ring is meshed.
    """
    z = np.minimum(np.unique(np.abs(levels[levels <= 1e-12])), radius)
    layers = [(a, b) for a, b in pairwise(z) if b > a]
    groups = [layers[:1]]

    def size(group: list[tuple[float, float]]) -> float:
        if group is groups[0]:
            return radius
        a, b = group[0][0], group[-1][1]  # the disc that has the volume of these layers
        return float(np.sqrt(radius**2 - (a * a + a * b + b * b) / 3))

    for layer in layers[1:]:
        if size(groups[-1]) - size([layer]) < thinnest:
            groups[-1].append(layer)
        else:
            groups.append([layer])
    known = np.abs(levels)
    sized = [(size(group), group[-1][1]) for group in groups]
    return [(r, float(known[known >= end - 1e-12].min())) for r, end in sized if r > thinnest]


def _block(half_width: float, low: float, high: float, mirror: bool) -> tuple[ndarray, ...]:
    right = 0.0 if mirror else half_width
    corners = [(right, high), (-half_width, high), (-half_width, low), (right, low)]
    if not mirror:
        corners.append(corners[0])
    return tuple(np.linspace(a, b, 50) for a, b in pairwise(corners))


def _arc(radius: float, height: float, mirror: bool) -> ndarray:
    """The circle about (0, height), or its half on x <= 0, from its highest point."""
    count = _CIRCLE_POINTS // (2 if mirror else 1) + 1
    turn = np.linspace(0.5 * np.pi, (1.5 if mirror else 2.5) * np.pi, count)
    arc = np.column_stack([radius * np.cos(turn), height + radius * np.sin(turn)])
    arc[[0, -1], 0] = 0.0
    return arc
