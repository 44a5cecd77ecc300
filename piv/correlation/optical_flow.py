"""Optical flow by dense inverse search (DIS, OpenCV), averaged over the area of each vector."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import xarray as xr

from piv.correlation.options import Options, grid
from piv.correlation.pair_images import check_images, check_masks
from piv.correlation.passes import vector_dataset


def optical_flow(a: Any, b: Any, mask: Any, options: Options) -> xr.Dataset:
    """Displacement as of `correlate_pair`, by optical flow: fast, coarse, without uncertainty.

    Source: Kroeger et al. 2016; OpenCV's medium preset.
    """
    images = check_images([a, b], options.window)
    seen = [m is None or ~m for m in check_masks(mask, 2, images[0].shape)]
    both = np.broadcast_to(seen[0], images[0].shape) & np.broadcast_to(seen[1], images[0].shape)
    top = max(float(np.percentile(i[np.isfinite(i)], 99.9)) for i in images)
    if not top > 0:
        raise ValueError("both images are black; there is nothing to correlate")
    grey = [np.clip(np.nan_to_num(i) * (255 / top), 0, 255).astype(np.uint8) for i in images]
    for image in grey:
        image[~both] = 0
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
        grey[0], grey[1], np.zeros((*grey[0].shape, 2), np.float32)
    )
    rows, columns = images[0].shape
    x, y = grid(columns, options.spacing), grid(rows, options.spacing)
    side = max(int(options.spacing), 3)
    share = cv2.blur(both.astype(np.float32), (side, side))
    i, j = np.rint(x).astype(int), np.rint(y).astype(int)
    at = np.ix_(j, i)
    mean = [
        cv2.blur(flow[..., k] * both, (side, side))[at] / np.maximum(share[at], 1e-6)
        for k in range(2)
    ]
    valid = share[at] > 1 - options.max_masked
    u, v = np.where(valid, mean[0], np.nan), np.where(valid, -mean[1], np.nan)
    unknown = np.full(valid.shape, np.nan)
    fields = {
        "u": u,
        "v": v,
        "valid": valid,
        "flag": np.where(valid, 0, 2),
        "u_std": unknown,
        "v_std": unknown,
    }
    return vector_dataset(fields, x, y, rows, options)
