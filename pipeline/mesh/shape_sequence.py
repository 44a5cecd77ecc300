"""The finger's shapes over the shape parameter, and a planform carried through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.geometry.planform import Planform
from pipeline.mesh.morph import Morph, MorphError, corner_triangles
from pipeline.mesh.wall_layers import outline_at

NEAR_KNOT = 0.3  # of the distance between knots: one nearer to an end of a part is left out


@dataclass(frozen=True)
class ShapeSequence:
    """Outlines (knot, point, 2), tips (knot, 2; or several: knot, edge, 2) and bends (knot, rad) of the finger over the shape parameter (Pa)."""

    parameter: np.ndarray
    outline: np.ndarray
    tip: np.ndarray
    bend: np.ndarray

    def at(self, parameter: np.ndarray) -> ShapeSequence:
        """The shapes at other parameters, by cubic splines."""
        return ShapeSequence(
            parameter,
            *(
                CubicSpline(self.parameter, v)(parameter)
                for v in (self.outline, self.tip, self.bend)
            ),
        )

    def within(self, low: float, high: float) -> ShapeSequence:
        """The shapes from parameter `low` to `high`: these two and the knots between them."""
        knots = self.parameter
        if low <= knots[0] and high >= knots[-1]:
            return self
        low, high = max(low, knots[0]), min(high, knots[-1])
        step = np.interp([low, high], 0.5 * (knots[1:] + knots[:-1]), np.diff(knots))
        inner = knots[(knots > low + NEAR_KNOT * step[0]) & (knots < high - NEAR_KNOT * step[1])]
        few = np.linspace(low, high, 5)  # a cubic spline needs four
        return self.at(np.concatenate([[low], inner, [high]]) if len(inner) >= 3 else few)


def between(
    shapes: ShapeSequence, frames: np.ndarray, parts: int = 3
) -> tuple[ShapeSequence, np.ndarray]:
    """The shapes as the motion runs through them: `parts` to each interval between knots, by the same cubic spline."""
    index = np.arange(len(shapes.parameter), dtype=float)
    fine = np.linspace(0, index[-1], parts * (len(index) - 1) + 1)
    parameter = np.interp(fine, index, shapes.parameter)
    return shapes.at(parameter), CubicSpline(shapes.parameter, frames)(parameter)


def morph_shapes(
    planform: Planform,
    shapes: ShapeSequence,
    built: int,
    accept: Callable[[int, np.ndarray], None] | None = None,
) -> np.ndarray:
    """Node positions (knot, node, 2) of a planform built at knot `built`, for every knot.

    `accept(knot, nodes)` is called with each shape as it is found, outwards from `built`. Raises MorphError.
    """
    morph = Morph(
        planform.nodes, corner_triangles(planform.triangles, planform.quads), planform.fixed
    )
    count = len(shapes.parameter)

    def boundary(knot: float) -> np.ndarray:
        low = min(int(knot), count - 2)
        part = knot - low
        outline = shapes.outline[low] * (1 - part) + shapes.outline[low + 1] * part
        nodes = planform.nodes.copy()
        nodes[planform.wall] = outline_at(outline, planform.material)
        return nodes

    frames = np.empty((count, *planform.nodes.shape))
    frames[built] = morph.relax(planform.nodes)
    steps = [(built, built)]
    steps += [(k - 1, k) for k in range(built + 1, count)]
    steps += [(k + 1, k) for k in range(built - 1, -1, -1)]
    for at, knot in steps:
        try:
            if knot != at:
                frames[knot] = morph.follow(frames[at], boundary, at, knot)
        except MorphError as error:
            reached, wanted = np.degrees(shapes.bend[[at, knot]])
            raise MorphError(f"{error} than {reached:.1f}° of bend towards {wanted:.1f}°") from None
        if accept:
            accept(knot, frames[knot])
    return frames
