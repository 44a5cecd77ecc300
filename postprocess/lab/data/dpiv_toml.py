"""dpiv.toml: what a laboratory states of its recording or vectors (docs/comparison.md)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from fileio.key_reference import complaints
from fileio.provenance import check_version
from fileio.toml_text import read_toml

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
NAME = "dpiv.toml"
VERSION = 3
CAMERA = "columns rows density_ppp diameter_px background read_noise peak scale_mm_per_px"
HINTS = {
    "files": 'files = "frames/*.tif", a path beside dpiv.toml, or a list of them',
    "frame_rate_hz": "frame_rate_hz, the pictures (of pictures in pairs: the pairs) per second",
    "start": "start = { at_s = …, std_s = … }, the time of the first picture on the simulation's"
    ' clock, or start = "from motion"',
    "scale": "scale = { scale_mm_per_px = …, std_percent = … },"
    ' { calibration = "file.json", std_percent = … } or { from_finger = true }',
    "axes": 'axes = { y = "up" or "down", x = "right" or "left", root_px = [x, y] },'
    " with the position of the root's middle in px, y counted as stated",
    "finger_geometry": 'finger_geometry = "measured" (the scene\'s states are of this finger) or'
    ' "nominal" (they are of the drawing: the bands of the FEA count)',
    "finger_length_std_mm": "finger_length_std_mm, how well the finger's length is known, mm",
    "piv": "piv = { window = …, spacing = … }, the settings of the evaluation in px",
    "sheet_thickness_mm": "sheet_thickness_mm, the full width of the light sheet at 1/e²",
    "piv.pairing": 'pairing = "1-2,2-3" (each picture with the next) or "1-2,3-4" (pairs, with'
    " interval_s)",
    "piv.interval_s": "interval_s, the time between the two exposures of a vector field, s",
    "axes.turn_std_deg": "turn_deg and turn_std_deg, the turn of the picture against the tank and"
    " how well it is known",
    "axes.root_mm": "root_mm and root_std_mm, the middle of the finger's root in the files' axes"
    " and how well it is known, mm",
    "camera": f'camera = {{ {CAMERA.replace(" ", " = …, ")} = … }}, or camera = "none" to leave'
    " out the virtual experiment",
}


class Table(BaseModel):
    """A frozen table that refuses keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Start(Table):
    """When the first picture is taken, s on the simulation's clock."""

    at_s: float
    """First picture, on the simulation's clock [s]"""
    std_s: NotNegative
    """Its standard uncertainty [s]"""


class Scale(Table):
    """One of three: a number, a calibration of `piv calibrate`, or the finger's own length."""

    scale_mm_per_px: Positive | None = None
    """Size of a pixel in the light sheet [mm/px]"""
    calibration: str | None = None
    """File of piv calibrate, in its place"""
    from_finger: bool = False
    """Whether the finger's length tells the scale, in its place"""
    std_percent: Positive | None = None
    """Relative standard uncertainty of the scale [%]"""

    @property
    def pixel(self) -> float:
        """Size of a pixel in the sheet, m; 0 where no number states it."""
        return (self.scale_mm_per_px or 0.0) * 1e-3

    @model_validator(mode="after")
    def _one(self) -> Scale:
        given = [self.scale_mm_per_px is not None, self.calibration is not None, self.from_finger]
        if sum(given) != 1:
            raise ValueError(f"give one of {HINTS['scale'].removeprefix('scale = ')}")
        if not self.from_finger and self.std_percent is None:
            raise ValueError("std_percent is missing: say how well the scale is known, in per cent")
        return self


class Axes(Table):
    """Directions of the axes, and the middle of the finger's root in them."""

    y: Literal["up", "down"]
    """How y is counted"""
    x: Literal["right", "left"] = "right"
    """ "left": the pictures are mirrored"""
    root_px: tuple[float, float] | None = None
    """Of pictures: middle of the finger's root [px]"""
    root_mm: tuple[float, float] | None = None
    """Of vectors: the same, in the files' axes, or px times the scale [mm]"""
    root_std_mm: Positive | None = None
    """Its standard uncertainty [mm]"""
    turn_deg: float = 0.0
    """Of the tank frame in the picture, counter-clockwise; of pictures a first guess [deg]"""
    turn_std_deg: NotNegative | None = None
    """Its standard uncertainty; of pictures 1.5 where it is not given [deg]"""


