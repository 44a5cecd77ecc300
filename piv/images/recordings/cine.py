"""Recordings of Phantom cameras: .cine files (Vision Research, Cine File Format, 2007 to 2011)."""

import struct
from pathlib import Path

import numpy as np

from piv.images.recording import Recording, UnreadableFrame

_HEADER = struct.Struct("<2s3HiIiI3IQ")  # CINEFILEHEADER
_BITMAP = struct.Struct("<IiiHHIIiiII")  # BITMAPINFOHEADER
_SETUP_MARK = 140  # bytes into SETUP: "ST"
# and of what follows that mark
_FRAME_RATE, _COLOUR_FILTER, _REAL_BITS = 768, 808, 896
_UNPACKED, _PACKED_10, _PACKED_12 = 0, 256, 1024  # biCompression


class Cine(Recording):
    """Grey films of 8 or 16 bit, or 10 and 12 bit packed; times from the frame rate.

    Sensors of 10 to 14 bit are stored in 16: `attrs["bits"]` is the sensor's. Packed 10 bit values
    are compressed like a square root, and stay so.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            with path.open("rb") as file:
                count = self._read_heads(file.read(2**16), path)
                file.seek(self._offsets_at)
                offsets = file.read(min(8 * count, path.stat().st_size))
            self._offsets = np.array(struct.unpack(f"<{count}q", offsets))
        except struct.error:
            raise ValueError(f"{path}: damaged, or not a .cine file; copy it again") from None
        super().__init__(str(path), count)
        self.files = (path,)
        self.attrs["bits"] = self._bits
        if self._rate > 0:
            self.attrs["frame_rate_hz"], self.times = self._rate, np.arange(count) / self._rate

    def _read_heads(self, head: bytes, path: Path) -> int:
        """Number of frames; ValueError where they cannot be read."""
        mark, *_, count, bitmap_at, setup_at, self._offsets_at, _ = _HEADER.unpack_from(head)
        if mark != b"CI":
            raise ValueError(f"{path}: not a .cine file")
        _, columns, rows, _, stored, self._packing, *_ = _BITMAP.unpack_from(head, bitmap_at)
        if head[setup_at + _SETUP_MARK :][:2] != b"ST":
            raise ValueError(f"{path}: a .cine file without setup; export the film as TIFF")
        rate, colour, real = (
            struct.unpack_from("<I", head, setup_at + k)[0]
            for k in (_FRAME_RATE, _COLOUR_FILTER, _REAL_BITS)
        )
        packed = {_UNPACKED: stored, _PACKED_10: 10, _PACKED_12: 12}.get(self._packing, 0)
        if colour or packed not in (8, 10, 12, 16) or rows < 1 or columns < 1 or count < 1:
            what = "a colour film" if colour or stored in (24, 48) else "not stored as grey values"
            raise ValueError(f"{path}: {what}; export it as grey TIFF")
        self._size, self._stored, self._rate = (rows, columns), packed, float(rate)
        self._bits = real if 0 < real <= packed else packed
        return count

    def _read(self, i: int) -> np.ndarray:
        rows, columns = self._size
        size = rows * columns * self._stored // 8
        if size > self.path.stat().st_size:
            raise UnreadableFrame(f"{self.frame_name(i)}: the file is smaller than one picture")
        with self.path.open("rb") as file:
            file.seek(max(0, int(self._offsets[i])))
            note = file.read(4)
            file.seek(max(0, int(self._offsets[i]) + int.from_bytes(note, "little")))
            data = np.frombuffer(file.read(size), np.uint8)
        if data.size < size:
            raise UnreadableFrame(f"{self.frame_name(i)}: the file is cut off before its end")
        if self._packing == _UNPACKED:  # rows from the bottom up, as in Windows bitmaps
            kind = np.uint8 if self._stored == 8 else np.dtype("<u2")
            return np.ascontiguousarray(data.view(kind).reshape(rows, columns)[::-1])
        # packed rows run from the top; the high bits come first
        bits = np.unpackbits(data).reshape(-1, self._stored)
        weights = 1 << np.arange(self._stored - 1, -1, -1, dtype=np.uint16)
        return (bits @ weights).astype(np.uint16).reshape(rows, columns)
