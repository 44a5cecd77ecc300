"""Recordings that are video files."""

import os
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np

from piv.images.image_files import to_grey
from piv.images.recording import Recording, UnreadableFrame

_RECENT_FRAMES = 8  # of a video, so that neighbouring pairs need no seeking


class Video(Recording):
    """A video through OpenCV: 8 bit; colour becomes luma, which codecs store in full resolution.

    Frames are decoded in order; going back further than a few frames decodes from the start again,
    because seeking by number is not exact in every container.
    """

    def __init__(self, path: Path) -> None:
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # our one sentence is enough
        self.path = path
        self._open()
        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if count < 1:
            raise ValueError(
                f"{path}: a video without frames, or whose container does not say how many"
            )
        # no times: a high-speed film is usually stored with a playing rate, not with the camera's
        super().__init__(str(path), count)
        self.files = (path,)

    def _open(self) -> None:
        if not self.path.is_file():
            raise FileNotFoundError(f"{self.path}: no such file")
        if self.path.stat().st_size == 0:
            raise ValueError(f"{self.path}: the file is empty; copy it again")
        self._capture = cv2.VideoCapture(str(self.path))
        if not self._capture.isOpened():
            raise ValueError(
                f"{self.path}: not readable as a video (damaged, or an unknown codec); save its "
                "frames as PNG, "
                f"such as with ffmpeg -i {self.path.name} frame_%05d.png, and give their folder"
            )
        self._next = 0
        self._recent: OrderedDict[int, np.ndarray] = OrderedDict()

    def _read(self, i: int) -> np.ndarray:
        if i in self._recent:
            return self._recent[i]
        if i < self._next:
            self._capture.release()
            self._open()
        while self._next <= i:
            if not self._capture.grab():
                raise UnreadableFrame(
                    f"{self.path}: decoding ended before frame {i}, though the container says "
                    f"{self.count} frames"
                )
            self._next += 1
            if self._next > i - _RECENT_FRAMES:
                _, image = self._capture.retrieve()
                self._recent[self._next - 1] = to_grey(image, "luma", str(self.path))
            while len(self._recent) > _RECENT_FRAMES:
                self._recent.popitem(last=False)
        return self._recent[i]

    def close(self) -> None:
        """Close the video."""
        self._capture.release()
