"""Recordings of Photron cameras: .cih or .cihx beside .mraw, a video or images."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from piv.files.errors import one_line
from piv.files.regular import read_regular
from piv.images.recording import Recording

_CIHX = {
    "Camera Type": "deviceInfo/deviceName",
    "Record Rate(fps)": "recordInfo/recordRate",
    "Shutter Speed(s)": "recordInfo/shutterSpeed",
    "Total Frame": "frameInfo/totalFrame",
    "Image Width": "imageDataInfo/resolution/width",
    "Image Height": "imageDataInfo/resolution/height",
    "File Format": "imageFileInfo/fileFormat",
    "EffectiveBit Depth": "imageDataInfo/effectiveBit/depth",
    "Color Bit": "imageDataInfo/colorInfo/bit",
}  # of the XML header, by the names of the older one

_HEADERS = (".cihx", ".cih")
_EXPORTS = {"tiff": "tif", "jpeg": "jpg"}  # endings of images, by the header's word


class Photron(Recording):
    """A Photron recording, `.mraw` beside `.cihx` or `.cih`: 8, 12 (packed) or 16 bit."""

    def __init__(self, path: Path) -> None:
        header, self.path = _photron_files(path)
        try:
            cih = _read_header(header)
            self._size = (int(cih["Image Height"]), int(cih["Image Width"]))
            count, self.bits = int(cih["Total Frame"]), int(cih["Color Bit"])
            rate = float(cih["Record Rate(fps)"])
            effective = int(cih.get("EffectiveBit Depth", self.bits))
        except (KeyError, ValueError) as error:
            raise _unreadable(header, error) from error
        if cih.get("File Format", "MRaw").lower() != "mraw" or self.bits not in (8, 12, 16):
            raise ValueError(
                f"{header}: {cih.get('File Format')} of {self.bits} bit; only MRaw of 8, 12 or 16 "
                "bit can be read"
            )
        pixels = self._size[0] * self._size[1]
        need, size = count * pixels * self.bits // 8, self.path.stat().st_size
        if count < 1 or pixels < 1 or size < need:
            raise ValueError(
                f"{self.path}: {size} bytes, but {header.name} announces {count} frames, {need} "
                "bytes"
            )
        super().__init__(str(self.path), count)
        if rate > 0:
            self.attrs["frame_rate_hz"], self.times = rate, np.arange(count) / rate
        self.attrs["bits"] = effective if self.bits != 8 else 8
        self.attrs["camera"] = {k: cih[k] for k in ("Camera Type", "Shutter Speed(s)") if k in cih}
        if self.bits == 12 and pixels % 2:
            raise ValueError(
                f"{header}: packed 12-bit frames need an even number of pixels, got {pixels}"
            )

    def _read(self, i: int) -> np.ndarray:
        pixels = self._size[0] * self._size[1]
        nbytes = pixels * self.bits // 8
        data = np.fromfile(self.path, np.uint8, nbytes, offset=i * nbytes)
        if self.bits == 12:
            # two pixels in three bytes, high bits first
            first, middle, last = data.reshape(-1, 3).astype(np.uint16).T
            pairs = np.stack([first << 4 | middle >> 4, (middle & 15) << 8 | last], axis=1)
            return pairs.reshape(self._size)
        return data.view(np.dtype("<u2") if self.bits == 16 else np.uint8).reshape(self._size)


def exported(header: Path) -> list[Path]:
    """The video, or the images, that a header was written with; empty where that is an .mraw."""
    if header.suffix.lower() == ".mraw" or not header.is_file():
        return []
    kind = _read_header(header).get("File Format", "mraw").lower()
    if kind == "mraw":
        return []
    ending = f".{_EXPORTS.get(kind, kind)}"
    beside = list(header.parent.iterdir())
    # the pictures of run1 and of run12 both begin with run1
    longer = tuple(
        p.stem
        for p in beside
        if p.suffix.lower() in _HEADERS and p.stem.startswith(header.stem) and p.stem != header.stem
    )
    return sorted(
        p
        for p in beside
        if p.suffix.lower() == ending
        and p.stem.startswith(header.stem)
        and not p.stem.startswith(longer)
    )


def set_rate(recording: Recording, path: Path) -> None:
    """Give a recording the frame rate of the header `path`, or of one of its name beside it."""
    headers = [path.with_suffix(suffix) for suffix in _HEADERS]
    header = next((h for h in headers if h.is_file()), None)
    if header is None:
        return
    try:
        rate = float(_read_header(header)["Record Rate(fps)"])
    except (KeyError, ValueError) as error:
        raise _unreadable(header, error) from error
    if rate > 0:
        recording.attrs["frame_rate_hz"] = rate
        recording.times = np.arange(len(recording)) / rate


def _unreadable(header: Path, error: Exception) -> ValueError:
    return ValueError(f"{header}: not a readable Photron header ({one_line(error)})")


def _read_header(path: Path) -> dict[str, str]:
    """The keys of a .cih; those of a .cihx by the names that the older format gives them."""
    text = read_regular(path).decode("utf-8", "replace")
    if path.suffix.lower() == ".cih":
        pairs = (line.split(" : ", 1) for line in text.splitlines())
        return {pair[0].strip(): pair[1].strip() for pair in pairs if len(pair) == 2}
    begin, end = text.find("<cih>"), text.rfind("</cih>")
    try:
        tree = ElementTree.fromstring(text[begin : end + len("</cih>")] if begin >= 0 else text)
    except ElementTree.ParseError as error:
        raise _unreadable(path, error) from error
    found = {name: tree.findtext(place) for name, place in _CIHX.items()}
    return {name: value.strip() for name, value in found.items() if value is not None}


def _photron_files(path: Path) -> tuple[Path, Path]:
    headers = [path] if path.suffix.lower() != ".mraw" else [path.with_suffix(s) for s in _HEADERS]
    header = next((h for h in headers if h.is_file()), None)
    raw = path.with_suffix(".mraw")
    if header is None:
        raise FileNotFoundError(
            f"{path}: no {path.stem}.cihx or .cih beside it, which says the image size"
        )
    if not raw.is_file():
        raise FileNotFoundError(f"{header}: no {raw.name} beside it, which holds the frames")
    return header, raw
