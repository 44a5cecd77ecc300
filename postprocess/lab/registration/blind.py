"""Pixels that are left out of the fit: behind a holder, or in the finger's shadow.

Nothing can be fitted to the shaded side; the lit side and the known thickness place the finger.
"""

from __future__ import annotations

import numpy as np

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.pose import Pose

# of the finger's depth along the light: what is deeper is as dark as the shadow behind it
UNSEEN_SIDE = 0.5


def _hidden_part(
    pose: Pose, kinematics: Kinematics, hidden: float, shape: tuple[int, int]
) -> np.ndarray:
    """Pixels (rows, columns) up to `hidden` (m) from the root along the finger at rest."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns), rows - 1 - np.arange(rows))
    along = kinematics.shape("tip_direction", float(kinematics.law(kinematics.time[0])))
    return (pose.to_tank(np.stack([x, y], axis=-1)) - np.asarray(kinematics.root)) @ along < hidden


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
) -> np.ndarray | None:
    """Pixels (frame, rows, columns) to leave out of frames with `outlines` (px); None: none.

    `hidden` (m): of the finger from its root on; `light_from` (rad): None: from all sides.
    """
    dark = _hidden_part(pose, kinematics, hidden, shape) if hidden else None
    if light_from is None:
        return None if dark is None else np.broadcast_to(dark, (len(outlines), *shape))
    shaded = shaded_parts(outlines, light_from, shape)
    return shaded if dark is None else shaded | dark


def dense(outline: np.ndarray, per_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a closed outline (px), at least `per_px` in a pixel, and the corner before each."""
    after = np.roll(outline, -1, axis=0)
    pieces = np.maximum(np.ceil(per_px * np.hypot(*(after - outline).T)).astype(int), 1)
    of = np.repeat(np.arange(len(outline)), pieces)
    share = np.concatenate([np.arange(n) / n for n in pieces])[:, None]
    return (1 - share) * outline[of] + share * after[of], of
