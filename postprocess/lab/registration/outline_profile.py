"""Particles in bands along the fitted outline, part by part, against the water's own density.

A sound fit has none inside and water outside; shadows, reflections and holders have not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.blind import dense
from postprocess.lab.registration.fit_outline import Shapes
from postprocess.lab.registration.silhouette import WaterLikelihood, particles

# px from the outline, outside positive; the last band is the water's own
BANDS = np.array([-9.0, -1.5, 1.5, 6.0, 12.0, 30.0])
INSIDE, EDGE, NEAR, _, FAR = range(len(BANDS) - 1)
LENGTHS = 4  # parts that a side is cut in from root to tip
ENDS = 0.04  # of the finger's length: how far root and tip reach
SIDES = ("ventral", "dorsal")
NAMES = ("root", "tip", *(f"{side} side" for side in SIDES for _ in range(LENGTHS)))
GRID_PX = 2  # pixels in each direction that a point of the area stands for


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


def _parts_of(kinematics: Kinematics, outline: np.ndarray) -> np.ndarray:
    """The part of `NAMES` of each point of the outline (point, 2; m) at rest."""
    start = float(kinematics.law(kinematics.time[0]))
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
    pose: Pose,
    pressures: np.ndarray,
    growth: float,
    blind: np.ndarray | None = None,
) -> OutlineProfile:
    """The profile of frames (row 0 at the top) with the finger at `pressures` (frame,) Pa.

    `growth` of the outline (px); `blind` (frame, rows, columns): pixels to leave out.
    """
    part = _parts_of(shapes.kinematics, shapes.outlines[shapes.rest])
    count, area = np.zeros((2, len(images), len(NAMES), len(BANDS) - 1))
    drawn = _seen_outlines(shapes, pose, pressures, growth)
    for f, (image, outline) in enumerate(zip(images, drawn, strict=True)):
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
            if blind is not None:
                i, j = np.rint(points).astype(int).T
                points = points[~blind[f, image.shape[0] - 1 - j, i]]
            away, nearest = tree.query(points, distance_upper_bound=BANDS[-1])
            near = np.isfinite(away)
            within = shapely.contains_xy(body, *points[near].T)
            distance = np.where(within, -away[near], away[near])
            band = np.digitize(distance, BANDS) - 1
            ok = (band >= 0) & (band < len(BANDS) - 1)
            np.add.at(total[f], (part[corner[nearest[near]]][ok], band[ok]), each)
    return OutlineProfile(count, area, drawn, part)


def _seen_outlines(shapes: Shapes, pose: Pose, pressures: np.ndarray, growth: float) -> np.ndarray:
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
