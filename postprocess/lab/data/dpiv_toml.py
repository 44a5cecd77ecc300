"""dpiv.toml: what a laboratory states of its recording or vectors (docs/comparison.md)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fileio.errors import StageError
from fileio.key_reference import Key, complaints, keys_of
from fileio.provenance import check_version
from fileio.toml_text import read_toml

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
NAME = "dpiv.toml"
VERSION = 4
TABLES = ("piv", "axes", "scale")
# keys of the other kind, which would be ignored
OTHER = {
    "pictures": "axes.root_mm axes.root_std_mm vectors",
    "vectors": "finger_length_std_mm root_hidden_mm light_from_deg colour axes.root_px"
    " piv.pairing piv.every",
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
    """One of two: a number, or a calibration of `piv calibrate`."""

    scale_mm_per_px: Positive | None = None
    """Size of a pixel in the light sheet; of pictures calibration may replace it [mm/px]"""
    calibration: str | None = None
    """File of piv calibrate, in its place"""
    std_percent: Positive
    """Relative standard uncertainty of the scale [%]"""

    @property
    def pixel(self) -> float:
        """Size of a pixel in the sheet, m; 0 where no number states it."""
        return (self.scale_mm_per_px or 0.0) * 1e-3


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
    """Of vectors: its standard uncertainty [mm]"""
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


class Vectors(Table):
    """What vectors do not say themselves."""

    std_px: Positive
    """Standard uncertainty of a displacement, where the file carries none [px]"""


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
    """A pattern or a list of paths, relative to this file; vectors are one file"""
    frame_rate_hz: Positive
    """Pictures per second; pairs of pairing "1-2,3-4", fields of vectors [Hz]"""
    start: Start | Literal["from motion"]
    """{ at_s = …, std_s = … } of the first picture, or of pictures "from motion": they show it"""
    scale: Scale
    """How large a pixel is"""
    axes: Axes
    """Directions and place of the pictures' axes"""
    finger_geometry: Literal["measured", "nominal"]
    """ "measured": the states are of this finger; "nominal": of the drawing, whose bands count"""
    piv: Evaluation
    """How pictures are, or vectors were correlated"""
    colour: Literal["refuse", "luma", "green"] = "refuse"
    """What is done with coloured pictures"""
    finger_length_std_mm: NotNegative | None = None
    """Of pictures: standard uncertainty of the finger's length [mm]"""
    root_hidden_mm: NotNegative = 0.0
    """Of pictures: how much of the finger, from its root on, a holder or a shadow hides [mm]"""
    light_from_deg: float | None = None
    """Of pictures lit from one side: whence, counter-clockwise from the right [deg]"""
    vectors: Vectors | None = None
    """Of kind = "vectors": what the file does not say itself"""

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


def read_dpiv(path: Path) -> Dpiv:
    """Read and check a dpiv.toml (or the one in a folder); FileNotFoundError or ValueError.

    All that is missing or wrong is in one sentence, what is missing first.
    """
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: missing; data of a laboratory need a {NAME} beside them that states scale,"
            " axes and times (docs/comparison.md has one to copy)"
        )
    table = read_toml(path)
    check_version(table, path, "dpiv", VERSION, "state it as docs/comparison.md has it")
    missing, wrong = _of_kind(table)
    try:
        dpiv = Dpiv(**table, folder=path.parent)
    except ValidationError as error:
        for one in error.errors():
            parts = (part for part in one["loc"] if not isinstance(part, str) or _is_key(part))
            place = tuple(parts)
            if one["type"] == "missing":
                missing.insert(0, ".".join(part for part in place if isinstance(part, str)))
            else:
                wrong += complaints([one | {"loc": place}], Dpiv)
    needs = [f"{key.name} is missing: {key.meaning} ({key.type})" for key in _asked(missing)]
    if faults := "; ".join([*needs, *wrong]):
        raise StageError(f"{path}: {faults}")
    return dpiv


def _asked(missing: list[str]) -> list[Key]:
    """The missing keys, of a missing table those that it must have."""
    known = {key.name: key for key in keys_of(Dpiv, without=frozenset({"folder"}))}
    names: dict[str, None] = {}
    for one in missing:
        within = [k.name for k in known.values() if k.name.startswith(f"{one}.")]
        within = [name for name in within if known[name].default == "required"]
        names |= dict.fromkeys(within if known[one].type == "table" else [one])
    return [known[name] for name in names]


def _of_kind(table: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Keys that pictures or vectors need as well, and sentences on what contradicts its kind."""
    of = {name: part if isinstance(part := table.get(name), dict) else {} for name in TABLES}
    piv, axes, scale = (of[name] for name in TABLES)
    pairing, ways = piv.get("pairing"), ("calibration" in scale) + ("scale_mm_per_px" in scale)
    vectors, pictures = (table.get("kind") == kind for kind in ("vectors", "pictures"))
    needed = {
        "axes.root_mm": vectors,
        "axes.root_std_mm": vectors,
        "axes.turn_std_deg": vectors,
        "piv.interval_s": vectors or (pictures and pairing == "1-2,3-4"),
        "piv.pairing": pictures,
        "finger_length_std_mm": pictures,
        "axes.root_px": pictures,
        "scale.scale_mm_per_px": vectors or ways == 0,
    }
    given = {*table, *(f"{name}.{key}" for name, part in of.items() for key in part)}
    faults = {
        "scale: give scale_mm_per_px or calibration": ways > 1,
        'start cannot be "from motion" without pictures: give at_s and std_s': vectors
        and table.get("start") == "from motion",
        'piv.interval_s belongs to pairing = "1-2,3-4"; else frame_rate_hz has it': pictures
        and (pairing == "1-2,2-3" and "interval_s" in piv),
        'axes.y of vectors: their series counts y upwards, state y = "up"': vectors
        and axes.get("y") == "down",
    } | {
        f"{key} is not of {kind}: leave it out": table.get("kind") == kind and key in given
        for kind, keys in OTHER.items()
        for key in keys.split()
    }
    missing = [key for key, needs in needed.items() if needs and key not in given]
    return missing, [text for text, holds in faults.items() if holds]


def _is_key(part: str) -> bool:
    """Not the name of one of several types that a key may have."""
    return not part[:1].isupper() and "[" not in part
