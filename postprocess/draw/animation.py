"""Frames through the stroke, as WebP pictures for the slider."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy import ndarray
from PIL import Image

from piv.files.atomic import write_bytes

_QUALITY = 70  # of 100: text stays sharp, a frame stays near 20 kB


def pixels(figure: Figure) -> ndarray:
    """The figure as it is drawn, (row, column, RGB) bytes."""
    image = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    return np.ascontiguousarray(image)


def write_picture(image: ndarray, path: Path, **more: Any) -> None:
    """Write an image (grey or RGB bytes) in the format of its suffix; `more` as Pillow takes it."""
    content = io.BytesIO()
    Image.fromarray(image).save(content, format=path.suffix[1:], **more)
    write_bytes(path, content.getbuffer())


def write_frames(images: Iterable[ndarray], folder: Path) -> None:
    """Write each image as frame_000.webp …; frames of an earlier run are removed."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("frame_*.webp"):
        old.unlink()
    for number, image in enumerate(images):
        write_picture(image, folder / f"frame_{number:03d}.webp", quality=_QUALITY, method=4)
