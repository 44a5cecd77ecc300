"""Shapes that no finger can take: through itself, through another body, out of the water."""

from pathlib import Path

import numpy as np
import shapely
from numpy import ndarray

from pipeline.kinematics.contact import gap
from pipeline.scene.obstacle import Obstacle
from pipeline.scene.pinch import Pinch, Support
from pipeline.scene.sections import Tank
from piv.files.errors import StageError

_ROOT_PLAY = 1e-4  # m: the clamped root itself rises by microns as the finger bends
_GAP_TOLERANCE = 1e-9  # m: rounding of the pressure at which the tips stop
_LEAST_MOTION = 1e-3  # of the body's length: the flow of less is none that PIV sees
_MOST_SHAPES = 400  # a minute or more of meshing; shipped scenes have 10 to 80


def check_shapes(
    outlines: ndarray,
    bends: ndarray,
    tank: Tank,
    pinch: Pinch | None,
    support: Support | None,
    where: Path,
    obstacles: tuple[Obstacle, ...] = (),
) -> None:
    """StageError where an outline (knot, point, 2) crosses itself, a body, or the tank's walls."""
    for outline, bend in zip(outlines, np.degrees(bends), strict=True):
        fault = _fault(outline, tank, pinch, support, obstacles)
        if fault is not None:
            what, more = fault
            raise StageError(f"{where}: the finger {what} at {bend:.1f}° of bend{more}")


def _fault(
    outline: ndarray,
    tank: Tank,
    pinch: Pinch | None,
    support: Support | None,
    obstacles: tuple[Obstacle, ...],
) -> tuple[str, str] | None:
    """The fault of a shape, and its measure and remedy."""
    polygon, (left, low), (right, high) = shapely.Polygon(outline), outline.min(0), outline.max(0)
    if not polygon.is_valid:
        return "crosses itself", "; bend it less"
    if high >= tank.water_depth:
        surface = f"the surface is at {tank.water_depth:g} m"
        return "leaves the water", f" (it reaches y = {high:.3f} m, {surface}); lower finger.root"
    if low <= 0:
        return "hits the bottom", f" (it reaches y = {low:.3f} m); raise finger.root"
    if max(-left, right) >= tank.size[0] / 2:
        return "touches a wall of the tank", "; move finger.root"
    if pinch is not None and (near := gap(outline, pinch)) < pinch.residual_gap - _GAP_TOLERANCE:
        return (
            f"crosses the plane between the fingers{' or the object' if pinch.object else ''}, or"
            f" comes nearer than pinch.residual_gap = {pinch.residual_gap:g} m",
            f" (gap {near * 1e3:.3f} mm); raise pinch.half_distance or begin more open",
        )
    for number, obstacle in enumerate(obstacles):
        if polygon.intersects(obstacle.polygon):
            return f"meets obstacle[{number}] ({obstacle.shape})", "; move it, or bend less"
    if support is not None:
        half, bottom = 0.5 * support.size[0], support.bottom
        # a root at the height of the block's lower face does not enter it
        block = shapely.box(-half, bottom + _ROOT_PLAY, half, bottom + support.size[1])
        if polygon.intersects(block):
            return "touches the support", "; raise support.bottom"
    return None


def check_motion(moved: float, length: float, where: Path) -> None:
    """StageError where a tip or body moves (m) by next to nothing of its `length` (m)."""
    if not moved >= _LEAST_MOTION * length:
        raise StageError(
            f"{where}: [motion] moves the body by {moved:.3g} m until motion.end_time, less than"
            f" {_LEAST_MOTION:g} of its length: the water would stand still; give a larger or an"
            " earlier change"
        )


def check_number(count: float, key: str, step: float, where: Path) -> None:
    """StageError where the shapes at steps of `step` in `key` are too many to be meshed."""
    if count > _MOST_SHAPES:
        raise StageError(
            f"{where}: {key} = {step:.3g} makes {count:.3g} shapes of the motion, more than"
            f" {_MOST_SHAPES}; give at least {step * count / _MOST_SHAPES:.3g}"
        )


def check_body(shapes: ndarray, tank: Tank, where: Path) -> None:
    """StageError where a rigid body's outlines (knot, point, 2) leave the water."""
    x, y = shapes[..., 0], shapes[..., 1]
    if np.abs(x).max() >= 0.5 * tank.size[0] or y.min() <= 0 or y.max() >= tank.water_depth:
        raise StageError(
            f"{where}: the body leaves the water (x {x.min():.3g}…{x.max():.3g} m,"
            f" y {y.min():.3g}…{y.max():.3g} m); enlarge tank.size or move body.centre"
        )
