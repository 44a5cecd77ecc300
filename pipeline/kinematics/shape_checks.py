"""Shapes that no finger can take: through itself, through another body, out of the water."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from fileio.errors import StageError
from pipeline.kinematics.contact import gap
from pipeline.scene.pinch import Pinch, Support
from pipeline.scene.sections import Tank

ROOT_PLAY = 1e-4  # m: the clamped root itself rises by microns as the finger bends
GAP_TOLERANCE = 1e-9  # m: rounding of the pressure at which the tips are held


def check_shapes(
    outlines: np.ndarray,
    bends: np.ndarray,
    tank: Tank,
    pinch: Pinch | None,
    support: Support | None,
    where: Path,
) -> None:
    """StageError where an outline (knot, point, 2) crosses itself, another body, or leaves the water or the tank."""
    half, depth = tank.size[0] / 2, tank.water_depth
    for outline, bend in zip(outlines, np.degrees(bends), strict=True):
        if not shapely.Polygon(outline).is_valid:
            raise StageError(
                f"{where}: the finger's outline crosses itself at {bend:.1f}° of bend; bend it less"
            )
        if outline[:, 1].max() >= depth:
            raise StageError(
                f"{where}: the finger leaves the water at {bend:.1f}° of bend (it reaches y = {outline[:, 1].max():.3f} m,"
                f" the surface is at {depth:g} m); lower finger.root"
            )
        if outline[:, 1].min() <= 0:
            raise StageError(
                f"{where}: the finger hits the bottom at {bend:.1f}° of bend (it reaches y ="
                f" {outline[:, 1].min():.3f} m); raise finger.root"
            )
        if np.abs(outline[:, 0]).max() >= half:
            raise StageError(
                f"{where}: the finger touches a wall of the tank at {bend:.1f}° of bend; move finger.root"
            )
        if pinch is not None:
            _check_gap(float(gap(outline, pinch)), bend, pinch, where)
        if support is not None and _enters(outline, support):
            raise StageError(
                f"{where}: the finger touches the support at {bend:.1f}° of bend; raise support.bottom"
            )


def _check_gap(gap_now: float, bend: float, pinch: Pinch, where: Path) -> None:
    if gap_now < pinch.residual_gap - GAP_TOLERANCE:
        what = (
            "crosses the plane between the fingers"
            if pinch.object is None
            else "crosses plane or object"
        )
        raise StageError(
            f"{where}: the finger {what}, or comes nearer than pinch.residual_gap = {pinch.residual_gap:g} m, at"
            f" {bend:.1f}° of bend (gap {gap_now * 1e3:.3f} mm); raise pinch.half_distance or begin more open"
        )


def _enters(outline: np.ndarray, support: Support) -> bool:
    """Whether the outline (point, 2) enters the block; a root at the height of its lower face does not."""
    half, bottom = 0.5 * support.size[0], support.bottom
    block = shapely.box(-half, bottom + ROOT_PLAY, half, bottom + support.size[1])
    return shapely.Polygon(outline).intersects(block)


def check_body(shapes: np.ndarray, tank: Tank, where: Path) -> None:
    """StageError where a rigid body's outlines (knot, point, 2) leave the water."""
    half, depth = 0.5 * tank.size[0], tank.water_depth
    x, y = shapes[..., 0], shapes[..., 1]
    if np.abs(x).max() >= half or y.min() <= 0 or y.max() >= depth:
        raise StageError(
            f"{where}: the body leaves the water (x {x.min():.3g}…{x.max():.3g} m,"
            f" y {y.min():.3g}…{y.max():.3g} m); enlarge tank.size or move body.centre"
        )
