"""What is made of the flow: the laser sheet, the camera's pictures, their PIV, and what counts as a vortex."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from pipeline.scene.section import Pair, Positive, Section
from piv.correlation.options import Options


class Sheet(Section):
    """The laser sheet: where it is, how often and how finely it is sampled."""

    z: float = 0.0
    rate_hz: Positive = 500.0
    spacing: Positive = 0.0005
    margin: Positive = 0.006  # beyond the camera's view, so that particles that enter it come from somewhere
    thickness: Positive = 0.0015


class Camera(Section):
    """The laboratory's camera and seeding; `centre` is the middle of the picture in the tank frame."""

    columns: Annotated[int, Field(ge=64)] = 1280
    rows: Annotated[int, Field(ge=64)] = 1024
    scale_mm_per_px: Positive = 0.125
    centre: Pair
    bits: Literal[8, 10, 12, 16] = 8
    density_ppp: Positive = 0.04
    particle_diameter_px: Positive = 2.5
    background: Annotated[float, Field(ge=0)] = 8.0
    read_noise: Annotated[float, Field(ge=0)] = 2.0
    electrons_per_level: Annotated[float, Field(ge=0)] = 50.0
    shadow: Annotated[float, Field(ge=0, le=1)] = 0.0
    frame_rate_hz: Positive | None = None  # that of the sheet where not given
    pairs_every: Annotated[int, Field(ge=1)] = 1  # 1: every frame; n: two frames in a row out of every n
    truth: bool = True  # the exact displacements beside the recording: nothing here reads them, and they take a third of the time
    seed: int = 2017

    def origin_px(self) -> Pair:
        """The tank frame's origin, px right and up from the centre of the bottom left pixel."""
        scale = self.scale_mm_per_px * 1e-3
        middle = 0.5 * (self.columns - 1), 0.5 * (self.rows - 1)
        return middle[0] - self.centre[0] / scale, middle[1] - self.centre[1] / scale


class Piv(Section):
    """How the recording is correlated."""

    window: Annotated[int, Field(ge=8)] = int(Options.window)
    spacing: Annotated[int, Field(ge=1)] = Options.spacing
    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    every: Annotated[int, Field(ge=1)] = 1
    frames: Annotated[int, Field(ge=2)] = 2  # 3, 5, …: multi-frame sets


class Vortices(Section):
    """What counts as a vortex."""

    min_circulation: Positive = 2e-4
    stencil_radius: Positive = 0.003
    weights: Literal["equal", "uncertainty"] = "equal"


def render_settings(camera: Camera, sheet: Sheet) -> dict[str, Any]:
    """The settings of `piv render`, by the names of its flags."""
    return {
        "width_px": camera.columns,
        "height_px": camera.rows,
        "scale_m_per_px": camera.scale_mm_per_px * 1e-3,
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
