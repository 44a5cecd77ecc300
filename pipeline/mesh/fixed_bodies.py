"""Fixed bodies of a scene: the block above the roots and the object between the tips, as outlines for the planform."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from pipeline.scene.pinch import Pinch, Support

CIRCLE_POINTS = 720  # of a full circle, before nodes are spread over it
THIN_STEP = 0.3  # of a wall cell: thinner rings between the steps of a sphere are merged


@dataclass(frozen=True)
class FixedBody:
    """Outline of its footprint and reach along z.

    `pieces`: polylines (point, 2) between its corners, counter-clockwise, head to tail, m. Where the last does not
    end at the start of the first, the outline closes along the plane between the fingers.
    """

    name: str
    pieces: tuple[np.ndarray, ...]
    half_width: float  # reach in |z|, m

    @property
    def polygon(self) -> shapely.Polygon:
        """The footprint."""
        return shapely.Polygon(np.vstack(self.pieces))


def fixed_bodies(support: Support | None, pinch: Pinch | None, cylinder_length: float, wall_cell: float,
                 levels: np.ndarray) -> tuple[FixedBody, ...]:  # fmt: skip
    """The bodies that a scene asks for, outer ones before those within; of a pinch their halves on x <= 0.

    `cylinder_length` (m) along z is that of an object that is no sphere; `levels` (level,) m: z of the sweep, at which the
    steps of a sphere change.
    """
    bodies: list[FixedBody] = []
    mirror = pinch is not None
    if support is not None:
        width, height, depth = support.size
        low = support.bottom
        bodies.append(
            FixedBody("support", _block(0.5 * width, low, low + height, mirror), 0.5 * depth)
        )
    thing = pinch.object if pinch is not None else None
    if thing is not None:
        radius, middle = 0.5 * thing.diameter, thing.centre_height
        steps = [(radius, 0.5 * cylinder_length)]
        if thing.shape == "sphere":
            steps = sphere_steps(radius, levels, THIN_STEP * wall_cell)
        bodies += [FixedBody("object", (_arc(r, middle, mirror),), reach) for r, reach in steps]
    return tuple(bodies)


def sphere_steps(radius: float, levels: np.ndarray, thinnest: float) -> list[tuple[float, float]]:
    """Discs (radius, reach in |z|; m) whose pile has about a sphere's volume; the middle one is as wide as the sphere.

    Each layer of the sweep gets the disc of its part of the sphere's volume; steps of less than `thinnest` are joined
    with the next, so that no sliver of a ring is meshed.
    """
    z = np.unique(np.abs(levels[levels <= 1e-12]))
    z = np.minimum(z, radius)
    layers = [(a, b) for a, b in pairwise(z) if b > a]
    groups = [layers[:1]]

    def size(group: list[tuple[float, float]]) -> float:
        return radius if group is groups[0] else _mean_radius(radius, group)

    for layer in layers[1:]:
        if size(groups[-1]) - size([layer]) < thinnest:
            groups[-1].append(layer)
        else:
            groups.append([layer])
    sized = [(size(group), group[-1][1]) for group in groups]
    return [(r, _level_at_or_beyond(levels, end)) for r, end in sized if r > thinnest]


def _mean_radius(radius: float, layers: list[tuple[float, float]]) -> float:
    """Radius of the disc that has the volume of a sphere's layers."""
    a, b = layers[0][0], layers[-1][1]
    return float(np.sqrt(radius**2 - (a * a + a * b + b * b) / 3))


def _level_at_or_beyond(levels: np.ndarray, z: float) -> float:
    known = np.abs(levels)
    return float(known[known >= z - 1e-12].min())


def _block(half_width: float, low: float, high: float, mirror: bool) -> tuple[np.ndarray, ...]:
    right = 0.0 if mirror else half_width
    corner = np.array([[right, high], [-half_width, high], [-half_width, low], [right, low]])
    if not mirror:
        corner = np.vstack([corner, corner[:1]])
    return tuple(np.linspace(a, b, 50) for a, b in pairwise(corner))


def _arc(radius: float, height: float, mirror: bool) -> np.ndarray:
    """The circle about (0, height), or its half on x <= 0, from its highest point."""
    turn = np.linspace(
        0.5 * np.pi, (1.5 if mirror else 2.5) * np.pi, CIRCLE_POINTS // (2 if mirror else 1) + 1
    )
    arc = np.column_stack([radius * np.cos(turn), height + radius * np.sin(turn)])
    arc[0, 0], arc[-1, 0] = 0.0, 0.0
    return arc