class Evaluation(Table):
    """How pictures are (or were) correlated."""

    window: Annotated[int, Field(ge=8)]
    """Side of the last windows [px]"""
    spacing: Annotated[int, Field(ge=1)]
    """Between vectors [px]"""
    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    """How much is done for accuracy"""
    smoothing: bool | None = None
    """This project's adaptive smoothing; absent: yes of pictures, no of vectors"""
    pairing: Literal["1-2,2-3", "1-2,3-4"] | None = None
    """Of pictures: each with the next, or taken in pairs"""
    interval_s: Positive | None = None
    """Between the two exposures of a vector field; absent for pairing "1-2,2-3" [s]"""
    every: Annotated[int, Field(ge=1)] = 1
    """Correlate one pair of so many"""
    preprocess: str = ""
    """Of the pictures, as piv correlate --preprocess"""


class VectorFiles(Table):
    """What exported vectors do not say themselves."""

    kind: Literal["openpiv", "pivlab", "tecplot", "davis", "csv", "plane"] | None = None
    """Format of the files; absent: by their content"""
    length_unit: str | None = None
    """Where the files do not state it"""
    velocity_unit: str | None = None
    """Where the files do not state it"""
    image_rows: int | None = None
    """Of the picture, where y is counted from its top [px]"""
    zero_is_absent: bool = False
    """Whether a displacement of exactly zero is an absent vector"""
    keep_replaced: bool = False
    """Whether vectors that the program has replaced count"""
    std_px: Positive | None = None
    """Standard uncertainty of a displacement, where the files carry none [px]"""


class LabCamera(Table):
    """Camera and seeding of vectors without pictures; of pictures these are measured."""

    columns: Annotated[int, Field(ge=64)]
    """Of the picture [px]"""
    rows: Annotated[int, Field(ge=64)]
    """Of the picture [px]"""
    density_ppp: Positive
    """Particles in a pixel [1/px²]"""
    diameter_px: Positive
    """Of a particle's picture, at 1/e² [px]"""
    background: NotNegative
    """Of the dark picture [grey levels]"""
    read_noise: NotNegative
    """Standard deviation [grey levels]"""
    peak: Positive
    """Of a particle in the middle of the sheet [grey levels]"""
    scale_mm_per_px: Positive
    """Size of a pixel in the light sheet [mm/px]"""
    bits: Literal[8, 10, 12, 16] = 8
    """Of a grey value"""


class Dpiv(Table):
    """One laboratory's data; `folder` is where dpiv.toml lies, paths are relative to it."""

    folder: Path
    format: str
    """ "dpiv" """
    format_version: int
    """Of this file"""
    title: str
    """Of the recording, for people"""
    kind: Literal["pictures", "vectors"]
    """Pictures, or vectors without them"""
    files: str | tuple[str, ...]
    """A pattern or a list of paths, relative to this file"""
    frame_rate_hz: Positive
    """Pictures per second; pairs of pairing "1-2,3-4", fields of vectors [Hz]"""
    start: Start | Literal["from motion"]
    """When the first picture is taken; "from motion": the finger shows it"""
    scale: Scale
    """How large a pixel is"""
    axes: Axes
    """Directions and place of the pictures' axes"""
    finger_geometry: Literal["measured", "nominal"]
    """ "measured": the states are of this finger; "nominal": of the drawing, whose bands count"""
    piv: Evaluation
    """How pictures are, or vectors were correlated"""
    sheet_thickness_mm: Positive
    """Full width of the light sheet at 1/e² [mm]"""
    colour: Literal["refuse", "luma", "green"] = "refuse"
    """What is done with coloured pictures"""
    finger_length_std_mm: NotNegative | None = None
    """Of pictures: standard uncertainty of the finger's length [mm]"""
    root_hidden_mm: NotNegative = 0.0
    """How much of the finger, from its root on, a holder or a shadow hides [mm]"""
    light_from_deg: float | None = None
    """Of pictures lit from one side: whence, counter-clockwise from the right [deg]"""
    vectors: VectorFiles | None = None
    """Of kind = "vectors": what the files do not say themselves"""
    camera: LabCamera | Literal["none"] | None = None
    """Of kind = "vectors": camera and seeding; "none" leaves out the virtual experiment"""

    @model_validator(mode="after")
    def _whole(self) -> Dpiv:
        _pictures(self) if self.kind == "pictures" else _vectors(self)
        return self

    @property
    def name(self) -> str:
        """Name of the data: that of its folder."""
        return self.folder.resolve().name

    @property
    def light_from(self) -> float | None:
        """Direction of the light, rad from the picture's x axis; None: from all sides."""
        return None if self.light_from_deg is None else math.radians(self.light_from_deg)

    @property
    def interval(self) -> float:
        """Time between the two exposures of a vector field, s."""
        return self.piv.interval_s or 1 / self.frame_rate_hz

    def sources(self) -> str | list[str]:
        """Paths of the files as piv takes them."""
        if isinstance(self.files, str):
            return str(self.folder / self.files)
        return [str(self.folder / name) for name in self.files]


