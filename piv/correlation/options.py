"""Settings of the correlation, shared by pairs, multi-frame sets, ensembles and the command line."""

from __future__ import annotations

from dataclasses import dataclass

PRESETS = {  # Newton steps at half and at full resolution; how often the frequency weights are measured
    "fast": (2, 2, 1),
    "balanced": (3, 3, 1),
    "accurate": (4, 6, 2),
}
METHODS = ("correlation", "optical_flow")


@dataclass(frozen=True)
class Options:
    """How images are correlated; lengths in px.

    window: side of the square window with the same noise, its weight is a Gaussian of σ = window/4; spacing:
    distance of the vectors; preset: fast, balanced or accurate; passes: Newton steps at full resolution (0: the
    preset's); smoothing: damp what is no stronger than noise (piv.validation.denoise); search: side of the first windows,
    displacements up to 3/8 of it are found; epsilon, threshold: of the normalised median test (px, multiples);
    min_correlation: below it a vector is an outlier, and below twice as much where most of its neighbours are;
    max_std: a vector whose standard uncertainty (px) is above it in a component is an outlier;
    max_masked: share of a window's weight that may be masked;
    replace: put the neighbours' mean in place of outliers and flag it; method: correlation, or optical_flow
    (dense optical flow: fast, coarse, without uncertainty).
    """

    window: float = 32.0
    spacing: int = 8
    preset: str = "balanced"
    passes: int = 0
    smoothing: bool = True
    search: int = 128
    epsilon: float = 0.2
    threshold: float = 3.0
    min_correlation: float = 0.2
    max_std: float = 0.3  # one error in ten is then above half a pixel
    max_masked: float = 0.5
    replace: bool = False
    method: str = "correlation"

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise ValueError(f"preset must be one of {', '.join(PRESETS)}, got {self.preset!r}")
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        if not 8 <= self.window <= 512:
            raise ValueError(f"window must be between 8 and 512 px, got {self.window}")
        if not (self.spacing >= 1 and float(self.spacing).is_integer()):
            raise ValueError(f"spacing must be a whole number of px, at least 1, got {self.spacing}")
        if self.search < 16:
            raise ValueError(f"search must be at least 16 px, got {self.search}")
        if not 0 <= self.passes <= 50:
            raise ValueError(f"passes must be between 0 and 50, got {self.passes}")
        for name in ("epsilon", "threshold", "max_std"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.max_masked < 1 or not -1 <= self.min_correlation < 1:
            raise ValueError("max_masked must be within 0 … 1 and min_correlation within -1 … 1")

    @property
    def sigma(self) -> float:
        """Standard deviation of the window's Gaussian weight, px."""
        return self.window / 4

    @property
    def half_steps(self) -> int:
        """Newton steps at half resolution."""
        return PRESETS[self.preset][0]

    @property
    def full_steps(self) -> int:
        """Newton steps at full resolution."""
        return self.passes or PRESETS[self.preset][1]

    @property
    def spectra(self) -> int:
        """Number of times that the frequency weights are measured."""
        return PRESETS[self.preset][2]
