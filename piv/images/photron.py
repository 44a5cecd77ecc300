"""Recordings of Photron cameras: .cih or .cihx beside .mraw."""

from pathlib import Path

import numpy as np

from piv.files.errors import one_line
from piv.images.recording import Recording


class Photron(Recording):
    """A Photron recording, `.mraw` beside `.cihx` or `.cih`: 8, 12 (packed) or 16 bit."""

    def __init__(self, path: Path) -> None:
        try:
            import pyMRAW  # compiles at import: only who needs it waits
        except ImportError:
            raise ValueError(
                f"{path}: Photron recordings need the package pyMRAW: pip install pyMRAW"
            ) from None
        header, self.path = _photron_files(path)
        try:
            cih = pyMRAW.get_cih(str(header))
            self._size = (int(cih["Image Height"]), int(cih["Image Width"]))
            count, self.bits = int(cih["Total Frame"]), int(cih["Color Bit"])
            rate = float(cih["Record Rate(fps)"])
        except Exception as error:  # the parser raises whatever its parts raise
            raise ValueError(
                f"{header}: not a readable Photron header ({one_line(error)})"
            ) from error
        if str(cih.get("File Format", "MRaw")).lower() != "mraw" or self.bits not in (8, 12, 16):
            raise ValueError(
                f"{header}: {cih.get('File Format')} of {self.bits} bit; only MRaw of 8, 12 or 16 "
                "bit can be read"
            )
        pixels = self._size[0] * self._size[1]
        need, size = count * pixels * self.bits // 8, self.path.stat().st_size
        if count < 1 or size < need:
            raise ValueError(
                f"{self.path}: {size} bytes, but {header.name} announces {count} frames, {need} "
                "bytes"
            )
        super().__init__(str(self.path), count)
        if rate > 0:
            self.attrs["frame_rate_hz"], self.times = rate, np.arange(count) / rate
        self._unpack = pyMRAW.nb_read_uint12
        self.attrs["bits"] = int(cih.get("EffectiveBit Depth", self.bits)) if self.bits != 8 else 8
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
            data.flags.writeable = False  # the compiled signature asks for a read-only array
            return self._unpack(data).reshape(self._size)
        return data.view(np.dtype("<u2") if self.bits == 16 else np.uint8).reshape(self._size)


def _photron_files(path: Path) -> tuple[Path, Path]:
    headers = (
        [path]
        if path.suffix.lower() != ".mraw"
        else [path.with_suffix(s) for s in (".cihx", ".cih")]
    )
    header = next((h for h in headers if h.is_file()), None)
    raw = path.with_suffix(".mraw")
    if header is None:
        raise FileNotFoundError(
            f"{path}: no {path.stem}.cihx or .cih beside it, which says the image size"
        )
    if not raw.is_file():
        raise FileNotFoundError(f"{header}: no {raw.name} beside it, which holds the frames")
    return header, raw
