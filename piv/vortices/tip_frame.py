"""Where a vortex is as seen from a finger's tip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

_TIP_VARIABLES = ("tip", "tip_direction", "dorsal_direction")


class _TipPlace(NamedTuple):
    """Place in the nearest tip's frame: finger, side, distance in tip widths, components (m)."""

    finger: int
    side: str
    tip_distance: float
    along_tip: float
    across_tip: float


def place_at_tip(x: float, y: float, plane: xr.Dataset) -> _TipPlace | None:
    """Place of (x, y) in one plane's tip frame; None where the plane knows no finger.

    `across_tip` is positive on the dorsal side, which also gives `side`; `along_tip` is positive
    beyond the tip. The distance is NaN where the attribute `tip_width` is absent.
    """
    if not all(name in plane for name in _TIP_VARIABLES):
        return None
    tips, along, dorsal = (plane[name].values for name in _TIP_VARIABLES)
    away = np.array([x, y]) - tips
    far = np.hypot(away[:, 0], away[:, 1])
    if not np.isfinite(far).any():
        return None
    k = int(np.nanargmin(far))
    a, d = float(away[k] @ along[k]), float(away[k] @ dorsal[k])
    width = float(plane.attrs.get("tip_width", np.nan))
    return _TipPlace(k, "dorsal" if d > 0 else "ventral", float(far[k]) / width, a, d)
