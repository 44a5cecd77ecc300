"""dpiv.toml: what a laboratory states of its recording or vectors (docs/comparison.md)."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.scene.key_reference import MISSING, Key, complaints, keys_of, template, toml_value
from pipeline.scene.toml_text import read_template
from piv.files.errors import StageError
from piv.files.hdf5 import open_hdf5
from piv.files.provenance import check_version
from piv.images.open_recording import (
    HDF5_SUFFIXES,
    IMAGE_SUFFIXES,
    PHOTRON_SUFFIXES,
    VIDEO_SUFFIXES,
    open_recording,
)

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
NAME = "dpiv.toml"
VERSION = 4
# what each kind needs beside the keys that both need; pictures may have a calibration as scale
REQUIRED = {
    "pictures": "finger_length_std_mm scale.scale_mm_per_px axes.root_px piv.pairing",
    "vectors": "scale.scale_mm_per_px axes.root_mm axes.root_std_mm axes.turn_std_deg"
    " piv.interval_s",
}
# keys of the other kind, which would be ignored
OTHER = {
    "pictures": "axes.root_mm axes.root_std_mm vectors",
    "vectors": "finger_length_std_mm root_hidden_mm light_from_deg colour"
    " axes.root_px piv.pairing piv.every scale.calibration",
}
ONE_FILE = (*PHOTRON_SUFFIXES, *VIDEO_SUFFIXES, *HDF5_SUFFIXES)  # is the whole recording


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
    turn_std_deg: NotNegative = 1.5
    """Its standard uncertainty; of vectors it must be given [deg]"""


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
    """Of pictures: each with the next, or taken in pairs, which needs interval_s"""
    interval_s: Positive | None = None
    """Between two exposures; of vectors and of pairing "1-2,3-4", which need it [s]"""
    every: Annotated[int, Field(ge=1)] = 1
    """Correlate one pair of so many"""
    preprocess: str = ""
    """Of the pictures, as piv correlate --preprocess"""


class Vectors(Table):
    """What vectors do not say themselves."""

    std_px: Positive
    """Standard uncertainty of a displacement, where the file carries none [px]"""
    repeats: Annotated[int, Field(ge=1)] = 1
    """Of phase averages: how many recordings each vector is the mean of"""


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
    """Pictures per second; of pairing "1-2,3-4" pairs, of vectors fields per second [Hz]"""
    start: Start | Literal["from motion", "from flow"]
    """{ at_s = …, std_s = … }; "from motion": pictures show it; "from flow": the vectors' onset"""
    finger_geometry: Literal["measured", "nominal"]
    """ "measured": FEA of this very finger; "nominal": of its drawing, so that its bands count"""
    colour: Literal["refuse", "luma", "green"] = "refuse"
    """What is done with coloured pictures"""
    finger_length_std_mm: NotNegative | None = None
    """Of pictures: standard uncertainty of the finger's length [mm]"""
    root_hidden_mm: NotNegative = 0.0
    """Of pictures: how much of the finger, from its root on, a holder or a shadow hides [mm]"""
    light_from_deg: float | None = None
    """Of pictures lit from one side: whence, counter-clockwise from the right [deg]"""
    scale: Scale
    """How large a pixel is"""
    axes: Axes
    """Directions and place of the pictures' axes"""
    piv: Evaluation
    """How pictures are, or vectors were correlated"""
    vectors: Vectors | None = None
    """Of kind = "vectors": what the file does not say itself"""

    @property
    def interval(self) -> float:
        """Time between the two exposures of a vector field, s."""
        return self.piv.interval_s or 1 / self.frame_rate_hz

    def sources(self) -> str | list[str]:
        """Paths of the files as piv takes them."""
        if isinstance(self.files, str):
            return str(self.folder / self.files)
        return [str(self.folder / name) for name in self.files]


KEYS = list(keys_of(Dpiv, without=frozenset({"folder"})))


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
    table, empty = read_template(path)
    check_version(table, path, "dpiv", VERSION, "state it as docs/comparison.md has it")
    missing, wrong = _of_kind(table)
    missing += empty
    try:
        dpiv = Dpiv(**table, folder=path.parent)
    except ValidationError as error:
        for one in error.errors():
            # without the names of the types that a key may have
            place = tuple(p for p in one["loc"] if not isinstance(p, str) or _is_key(p))
            if one["type"] == "missing":
                missing.insert(0, ".".join(part for part in place if isinstance(part, str)))
            else:
                wrong += complaints([one | {"loc": place}], Dpiv)
    needs = [f"{key.name} is missing: {key.meaning} ({key.type})" for key in _asked(missing)]
    if faults := "; ".join([*needs, *wrong]):
        raise StageError(f"{path}: {faults}")
    return dpiv