def _check(*faults: tuple[bool, str]) -> None:
    """ValueError with the message of the first condition that holds."""
    for wrong, message in faults:
        if wrong:
            raise ValueError(message)


def _pictures(dpiv: Dpiv) -> None:
    """ValueError where the keys of pictures contradict each other."""
    piv, finger = dpiv.piv, dpiv.scale.from_finger
    _check(
        (
            bool(dpiv.vectors or dpiv.camera),
            'tables [vectors] and [camera] belong to kind = "vectors"; pictures show them',
        ),
        (piv.pairing is None, f"piv.pairing is missing: give {HINTS['piv.pairing']}"),
        (
            (piv.pairing == "1-2,3-4") != (piv.interval_s is not None),
            'piv.interval_s, the time between the two exposures, belongs to pairing = "1-2,3-4"; of'
            ' "1-2,2-3" it follows from frame_rate_hz',
        ),
        (
            dpiv.finger_length_std_mm is None,
            f"finger_length_std_mm is missing: give {HINTS['finger_length_std_mm']}",
        ),
        (
            dpiv.axes.root_px is None and not finger,
            "axes.root_px is missing: give the position of the root's middle in px, or"
            " scale = { from_finger = true }",
        ),
        (
            finger and dpiv.root_hidden_mm > 0,
            "scale cannot come from a finger whose root is hidden (root_hidden_mm): give a"
            " calibration or scale_mm_per_px",
        ),
    )


def _vectors(dpiv: Dpiv) -> None:
    """ValueError where the keys of vectors contradict each other."""
    piv, axes = dpiv.piv, dpiv.axes
    start = HINTS["start"].split(", or")[0]
    _check(
        (piv.interval_s is None, f"piv.interval_s is missing: give {HINTS['piv.interval_s']}"),
        (dpiv.camera is None, f"camera is missing: give {HINTS['camera']}"),
        (
            dpiv.start == "from motion",
            f"start cannot come from the motion without pictures: give {start}",
        ),
        (
            bool(dpiv.scale.from_finger or dpiv.scale.calibration),
            "scale of vectors without pictures: give"
            " scale = { scale_mm_per_px = …, std_percent = … }",
        ),
        (
            dpiv.light_from_deg is not None,
            "light_from_deg is of pictures: vectors do not show the finger; leave it out",
        ),
        (
            piv.pairing is not None or piv.every != 1,
            "piv.pairing and every are of pictures; vectors need piv.interval_s alone",
        ),
        (
            axes.root_mm is None or axes.root_std_mm is None,
            "axes.root_mm or root_std_mm is missing: vectors do not show the finger; give"
            f" {HINTS['axes.root_mm']}",
        ),
        (
            axes.turn_std_deg is None,
            f"axes.turn_std_deg is missing: give {HINTS['axes.turn_std_deg']}",
        ),
    )


def read_dpiv(path: Path) -> Dpiv:
    """Read and check a dpiv.toml (or the one in a folder); FileNotFoundError or ValueError."""
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: missing; data of a laboratory need a {NAME} beside them that states scale,"
            " axes and times (docs/comparison.md has one to copy)"
        )
    table = read_toml(path)
    check_version(table, path, "dpiv", VERSION, "state it as docs/comparison.md has it")
    try:
        return Dpiv(**table, folder=path.parent)
    except ValidationError as error:
        raise ValueError(f"{path}: {_sentence(error)}") from None


def _sentence(error: ValidationError) -> str:
    """All that is missing or wrong, what is missing first, with what to write."""
    faults = []
    for one in sorted(error.errors(), key=lambda e: e["type"] != "missing"):
        parts = (part for part in one["loc"] if not isinstance(part, str) or _is_key(part))
        place = tuple(parts)
        key = ".".join(map(str, place))
        if one["type"] == "missing":
            faults.append(f"{key} is missing: give {HINTS.get(key, key)}")
        else:
            faults += complaints([one | {"loc": place}], Dpiv)
    return "; ".join(faults)


def _is_key(part: str) -> bool:
    """Not the name of one of several types that a key may have."""
    return not part[:1].isupper() and "[" not in part
