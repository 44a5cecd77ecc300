"""What stands still in a sequence while particles move past it: streaks, scratches and reflections.

The least grey value over the frames of a pixel holds what is static, and particles at rest as well.
Those stay: a cell counts as static only where its texture that does not change is as strong as that
of the particles elsewhere and particles move past it, or where it is so bright that no particles
can be there.
"""

import cv2
import numpy as np
from numpy import ndarray

from piv.images.absent_frames import FrameCheck
from piv.images.recording import Recording

CELL = 32  # px
FRAMES = 20  # looked at, evenly chosen: more of them hardly lower the least value between particles
_LEAST_FRAMES = 5  # with fewer, particles overlap themselves too often
# of the particles' variance, which is the median over the cells: a cell is static whose own least
# values have STATIC of it while MOVING of it changes, or that have BRIGHT of it
STATIC, MOVING, BRIGHT = 1.0, 0.25, 10.0
# of the brightest pixel of all frames: what is always so bright shows no particles
_SATURATED = 0.98
_LEAST_AREA = 5e-4  # share of the picture; a few odd cells are no background


def static_background(recording: Recording) -> tuple[ndarray, ndarray] | None:
    """Grey values (float32) to subtract, 0 where nothing is static, and saturated pixels (bool).

    None where it would not pay: nothing is static, most of the picture is, fewer than
    _LEAST_FRAMES frames or CELL px.
    """
    if len(recording) < _LEAST_FRAMES or min(recording.shape) < CELL:
        return None
    chosen = np.unique(np.linspace(0, len(recording) - 1, min(FRAMES, len(recording))).astype(int))
    apart = max(1, len(chosen) // 4)
    few = []
    least, top = np.full(recording.shape, np.inf, np.float32), -np.inf
    for k, image in enumerate(FrameCheck(recording).images(chosen)):
        top = max(top, float(image.max()))
        np.minimum(least, image, out=least)
        few += [] if k % apart else [image]
    still = _texture(least)
    total, moving = [], []
    for image in few:
        texture = _texture(image)
        total.append(_variance(texture))
        moving.append(_variance(texture - still))
    particles = float(np.median(np.median(total, axis=0)))
    if not particles > 0:
        return None
    unchanging, changing = _variance(still), np.median(moving, axis=0)
    cells = (unchanging > STATIC * particles) & (changing > MOVING * particles) | (
        unchanging > BRIGHT * particles
    )
    if not _LEAST_AREA < cells.mean() < 0.5:
        return None
    # what is static reaches into the next cells, too weak to be seen there
    cells = cv2.dilate(cells.astype(np.uint8), np.ones((3, 3), np.uint8))
    rows, columns = least.shape
    where = np.zeros(least.shape, np.float32)
    full = cv2.resize(cells, None, fx=CELL, fy=CELL, interpolation=cv2.INTER_NEAREST)[
        :rows, :columns
    ]
    where[: full.shape[0], : full.shape[1]] = full
    # rows and columns left over by whole cells go with the last ones
    where[full.shape[0] :] = where[full.shape[0] - 1]
    where[:, full.shape[1] :] = where[:, full.shape[1] - 1 : full.shape[1]]
    level = float(np.median(least))
    return np.maximum(least - level, 0) * where, (least >= _SATURATED * top) & (where > 0)


def _texture(image: ndarray) -> ndarray:
    """The image (float32) without slow changes across it."""
    image = image.astype(np.float32)
    return image - cv2.GaussianBlur(image, (0, 0), CELL / 4)


def _variance(texture: ndarray) -> ndarray:
    """Of the texture in each whole cell."""
    rows, columns = (n // CELL for n in texture.shape)
    blocks = texture[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL)
    return blocks.var(axis=(1, 3))
