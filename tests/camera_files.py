"""Files of cameras and of ImageJ, by the published formats."""

import struct

import numpy as np


def pack(values, bits):
    """Values one behind the other, high bits first."""
    every = (values.ravel()[:, None] >> np.arange(bits - 1, -1, -1)) & 1
    return np.packbits(every.astype(np.uint8)).tobytes()


def cine(path, frames, stored=16, *, compression=0, real=10, colour=0, rate=500):
    """A .cine file of frames of 10 bit: headers, SETUP, offsets, annotated images."""
    rows, columns = frames.shape[1:]
    if compression:
        images = [pack(frame, stored) for frame in frames]
    else:  # rows from the bottom up
        kind = "<u2" if stored == 16 else "u1"
        images = [(frame[::-1] >> (0 if stored == 16 else 2)).astype(kind).tobytes()
                  for frame in frames]  # fmt: skip
    setup = bytearray(6000)
    setup[140:142] = b"ST"
    for at, value in ((142, len(setup)), (768, rate), (808, colour), (896, real)):
        struct.pack_into("<H" if at == 142 else "<I", setup, at, value)
    bit_count = {256: 16, 1024: 16}.get(compression, stored)
    bitmap = struct.pack("<IiiHHIIiiII", 40, columns, rows, 1, bit_count, compression,
                         len(images[0]), 0, 0, 0, 1 << real)  # fmt: skip
    setup_at = 44 + len(bitmap)
    offsets_at = setup_at + len(setup)
    first = offsets_at + 8 * len(images)
    blocks = [struct.pack("<II", 8, len(image)) + image for image in images]
    places = first + np.cumsum([0, *map(len, blocks[:-1])])
    head = struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, 0, 1, -2, 9, -2, len(images), 44, setup_at,
                       offsets_at, 0)  # fmt: skip
    table = struct.pack(f"<{len(places)}q", *places)
    path.write_bytes(head + bitmap + setup + table + b"".join(blocks))
    return path


def imagej(path, frames, order="<"):
    """A stack of 16 bit with one directory for all pictures, as ImageJ writes above 4 GB."""
    rows, columns = frames.shape[1:]
    text = b"ImageJ=1.54f\nimages=%d\n\0" % len(frames)
    entries = [(256, 3, 1, columns), (257, 3, 1, rows), (258, 3, 1, 16), (259, 3, 1, 1),
               (262, 3, 1, 1), (270, 2, len(text), 200), (273, 4, 1, 300), (277, 3, 1, 1),
               (278, 3, 1, rows), (279, 4, 1, 2 * rows * columns)]  # fmt: skip
    body = (b"II" if order == "<" else b"MM") + struct.pack(order + "HIH", 42, 8, len(entries))
    for tag, code, count, value in entries:
        body += struct.pack(order + "HHI", tag, code, count)
        body += struct.pack(order + ("HH" if code == 3 else "I"), *[value, 0][: 2 - (code != 3)])
    body = (body + bytes(4)).ljust(200, b"\0") + text
    path.write_bytes(body.ljust(300, b"\0") + frames.astype(order + "u2").tobytes())
    return path
