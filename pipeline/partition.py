"""Cutting the mesh for several ranks: whole columns only, halves of equal load by position."""

from __future__ import annotations

import numpy as np


def partition_columns(centres: np.ndarray, load: np.ndarray, ranks: int) -> np.ndarray:
    """Rank of each column: recursive bisection of `centres` (column, 2) with equal `load` (column,) per rank."""
    rank = np.zeros(len(centres), int)
    _bisect(centres, load, np.arange(len(centres)), 0, ranks, rank)
    return rank


def _bisect(centres: np.ndarray, load: np.ndarray, members: np.ndarray, first: int, ranks: int,
            rank: np.ndarray) -> None:  # fmt: skip
    if ranks == 1:
        rank[members] = first
        return
    lower = ranks // 2
    # Across the direction in which the cells, not the tank, spread more: short cuts, few shared faces.
    axis = int(np.argmax(np.average((centres[members] - np.median(centres[members], 0)) ** 2, axis=0)))
    ordered = members[np.argsort(centres[members, axis], kind="stable")]
    share = np.cumsum(load[ordered])
    cut = int(np.searchsorted(share, share[-1] * lower / ranks))
    _bisect(centres, load, ordered[:cut], first, lower, rank)
    _bisect(centres, load, ordered[cut:], first + lower, ranks - lower, rank)
