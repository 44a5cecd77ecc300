"""Particles in bands along the fitted outline, part by part, against the water's own density.

A sound fit has none inside and water outside; shadows, reflections and holders have not. What lies
behind a holder or in a stated shadow is left out: the lit side and the known thickness remain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from pipeline.formats.kinematics import Kinematics
from postprocess.lab.fit_outline import Shapes
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import WaterLikelihood, particles

# px from the outline, outside positive; the last band is the water's own
BANDS = np.array([-9.0, -1.5, 1.5, 6.0, 12.0, 30.0])
INSIDE, EDGE, NEAR, _, FAR = range(len(BANDS) - 1)
LENGTHS = 4  # parts that a side is cut in from root to tip
ENDS = 0.04  # of the finger's length: how far root and tip reach
SIDES = ("ventral", "dorsal")
NAMES = ("root", "tip", *(f"{side} side" for side in SIDES for _ in range(LENGTHS)))
GRID_PX = 2  # pixels in each direction that a point of the area stands for

# of the finger's depth along the light: what is deeper is as dark as the shadow behind it
UNSEEN_SIDE = 0.5


@dataclass(frozen=True)
class OutlineProfile:
    """Particles and area (px²) by frame, part of `NAMES` and band of `BANDS`.

    Outlines (frame, point, 2) in px, y up, and the part that each of their points belongs to.
    """

    count: np.ndarray
    area: np.ndarray
    outlines: np.ndarray
    part: np.ndarray

    def rate(self) -> float:
        """Particles per px² in the water around the finger."""
        return float(self.count[..., FAR].sum() / max(self.area[..., FAR].sum(), 1.0))


def _parts_of(shapes: Shapes) -> np.ndarray:
    """The part of `NAMES` of each point of the outline, by its place at rest."""
    kinematics = shapes.kinematics
    start = float(kinematics.law(kinematics.time[0]))
    outline = shapes.outlines[round(float(shapes.places_of(np.array(start))))]
    along = kinematics.shape("tip_direction", start)
    dorsal = kinematics.shape("dorsal_direction", start)
    from_root = outline - np.asarray(kinematics.root)
    reached = from_root @ along / kinematics.length
    across = from_root @ dorsal
    side = (across > 0.5 * (across.min() + across.max())).astype(int)
    step = np.clip((reached - ENDS) / (1 - 2 * ENDS) * LENGTHS, 0, LENGTHS - 1).astype(int)
    part = 2 + LENGTHS * side + step
    return np.where(reached < ENDS, 0, np.where(reached > 1 - ENDS, 1, part))


def outline_profile(
    images: list[np.ndarray],
    evidence: WaterLikelihood,
    shapes: Shapes,
    outlines: np.ndarray,
    blind: np.ndarray,
) -> OutlineProfile:
    """The profile of frames (row 0 at the top) with their `outlines` (frame, point, 2) px, y up.

    `blind` (frame, rows, columns): pixels to leave out.
    """
    part = _parts_of(shapes)
    count, area = np.zeros((2, len(images), len(NAMES), len(BANDS) - 1))
    for f, (image, outline) in enumerate(zip(images, outlines, strict=True)):
        row, column = particles(image, evidence.threshold)
        spots = np.column_stack([column, image.shape[0] - 1 - row])
        low, high = outline.min(axis=0) - BANDS[-1], outline.max(axis=0) + BANDS[-1]
        last = np.array(image.shape[::-1]) - 2.0  # no particle is found on the border
        low, high = np.maximum(low, 1.0), np.minimum(high, last)
        axes = [np.arange(low[i], high[i], GRID_PX) for i in (0, 1)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        spots = spots[((spots >= low) & (spots <= high)).all(axis=1)]
        along, corner = dense(outline, 1)
        tree, body = cKDTree(along), shapely.Polygon(outline)
        shapely.prepare(body)
        for points, each, total in ((spots, 1.0, count), (grid, float(GRID_PX**2), area)):
            i, j = np.rint(points).astype(int).T
            points = points[~blind[f, image.shape[0] - 1 - j, i]]
            away, nearest = tree.query(points, distance_upper_bound=BANDS[-1])
            near = np.isfinite(away)
            within = shapely.contains_xy(body, *points[near].T)
            distance = np.where(within, -away[near], away[near])
            band = np.digitize(distance, BANDS) - 1
            ok = (band >= 0) & (band < len(BANDS) - 1)
            np.add.at(total[f], (part[corner[nearest[near]]][ok], band[ok]), each)
    return OutlineProfile(count, area, outlines, part)


def seen_outlines(shapes: Shapes, pose: Pose, pressures: np.ndarray, growth: float) -> np.ndarray:
    """Outlines (frame, point, 2) px at `pressures` (frame,) Pa as the fit draws them."""
    at = np.clip(shapes.places_of(pressures), 0, len(shapes.pressures) - 1.001)
    k, w = at.astype(int), (at % 1)[:, None, None]
    outline, normal = ((1 - w) * a[k] + w * a[k + 1] for a in (shapes.outlines, shapes.normals))
    return pose.to_px(outline) + growth * normal @ pose.rotation.T


def independent_share(profile: OutlineProfile) -> float:
    """Share of independent pictures, by the correlation of successive counts beside the finger."""
    count, area = (a[..., NEAR] for a in (profile.count, profile.area))  # they stay longest there
    mean = count.sum(axis=0) / np.maximum(area.sum(axis=0), 1.0) * area
    z = (count - mean) / np.sqrt(np.maximum(mean, 1.0))
    near = float(np.sum(z[1:] * z[:-1]) / max(np.sum(z**2), 1e-9)) if len(z) > 2 else 0.0
    near = float(np.clip(near, 0.0, 0.95))
    return (1 - near) / (1 + near)


def shaded_parts(outlines: np.ndarray, light_from: float, shape: tuple[int, int]) -> np.ndarray:
    """Pixels (frame, rows, columns; row 0 at the top) behind the lit side of outlines (px, y up).

    `light_from`: direction of the light, rad from the picture's x axis.
    """
    rows, columns = shape
    onward = -np.array([np.cos(light_from), np.sin(light_from)])
    x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
    depth, across = x * onward[0] + y * onward[1], y * onward[0] - x * onward[1]
    first = int(np.floor(across.min()))
    ray = np.rint(across).astype(int) - first
    out = np.zeros((len(outlines), rows, columns), bool)
    for frame, outline in enumerate(outlines):
        along = dense(outline, 2)[0]
        at = np.rint(along[:, 1] * onward[0] - along[:, 0] * onward[1]).astype(int) - first
        inside = (at >= 0) & (at <= ray.max())
        lit, behind = np.full(ray.max() + 1, np.inf), np.full(ray.max() + 1, -np.inf)
        np.minimum.at(lit, at[inside], (along @ onward)[inside])
        np.maximum.at(behind, at[inside], (along @ onward)[inside])
        met = np.isfinite(lit)
        lit[met] += UNSEEN_SIDE * (behind - lit)[met]
        out[frame] = depth > lit[ray]
    return out


def blind_parts(
    outlines: np.ndarray,
    pose: Pose,
    kinematics: Kinematics,
    shape: tuple[int, int],
    hidden: float,
    light_from: float | None,
) -> np.ndarray:
    """Pixels (frame, rows, columns) to leave out of frames with `outlines` (px).

    What lies up to `hidden` (m) from the root along the finger at rest, and the shade of a light
    from `light_from` (rad); None: from all sides.
    """
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
    along = kinematics.shape("tip_direction", float(kinematics.law(kinematics.time[0])))
    away = (pose.to_tank(np.stack([x, y], axis=-1)) - np.asarray(kinematics.root)) @ along
    held = np.broadcast_to((away < hidden) & (hidden > 0), (len(outlines), rows, columns))
    return held if light_from is None else held | shaded_parts(outlines, light_from, shape)


def dense(outline: np.ndarray, per_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a closed outline (px), at least `per_px` in a pixel, and the corner before each."""
    after = np.roll(outline, -1, axis=0)
    pieces = np.maximum(np.ceil(per_px * np.hypot(*(after - outline).T)).astype(int), 1)
    of = np.repeat(np.arange(len(outline)), pieces)
    share = np.concatenate([np.arange(n) / n for n in pieces])[:, None]
    return (1 - share) * outline[of] + share * after[of], of