def _is_key(part: str) -> bool:
    return not part[:1].isupper() and "[" not in part


def _asked(missing: list[str]) -> list[Key]:
    """The missing keys, of a missing table those that it must have."""
    within = tuple(f"{name}." for name in missing)
    asked = [
        key
        for key in KEYS
        if key.name in missing or (key.default == MISSING and key.name.startswith(within))
    ]
    return [key for key in asked if key.type != "table"]


def _of_kind(table: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Keys that pictures or vectors need as well, and sentences on what contradicts its kind."""
    tables = {name: part for name, part in table.items() if isinstance(part, dict)}
    given = {*table, *(f"{name}.{key}" for name, part in tables.items() for key in part)}
    kind, pairing = str(table.get("kind")), tables.get("piv", {}).get("pairing")
    needed = REQUIRED.get(kind, "").split()
    if kind == "pictures" and pairing != "1-2,2-3":
        needed.append("piv.interval_s")  # asked for together with the pairing
    if kind == "pictures" and "scale.calibration" in given:
        needed.remove("scale.scale_mm_per_px")
    wrong = [
        f"{key} is not of {kind}: leave it out"
        for key in OTHER.get(kind, "").split()
        if key in given
    ]
    if kind == "pictures" and {"scale.scale_mm_per_px", "scale.calibration"} <= given:
        wrong.append("scale: give scale_mm_per_px or calibration")
    if kind == "pictures" and pairing == "1-2,2-3" and "piv.interval_s" in given:
        wrong.append('piv.interval_s belongs to pairing = "1-2,3-4"; else frame_rate_hz has it')
    if kind == "vectors" and table.get("start") == "from motion":
        wrong.append(
            'start cannot be "from motion" without pictures: "from flow", or at_s and std_s'
        )
    if kind == "pictures" and table.get("start") == "from flow":
        wrong.append('start of pictures is "from motion", or at_s and std_s')
    if kind == "vectors" and tables.get("axes", {}).get("y") == "down":
        wrong.append('axes.y of vectors: their series counts y upwards, state y = "up"')
    return [key for key in needed if key not in given], wrong


def dpiv_template(data: Path | None) -> str:
    """A dpiv.toml to start from: of a folder with the keys of its kind, and what its files show."""
    seen = seen_in(data) if data else {}
    kind = seen.get("kind", "").strip('"')
    required, other = REQUIRED.get(kind, "").split(), tuple(OTHER.get(kind, "").split())
    keys = [
        replace(key, default=MISSING) if key.name in required else key
        for key in KEYS
        if not key.name.startswith(other)
    ]
    return template(keys, seen)


def seen_in(folder: Path) -> dict[str, str]:
    """Values of dpiv.toml by dotted name; FileNotFoundError without pictures or vectors."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder; give that of the recording")
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    kinds = Counter(path.suffix.lower() for path in files)
    suffix = next((s for s in ONE_FILE if kinds[s]), max(IMAGE_SUFFIXES, key=lambda s: kinds[s]))
    if not kinds[suffix]:
        raise FileNotFoundError(
            f"{folder}: holds neither pictures nor vectors.h5; make that of other programs' vectors"
            " by piv convert FILES -o vectors.h5"
        )
    first = next(path for path in files if path.suffix.lower() == suffix)
    inside = first.relative_to(folder)
    pattern = inside if suffix in ONE_FILE else inside.with_name(f"*{first.suffix}")
    values: dict[str, object] = {
        "format": "dpiv",
        "format_version": VERSION,
        "title": folder.resolve().name,
        "files": pattern.as_posix(),
        "kind": "vectors" if suffix in HDF5_SUFFIXES and _holds_vectors(first) else "pictures",
    }
    if values["kind"] == "pictures":
        with open_recording(str(folder / pattern), colour="luma") as recording:
            if rate := recording.attrs.get("frame_rate_hz"):
                values["frame_rate_hz"] = float(rate)
    return {name: toml_value(value) for name, value in values.items()}


def _holds_vectors(path: Path) -> bool:
    """Whether an HDF5 file is a plane series (u and v), not a recording."""
    with open_hdf5(path) as file:
        return "u" in file and "v" in file
