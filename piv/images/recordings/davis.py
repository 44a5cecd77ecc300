"""Image buffers of DaVis, .im7, through lvpyio, whose library ends its process on damaged files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from piv.files.child_process import read_in_child
from piv.files.errors import one_line
from piv.images.file_names import PAIRINGS
from piv.images.image_files import to_grey
from piv.images.recording import Recording, UnreadableFrame


def read_with_lvpyio(path: Path, read: Callable[..., Any], *more: Any) -> Any:
    """`read(path, *more)` in a process of its own.

    ValueError where lvpyio is not installed or cannot read the file; FileNotFoundError.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        import lvpyio  # noqa: F401  # here, and not in every child: loading it takes a second
    except ImportError:
        raise ValueError(
            f"{path}: DaVis files need the package lvpyio, which may be used but is not free "
            "software: pip install lvpyio"
        ) from None
    try:
        return read_in_child(read, str(path.resolve()), *more)
    except Exception as error:  # the library raises its own kinds
        raise UnreadableFrame(
            f"{path}: not a readable DaVis buffer ({one_line(error, 200)})"
        ) from error


def scale_of(scale: Any) -> tuple[float, float, str]:
    """Slope, offset and unit of a scale of lvpyio."""
    return float(scale.slope), float(scale.offset), str(scale.unit)


class DavisImages(Recording):
    """Buffers in their order, each with one frame or with the two exposures of a pair.

    Where the pictures are calibrated in mm, their scale and origin are taken.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = list(paths)
        self.in_each, self._size, x, y = read_with_lvpyio(paths[0], _look)
        name = str(paths[0]) if len(paths) == 1 else f"{paths[0]} ... {paths[-1].name}"
        super().__init__(name, self.in_each * len(paths))
        self.files = tuple(paths)
        if self.in_each == 2:
            self.pairing = PAIRINGS[1]
        if x[2] == y[2] == "mm" and abs(y[0] / x[0] + 1) < 1e-3:  # square pixels, y up
            # DaVis counts from the edge of the first pixel, we from its centre
            column, row = (-offset / slope - 0.5 for slope, offset, _ in (x, y))
            self.attrs |= {"scale_mm_per_px": abs(x[0]), "origin_x_px": column}
            self.attrs["origin_y_px"] = self._size[0] - 1 - row

    def frame_name(self, i: int) -> str:
        """What a message calls frame `i`."""
        return f"{self.paths[i // self.in_each]}: frame {i % self.in_each}"

    def _read(self, i: int) -> np.ndarray:
        path, k = self.paths[i // self.in_each], i % self.in_each
        return to_grey(read_with_lvpyio(path, _frame, k), "refuse", self.frame_name(i))


def _look(path: str) -> tuple[int, tuple[int, int], Any, Any]:
    import lvpyio

    buffer = lvpyio.read_buffer(path)
    shape = _pixels(buffer[0]).shape
    return len(buffer), shape, scale_of(buffer[0].scales.x), scale_of(buffer[0].scales.y)


def _frame(path: str, k: int) -> np.ndarray:
    import lvpyio

    return _pixels(lvpyio.read_buffer(path)[k])


def _pixels(frame: Any) -> np.ndarray:
    values = frame.as_masked_array()
    if values.dtype.names is not None:
        raise ValueError("the DaVis buffer holds vectors, not an image")
    return np.ascontiguousarray(values.data)
