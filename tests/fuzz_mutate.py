"""Damaged copies of valid files: the same seed gives the same inputs."""

import random

WORDS = (
    b"nan", b"inf", b"-1", b"0", b"1e999", b"-1e308", b"4294967296", b"\n", b"\r\n", b",", b";",
    b"\t", b'"', b"#", b"[", b"}", b"=", b"\x00", b"\xff", "é".encode(), b"\xef\xbb\xbf", b"1_000",
    b"0x10", b"true", b"null", b" ",
)  # fmt: skip
NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1)


def damaged(seeds: list[bytes], draw: random.Random) -> bytes:
    """One of the seeds after one to six random changes."""
    content = bytearray(draw.choice(seeds))
    for _ in range(draw.choice((1, 1, 1, 2, 3, 6))):
        at = draw.randrange(len(content) + 1)
        kind = draw.randrange(8)
        if kind == 0 and content:  # flip a bit
            content[at % len(content)] ^= 1 << draw.randrange(8)
        elif kind == 1 and content:  # change a byte
            content[at % len(content)] = draw.randrange(256)
        elif kind == 2:  # write a number, little- or big-endian
            size = draw.choice((1, 2, 4, 8))
            number, order = draw.choice(NUMBERS) % 256**size, draw.choice(("little", "big"))
            content[at : at + size] = number.to_bytes(size, order)
        elif kind == 3:  # insert a word
            content[at:at] = draw.choice(WORDS)
        elif kind == 4:  # replace a piece by a word
            word = draw.choice(WORDS)
            content[at : at + draw.randrange(len(word) + 6)] = word
        elif kind == 5:  # delete a piece
            del content[at : at + draw.choice((1, 2, 8, 64, 512))]
        elif kind == 6:  # insert a piece of any seed
            other = draw.choice(seeds)
            start = draw.randrange(len(other) + 1)
            content[at:at] = other[start : start + draw.choice((1, 8, 64, 512))]
        else:  # cut off
            del content[at:]
    return bytes(content)
