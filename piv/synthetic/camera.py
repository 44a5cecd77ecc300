"""What a synthetic recording is taken with: camera, particles and light sheet."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Camera:
    """What takes the pictures: sensor, magnification, frame rate and noise (grey levels unless said).

    `origin_px` is the place of the tank frame's origin, px right of the left column's and up from the bottom row's
    centre; None puts the plane's middle in the picture's middle. `pairs_every`: 1 takes every frame; n > 1 takes pairs,
    two frames in a row out of every n, as a double-frame camera does.
    """

    width_px: int = 1280
    height_px: int = 1024
    scale_m_per_px: float = 1.25e-4
    origin_px: tuple[float, float] | None = None
    frame_rate_hz: float = 500.0
    bits: int = 8
    background: float = 8.0
    read_noise: float = 2.0
    electrons_per_level: float = 50.0
    pairs_every: int = 1

    def __post_init__(self) -> None:
        if self.pairs_every < 1:
            raise ValueError(f"the camera's pairs_every must be at least 1, got {self.pairs_every}")
        for name in ("width_px", "height_px", "scale_m_per_px", "frame_rate_hz"):
            if not getattr(self, name) > 0:
                raise ValueError(f"the camera's {name} must be positive, got {getattr(self, name)}")
        if not 1 <= self.bits <= 16:
            raise ValueError(f"the camera's bits must be 1 to 16, got {self.bits}")


@dataclass(frozen=True)
class Seeding:
    """Particles and light. `density_ppp`: particles per pixel within the sheet's 1/e^2 thickness (m).

    `diameter_px` is the full width at 1/e^2 of a particle's image, `peak` the mean particle's peak in the middle of
    the sheet as a part of the grey scale; a particle scatters with the square of its diameter.
    """

    density_ppp: float = 0.04
    diameter_px: float = 2.5
    diameter_std_px: float = 0.25
    sheet_thickness: float = 1.5e-3
    peak: float = 0.7
    shadow: float = 0.0
    bead_diameter: float = 20e-6

    def __post_init__(self) -> None:
        for name in ("density_ppp", "diameter_px", "sheet_thickness", "peak"):
            if not getattr(self, name) > 0:
                raise ValueError(f"the seeding's {name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.shadow <= 1:
            raise ValueError(f"the seeding's shadow must be between 0 and 1, got {self.shadow}")
