"""What a synthetic recording is taken with: camera, particles and light sheet."""

from dataclasses import dataclass
from typing import Annotated

# frames from one that is taken to the next over which particles are carried: the most of the
# shipped scenes. Over more they are drawn anew: that is cheaper, and PIV sees pairs alone.
CARRIED = 4


@dataclass(frozen=True)
class Camera:
    """Sensor, magnification, frame rate and noise.

    origin_px: tank origin, px right and up from the centre of the bottom left pixel; None: the
    plane's middle is the picture's.
    """

    width_px: Annotated[int, "picture width"] = 1280
    height_px: Annotated[int, "picture height"] = 1024
    scale_mm_per_px: Annotated[float, "mm per pixel"] = 0.125
    origin_px: tuple[float, float] | None = None
    frame_rate_hz: Annotated[float, "frames per second"] = 500.0
    bits: Annotated[int, "grey levels are 2**bits"] = 8
    background: Annotated[float, "grey level of the background"] = 8.0
    read_noise: Annotated[float, "standard deviation of the read noise, grey levels"] = 2.0
    electrons_per_level: Annotated[float, "electrons per grey level, for shot noise; 0 = none"] = (
        50.0
    )
    pairs_every: Annotated[
        int,
        "take a pair of frames out of every so many (correlate with --pairing 1-2,3-4); 1 = every "
        "frame",
    ] = 1

    def __post_init__(self) -> None:
        if self.pairs_every < 1:
            raise ValueError(f"the camera's pairs_every must be at least 1, got {self.pairs_every}")
        for name in ("width_px", "height_px", "scale_mm_per_px", "frame_rate_hz"):
            if not getattr(self, name) > 0:
                raise ValueError(f"the camera's {name} must be positive, got {getattr(self, name)}")
        if not 1 <= self.bits <= 16:
            raise ValueError(f"the camera's bits must be 1 to 16, got {self.bits}")

    @property
    def pixel(self) -> float:
        """Size of a pixel in the sheet, m."""
        return self.scale_mm_per_px * 1e-3


@dataclass(frozen=True)
class Seeding:
    """Particles and light sheet; a particle scatters with the square of its diameter."""

    density_ppp: Annotated[float, "particles per pixel within the sheet"] = 0.04
    diameter_px: Annotated[float, "particle image diameter at 1/e^2"] = 2.5
    diameter_std_px: Annotated[float, "its standard deviation"] = 0.25
    sheet_thickness: Annotated[float, "thickness of the light sheet at 1/e^2, m"] = 1.5e-3
    peak: Annotated[
        float, "peak of a mean particle in the middle of the sheet, part of the grey scale"
    ] = 0.7
    shadow: Annotated[float, "part of the light from below that the body takes away, 0 to 1"] = 0.0

    def __post_init__(self) -> None:
        for name in ("density_ppp", "diameter_px", "sheet_thickness", "peak"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"the seeding's {name} must be positive, got {getattr(self, name)}"
                )
        if not 0 <= self.shadow <= 1:
            raise ValueError(f"the seeding's shadow must be between 0 and 1, got {self.shadow}")
