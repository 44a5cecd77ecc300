"""The finger's shapes over the shape parameter, and a planform carried through them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.interpolate import CubicSpline

from pipeline.geometry.planform import Planform
from pipeline.mesh.morph import Morph, MorphError, corner_triangles
from pipeline.mesh.wall_layers import outline_at

_NEAR_KNOT = 0.3  # of the distance between knots: one nearer to an end of a part is left out
_LEAST_WAY = 0.1  # of a tip's way: what it moves back by less leaves no vortex to resolve
_BETWEEN = 3  # shapes to each interval between knots, as the motion runs through them


@dataclass(frozen=True)
class ShapeSequence:
    """Shapes of the finger over the shape parameter (Pa)."""

    parameter: ndarray
    outline: ndarray  # (knot, point, 2)
    tip: ndarray  # (knot, 2), or several: (knot, edge, 2)
    bend: ndarray  # (knot,) rad
    near: ndarray  # (knot, place, 2): cells stay small about these

    def at(self, parameter: ndarray) -> "ShapeSequence":
        """The shapes at other parameters, by cubic splines."""
        values = (self.outline, self.tip, self.bend, self.near)
        return ShapeSequence(
            parameter, *(CubicSpline(self.parameter, v)(parameter) for v in values)
        )

    def within(self, low: float, high: float) -> "ShapeSequence":
        """The shapes at parameters `low` and `high` and the knots between them."""
        knots = self.parameter
        if (low <= knots[0] and high >= knots[-1]) or low == high:  # a body that rests
            return self
        low, high = max(low, knots[0]), min(high, knots[-1])
        step = np.interp([low, high], 0.5 * (knots[1:] + knots[:-1]), np.diff(knots))
        near = _NEAR_KNOT * step
        inner = knots[(knots > low + near[0]) & (knots < high - near[1])]
        if len(inner) < 3:
            return self.at(np.linspace(low, high, 5))  # a cubic spline needs four
        return self.at(np.concatenate([[low], inner, [high]]))


def behind_tip(
    parameter: ndarray,
    tip: ndarray,
    tip_direction: ndarray,
    dorsal_direction: ndarray,
    motion: ndarray,
    offset: tuple[float, float],
) -> ndarray:
    """Places (knot, place, 2) `offset` (m) beyond the tips of each shape and behind their motion.

    `tip`: (knot, 2) or (knot, edge, 2), `motion`: the parameter after each time step. A tip that
    moves to and fro leaves vortices on both sides, so it has a place on each.
    """
    tips = tip.reshape(len(tip), -1, 2)
    between_knots = 0.5 * (dorsal_direction[1:] + dorsal_direction[:-1])
    dorsal_way = np.einsum("ka,ka->k", np.diff(tips.mean(1), axis=0), between_knots)
    steps = np.diff(np.interp(motion, parameter, np.concatenate([[0.0], np.cumsum(dorsal_way)])))
    least = _LEAST_WAY * np.abs(steps).sum()
    sides = [side for side in (1.0, -1.0) if np.maximum(-side * steps, 0.0).sum() > least]
    along, across = offset[0] * tip_direction, offset[1] * dorsal_direction
    return np.concatenate(
        [tips + (along + side * across)[:, None] for side in sides or [1.0]], axis=1
    )


def between(shapes: ShapeSequence, frames: ndarray) -> tuple[ShapeSequence, ndarray]:
    """The shapes as the motion runs through them, by the same cubic spline."""
    index = np.arange(len(shapes.parameter), dtype=float)
    fine = np.linspace(0, index[-1], _BETWEEN * (len(index) - 1) + 1)
    parameter = np.interp(fine, index, shapes.parameter)
    return shapes.at(parameter), CubicSpline(shapes.parameter, frames)(parameter)


def morph_shapes(
    planform: Planform,
    shapes: ShapeSequence,
    built: int,
    accept: Callable[[int, ndarray], None] = lambda knot, nodes: None,
) -> ndarray:
    """Node positions (knot, node, 2) of a planform built at knot `built`.

    `accept(knot, nodes)` is called with each shape, outwards from `built`. Raises MorphError.
    """
    triangles = corner_triangles(planform.triangles, planform.quads)
    morph = Morph(planform.nodes, triangles, planform.fixed)
    count = len(shapes.parameter)

    def boundary(knot: float) -> ndarray:
        low = min(int(knot), count - 2)
        part = knot - low
        outline = shapes.outline[low] * (1 - part) + shapes.outline[low + 1] * part
        nodes = planform.nodes.copy()
        nodes[planform.wall] = outline_at(outline, planform.material)
        return nodes

    frames = np.empty((count, *planform.nodes.shape))
    frames[built] = morph.relax(planform.nodes)
    accept(built, frames[built])
    steps = [(k - 1, k) for k in range(built + 1, count)]
    steps += [(k + 1, k) for k in range(built - 1, -1, -1)]
    for at, knot in steps:
        try:
            frames[knot] = morph.follow(frames[at], boundary, at, knot)
        except MorphError as error:
            reached, wanted = np.degrees(shapes.bend[[at, knot]])
            raise MorphError(f"{error} than {reached:.1f}° of bend towards {wanted:.1f}°") from None
        accept(knot, frames[knot])
    return frames
