"""Films, image by image: H.264 or, in .webm, VP9."""

import errno
import os
import shutil
import subprocess
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from piv.files.atomic import whole

_H264 = "-c:v libx264 -preset medium -movflags +faststart"
_CODECS = {".webm": "-c:v libvpx-vp9 -b:v 0 -deadline good -cpu-used 5"}


def write_film(
    images: Iterable[np.ndarray],
    path: Path,
    rate_hz: float,
    *,
    crf: int = 15,
) -> None:
    """Encode images (row, column, RGB), of even sides, to a film (yuv420p), whole or not at all.

    VP9 where the suffix is .webm, which every browser plays, H.264 elsewhere; `crf`: quality as
    the encoder names it. ValueError without an image, or with ffmpeg's reason; OSError where the
    disk is full.
    """
    images = iter(images)
    first = next(images, None)
    if first is None:
        raise ValueError(f"{path}: no frame to make a film of")
    rows, columns = first.shape[:2]
    words = (
        f"-y -loglevel error -f rawvideo -pix_fmt rgb24 -s {columns}x{rows} -r {rate_hz:.02f} "
        f"-i - -an {_CODECS.get(path.suffix, _H264)} -pix_fmt yuv420p -crf {crf} -threads 1"
    )
    with whole(path, suffix=True) as part, ThreadPoolExecutor(1) as pool:
        command = [_ffmpeg(path), *words.split(), str(part)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdin is not None
            assert process.stderr is not None
            log = pool.submit(process.stderr.read)
            try:
                process.stdin.write(first.tobytes())
                for image in images:
                    process.stdin.write(image.tobytes())
                process.stdin.close()
            except BrokenPipeError:
                pass  # it says below why it has ended
            except BaseException:
                process.kill()
                raise
            reason = log.result().decode(errors="replace")
        _check(process.returncode, reason, path)


def _ffmpeg(path: Path) -> str:
    """The program: that of the package imageio-ffmpeg, or the system's."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        if (found := shutil.which("ffmpeg")) is not None:
            return found
        raise ValueError(
            f"{path}: films need ffmpeg: pip install imageio-ffmpeg, or name a .gif"
        ) from None
    return get_ffmpeg_exe()


def _check(code: int, reason: str, path: Path) -> None:
    """Raise what ffmpeg has ended with."""
    for number in (errno.ENOSPC, errno.EDQUOT):
        if os.strerror(number) in reason:
            raise OSError(number, os.strerror(number), str(path))
    if code != 0:
        raise ValueError(
            f"{path}: ffmpeg ended with code {code}: {' '.join(reason.split())[-200:]}"
        )
