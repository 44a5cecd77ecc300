"""The measurement: laser sheet, camera, PIV and vortices."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pipeline.scene.section import Count, NotNegative, Number, Pair, Positive, Section, Whole
from piv.correlation.options import WINDOW, Options

_MOST_PIXELS = 16_384  # along a side of the camera's picture


class Sheet(Section):
    """The laser sheet: where it is, how often and how finely it is sampled."""

    z: Number = 0.0
    """Of the light sheet [m]"""
    rate_hz: Positive = 500.0
    """Pictures of the sheet in a second [Hz]"""
    every: Annotated[Count, Field(le=10_000)] | None = None
    """Take one picture of so many; absent: each, and with PIV=0 as many as PIV has fields"""
    spacing: Positive = 0.0005
    """Of the grid that the flow is sampled on; 4 px where camera.centre is absent [m]"""
    margin: Positive = 0.006
    """Beyond the camera's view, so that particles that enter it come from somewhere [m]"""
    thickness: Annotated[Number, Field(ge=1e-4, le=0.05)] = 0.0015
    """Full width at 1/e² [m]"""


class Camera(Section):
    """The laboratory's camera and seeding."""

    columns: Annotated[Whole, Field(ge=64, le=_MOST_PIXELS)] = 1280
    """Of the picture; without `centre` they hold where vortices go, unless they are given [px]"""
    rows: Annotated[Whole, Field(ge=64, le=_MOST_PIXELS)] = 1024
    """Of the picture; as columns [px]"""
    scale_mm_per_px: Positive = 0.125
    """Size of a pixel in the sheet; it follows, too, where neither is given [mm/px]"""
    centre: Pair | None = None
    """Middle of the picture in the tank frame; absent: it follows from the tip's path [m]"""
    bits: Literal[8, 10, 12, 16] = 8
    """Of a grey value"""
    density_ppp: Annotated[Positive, Field(le=0.5)] = 0.04
    """Particles in a pixel; beyond 0.5 pictures are one grey [1/px²]"""
    particle_diameter_px: Annotated[Positive, Field(ge=0.5, le=20)] = 2.5
    """Of a particle's picture, at 1/e² [px]"""
    background: NotNegative = 8.0
    """Of the dark picture [grey levels]"""
    read_noise: NotNegative = 2.0
    """Standard deviation [grey levels]"""
    electrons_per_level: Annotated[NotNegative, Field(le=1e6)] = 50.0
    """Which make the shot noise; 0: none [1/grey level]"""
    shadow: Annotated[NotNegative, Field(le=1)] = 0.0
    """Share of the light that is taken away behind the finger, 0 to 1 [1]"""
    frame_rate_hz: Positive | None = None
    """Absent: that of the sheet [Hz]"""
    pairs_every: Annotated[Count, Field(le=10_000)] = 1
    """1: every frame is taken; n: two frames in a row out of every n"""
    truth: bool = False
    """Write the exact displacements beside the recording: it takes a third of the time"""
    seed: Annotated[Whole, Field(ge=0, lt=2**32)] = 2017
    """Of the particles and the noise"""

    @property
    def pixel(self) -> float:
        """Size of a pixel in the sheet, m."""
        return self.scale_mm_per_px * 1e-3

    def origin_px(self) -> Pair:
        """The tank frame's origin, px right and up from the centre of the bottom left pixel."""
        middle = 0.5 * (self.columns - 1), 0.5 * (self.rows - 1)
        assert self.centre is not None
        return middle[0] - self.centre[0] / self.pixel, middle[1] - self.centre[1] / self.pixel


class Piv(Section):
    """How the recording is correlated."""

    window: Annotated[Whole, Field(ge=WINDOW[0], le=WINDOW[1])] = int(Options.window)
    """Side of the last windows [px]"""
    spacing: Annotated[Count, Field(le=512)] = Options.spacing
    """Between vectors [px]"""
    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    """How much is done for accuracy"""
    every: Annotated[Count, Field(le=10_000)] = 1
    """Correlate one pair of so many"""
    frames: Annotated[Whole, Field(ge=2, le=99)] = 2
    """Frames of a set: 2, or 3, 5, … of multi-frame sets"""

    @model_validator(mode="after")
    def _middle_frame(self) -> "Piv":
        if self.frames > 2 and self.frames % 2 == 0:
            raise ValueError(
                f"frames = {self.frames} has no frame in the middle; give 2, or {self.frames + 1}"
            )
        return self


class Vortices(Section):
    """Which vortices count, and how they are fitted."""

    min_circulation: Annotated[Positive, Field(le=1e3)] = 2e-4
    """Least size that counts; 1 % of tip speed × length where camera.centre is absent [m²/s]"""
    scale: Positive | None = None
    """Smoothing length at which they are sought; absent: a sixth of the tip's width [m]"""
    weights: Literal["equal", "uncertainty"] = "equal"
    """Of the vectors in that fit"""


def frames_apart(camera: Camera, piv: Piv) -> int:
    """How many frames after a vector field the next one is."""
    return piv.every * camera.pairs_every


def render_settings(camera: Camera, sheet: Sheet) -> dict[str, Any]:
    """The settings of `piv render`, by the names of its flags."""
    return {
        "width_px": camera.columns,
        "height_px": camera.rows,
        "scale_mm_per_px": camera.scale_mm_per_px,
        "origin_px": list(camera.origin_px()),
        "frame_rate_hz": camera.frame_rate_hz or sheet.rate_hz,
        "pairs_every": camera.pairs_every,
        "bits": camera.bits,
        "background": camera.background,
        "read_noise": camera.read_noise,
        "electrons_per_level": camera.electrons_per_level,
        "density_ppp": camera.density_ppp,
        "diameter_px": camera.particle_diameter_px,
        "sheet_thickness": sheet.thickness,
        "shadow": camera.shadow,
        "truth": camera.truth,
        "seed": camera.seed,
    }


def piv_settings(piv: Piv, camera: Camera) -> dict[str, Any]:
    """The settings of `piv correlate`: pictures taken in pairs are correlated in pairs."""
    paired = {"pairing": "1-2,3-4"} if camera.pairs_every > 1 else {}
    return piv.model_dump(mode="json") | paired
