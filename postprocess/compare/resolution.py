"""What a recording can resolve, and how far that widens the limits of an agreement."""

from dataclasses import dataclass

import pandas as pd

from pipeline.scene.scene import Scene
from postprocess.compare.findings import Finding
from postprocess.words import three_digits

_SEEN_PX = 5.0  # largest displacement of the recordings that the limits are made for
_VECTORS = {"velocity_rms_difference", "velocity_correlation"}  # what needs no vortex
SCALED = _VECTORS | {"circulation_difference", "centre_distance", "centre_distance_relative"}


@dataclass(frozen=True)
class Resolution:
    """Largest displacement (px), the vortex' radius in interrogation windows, and a cure.

    PIV errs by about 0.1 px, so the limits of a recording that moves less are as much wider; those
    of a vortex also where half a window is larger than it. `cure`: what to set, "" where nothing.
    """

    displacement_px: float
    core_windows: float
    cure: str

    def factor(self, quantity: str) -> float:
        """How much wider the limit of a quantity is, at least 1."""
        small = _SEEN_PX / self.displacement_px
        return max(1.0, small if quantity in _VECTORS else max(small, 0.5 / self.core_windows))


def resolution(scene: Scene, vortices: pd.DataFrame, speed: float) -> Resolution:
    """Of a scene's recording; `vortices`: rows of the tip's, `speed`: the peak tip speed (m/s)."""
    camera = scene.camera
    rate, scale = camera.frame_rate_hz or scene.sheet.rate_hz, camera.pixel
    moved = speed / rate / scale
    core = float(vortices["radius"].median()) if len(vortices) else float("inf")
    windows = core / (scene.piv.window * scale)
    cures = []
    if moved < _SEEN_PX:
        cures.append(
            f"the camera sees at most {moved:.1f} px of displacement; set camera.frame_rate_hz ="
            f" {three_digits(rate * moved / _SEEN_PX)} for {_SEEN_PX:g} px, or a smaller"
            " camera.scale_mm_per_px"
        )
    if windows < 0.5:
        cures.append(
            f"the vortex, {core * 1e3:.1f} mm in radius, is smaller than half of an"
            f" interrogation window; set piv.window = {max(8, int(core / scale / 4) * 8)}, or a"
            " smaller camera.scale_mm_per_px"
        )
    return Resolution(moved, windows, "; ".join(cures))


def widened(finding: Finding, by: float) -> Finding:
    """An agreement with its limit `by` times as wide; of a correlation, as far from 1."""
    limit = finding.value
    assert isinstance(limit, float)
    wide = limit * by if finding.comparison == "<=" else 1.0 - (1.0 - limit) * by
    return finding.model_copy(update={"value": wide})
