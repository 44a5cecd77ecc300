"""Frames through the stroke: WebP pictures for the slider and one H.264 film that plays offline."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

QUALITY = 78  # of 100: text stays sharp, a frame stays near 40 kB


def pixels(figure: Figure) -> np.ndarray:
    """The drawn figure as (row, column, RGB) bytes with even sides, as H.264 wants them."""
    figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    return np.ascontiguousarray(image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2])


def write_frames(images: Iterable[np.ndarray], folder: Path) -> Iterator[np.ndarray]:
    """Write each image as frame_000.webp … and hand it on; frames of an earlier run are removed."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("frame_*.webp"):
        old.unlink()
    for number, image in enumerate(images):
        Image.fromarray(image).save(folder / f"frame_{number:03d}.webp", quality=QUALITY, method=4)
        yield image


def write_film(images: Iterable[np.ndarray], path: Path, rate_hz: float) -> None:
    """Encode images to an MP4 (H.264, yuv420p) one by one, whole or not at all; ValueError without an image."""
    images = iter(images)
    first = next(images, None)
    if first is None:
        raise ValueError(f"{path}: no frame to make a film of")
    part = path.with_name(path.stem + ".part.mp4")
    size = (first.shape[1], first.shape[0])
    options = ["-crf", "24", "-preset", "veryfast", "-movflags", "+faststart", "-threads", "1"]
    writer = imageio_ffmpeg.write_frames(
        str(part),
        size,
        fps=rate_hz,
        codec="libx264",
        pix_fmt_out="yuv420p",
        quality=None,
        macro_block_size=2,
        output_params=options,
    )
    writer.send(None)
    writer.send(first)
    for image in images:
        writer.send(image)
    writer.close()
    os.replace(part, path)
