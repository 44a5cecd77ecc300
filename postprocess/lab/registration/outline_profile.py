"""Particles along the fitted outline: how many there are in bands inside and outside of it, part by part, against the water's own.

A fit that explains the silhouette leaves none inside and the water's own outside. Shadows, reflections and holders show as parts
of the outline where that is not so.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.fit_outline import outline_table
from postprocess.lab.registration.silhouette import WaterLikelihood, particles

BANDS = np.array(
    [-9.0, -1.5, 1.5, 6.0, 12.0, 30.0]
)  # px from the outline, outside positive; the last is the water's own
INSIDE, EDGE, NEAR, NEXT, FAR = range(len(BANDS) - 1)
LENGTHS = 4  # parts that a side is cut in from root to tip
ENDS = 0.04  # of the finger's length: how far root and tip reach
SIDES = ("ventral", "dorsal")
NAMES = ("root", "tip", *(f"{side} side" for side in SIDES for _ in range(LENGTHS)))
SURE = 4.5  # standard deviations of a count: parts and bands make sixty of them
ON_EDGE = (
    1.25  # of the water's own particles per area on and beside the outline: more are a reflection's
)
GRID_PX = 2  # pixels in each direction that a point of the area stands for


@dataclass(frozen=True)
class OutlineProfile:
    """Particles, their light (sum of grey levels above the body's) and area (px²) by frame, part of `NAMES` and band of `BANDS`,
    (frame, part, band); outlines (frame, point, 2) in px, y up, and the part that each of their points belongs to."""

    count: np.ndarray
    light: np.ndarray
    area: np.ndarray
    outlines: np.ndarray
    part: np.ndarray

    def rate(self, frames: np.ndarray | slice = slice(None)) -> float:
        """Particles per px² in the water around the finger."""
        return float(
            self.count[frames][..., FAR].sum() / max(self.area[frames][..., FAR].sum(), 1.0)
        )


def parts_of(kinematics: Kinematics, outline: np.ndarray) -> np.ndarray:
    """The part of `NAMES` of each point of the outline (point, 2; m) at rest."""
    start = float(kinematics.law(kinematics.time[0]))
    along, dorsal = (
        kinematics.shape("tip_direction", start),
        kinematics.shape("dorsal_direction", start),
    )
    from_root = outline - np.asarray(kinematics.root)
    reached = from_root @ along / kinematics.length
    across = from_root @ dorsal
    side = (across > 0.5 * (across.min() + across.max())).astype(int)
    step = np.clip((reached - ENDS) / (1 - 2 * ENDS) * LENGTHS, 0, LENGTHS - 1).astype(int)
    part = 2 + LENGTHS * side + step
    return np.where(reached < ENDS, 0, np.where(reached > 1 - ENDS, 1, part))


# frames, their evidence, and where the finger is in them: the first arguments of `outline_profile`
Seen = tuple[list[np.ndarray], WaterLikelihood, Kinematics, Pose, np.ndarray, np.ndarray]


def outline_profile(
    images: list[np.ndarray],
    evidence: WaterLikelihood,
    kinematics: Kinematics,
    pose: Pose,
    pressures: np.ndarray,
    nuisance: np.ndarray,
    blind: np.ndarray | None = None,
) -> OutlineProfile:
    """The profile of frames (row 0 at the top) with the finger at `pressures` (frame,) Pa and the outline changed by `nuisance` (4
    of `files.NUISANCE`); `blind` (frame, rows, columns): pixels that tell nothing."""
    table, outlines, _ = outline_table(kinematics)
    part = parts_of(
        kinematics, outlines[np.argmin(np.abs(table - kinematics.law(kinematics.time[0])))]
    )
    shape = (len(images), len(NAMES), len(BANDS) - 1)
    count, light, area = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    drawn = seen_outlines(kinematics, pose, pressures, nuisance)
    for f, (image, outline) in enumerate(zip(images, drawn, strict=True)):
        row, column = particles(image, evidence.threshold)
        spots = np.column_stack([column, image.shape[0] - 1 - row])
        low, high = outline.min(axis=0) - BANDS[-1], outline.max(axis=0) + BANDS[-1]
        last = np.array(image.shape[::-1]) - 2.0  # no particle is found on the border
        low, high = np.maximum(low, 1.0), np.minimum(high, last)
        axes = [np.arange(low[i], high[i], GRID_PX) for i in (0, 1)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        spots = spots[((spots >= low) & (spots <= high)).all(axis=1)]
        i, j = np.rint(spots).astype(int).T
        grey = image[image.shape[0] - 1 - j, i] - evidence.body_level
        nearest = _Nearest(outline, part)
        of_spots = np.column_stack([np.ones(len(spots)), grey])
        of_grid = np.full((len(grid), 1), float(GRID_PX**2))
        for points, values, totals in ((spots, of_spots, (count, light)), (grid, of_grid, (area,))):
            if blind is not None:
                i, j = np.rint(points).astype(int).T
                seen = ~blind[f, image.shape[0] - 1 - j, i]
                points, values = points[seen], values[seen]
            near, of, distance = nearest(points)
            band = np.digitize(distance, BANDS) - 1
            ok = (band >= 0) & (band < len(BANDS) - 1)
            for total, each in zip(totals, values[near][ok].T, strict=True):
                np.add.at(total[f], (of[ok], band[ok]), each)
    return OutlineProfile(count, light, area, drawn, part)


def seen_outlines(
    kinematics: Kinematics, pose: Pose, pressures: np.ndarray, nuisance: np.ndarray
) -> np.ndarray:
    """Outlines (frame, point, 2) px of the finger at `pressures` (frame,) Pa as the fit draws them."""
    table, outlines, normals = outline_table(kinematics)
    drawn = []
    for pressure in pressures:
        at = np.clip((pressure - table[0]) / (table[1] - table[0]), 0, table.size - 1.001)
        k, w = int(at), at - int(at)
        outward = (1 - w) * normals[k] + w * normals[k + 1]
        drawn.append(
            seen_outline(pose, (1 - w) * outlines[k] + w * outlines[k + 1], outward, nuisance)
        )
    return np.array(drawn)


def seen_outline(
    pose: Pose, outline: np.ndarray, normals: np.ndarray, nuisance: np.ndarray
) -> np.ndarray:
    """The outline (point, 2) px that the fit draws; `normals` (point, 3) as of `outline_table`, `nuisance` of `files.NUISANCE`."""
    edge, lateral, *perspective = nuisance
    from_root = outline - pose.anchor
    near = from_root / (1 + from_root @ np.asarray(perspective))[:, None] + pose.anchor
    out = (edge + lateral * normals[:, 2:]) * normals[:, :2]
    return pose.to_px(near) + out @ pose.rotation.T


def independent_share(profile: OutlineProfile) -> float:
    """Share of the pictures that bring news of particles beside the finger, from how alike the counts of successive ones are."""
    count, area = (
        profile.count[..., NEAR],
        profile.area[..., NEAR],
    )  # the nearer, the longer they stay
    mean = count.sum(axis=0) / np.maximum(area.sum(axis=0), 1.0) * area
    z = (count - mean) / np.sqrt(np.maximum(mean, 1.0))
    near = float(np.sum(z[1:] * z[:-1]) / max(np.sum(z**2), 1e-9)) if len(z) > 2 else 0.0
    near = float(np.clip(near, 0.0, 0.95))
    return (1 - near) / (1 + near)


def bright_side(profile: OutlineProfile) -> int:
    """The side along which a reflection adds particles: 1 dorsal, -1 ventral, 0 none; where both do, none can be left out."""
    share, rate = independent_share(profile), profile.rate()
    found = []
    for side, name in ((-1, "ventral"), (1, "dorsal")):
        parts = [k for k, other in enumerate(NAMES) if other.startswith(name)]
        count = profile.count[:, parts][..., [EDGE, NEAR]].sum(axis=(0, 1))
        water = rate * profile.area[:, parts][..., [EDGE, NEAR]].sum(axis=(0, 1))
        sure = count - water > SURE * np.sqrt(np.maximum(water, 1.0) / share)
        if (sure & (count > ON_EDGE * water)).any():
            found.append(side)
    return found[0] if len(found) == 1 else 0


class _Nearest:
    """Of the points that are near the outline (point, 2) px: which they are, its part nearest to each, the distance, outside positive."""

    def __init__(self, outline: np.ndarray, part: np.ndarray) -> None:
        after = np.roll(outline, -1, axis=0)
        pieces = np.maximum(np.ceil(np.hypot(*(after - outline).T)).astype(int), 1)
        of = np.repeat(np.arange(len(outline)), pieces)
        share = np.concatenate([np.arange(n) / n for n in pieces])[:, None]
        self._tree = cKDTree((1 - share) * outline[of] + share * after[of])
        self._part = part[of]
        self._corners = outline.astype(np.float32).reshape(-1, 1, 2)

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        away, index = self._tree.query(points, distance_upper_bound=BANDS[-1])
        near = np.isfinite(away)
        away, points = away[near], points[near]
        inside = [
            cv2.pointPolygonTest(self._corners, (float(x), float(y)), False) > 0 for x, y in points
        ]
        return near, self._part[index[near]], np.where(inside, -away, away)
