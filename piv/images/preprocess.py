"""Cleaning of particle images before correlation; every step is optional and named in the result.

`Preprocessor(["background=min", "highpass=8", "cap=3"], recording)` is called with a frame and
gives the cleaned one as float32; `Preprocessor.steps` is the list to store in the result's
attributes. Steps run in their order: `background=min|mean` (temporal, of the whole recording),
`background=static` (only where something stands still, and left out where it would not pay),
`clahe=<tile px>`, `highpass=<sigma px>`, `cap=<n>` (intensities above median + n standard
deviations are cut, Shavit et al. 2007).
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.images.absent_frames import FrameCheck
from piv.images.recording import Recording
from piv.images.static_background import static_background

# of a longer recording, evenly chosen: more changes nothing that is visible
_BACKGROUND_FRAMES = 500
_CLIP = 2.0  # limit of the contrast of clahe


def background(recording: Recording, kind: str = "min") -> ndarray:
    """Temporal minimum or mean of at most BACKGROUND_FRAMES frames, float32."""
    if kind not in ("min", "mean"):
        raise ValueError(f"background must be 'min', 'mean' or 'static', got {kind!r}")
    if len(recording) < 3:
        raise ValueError(
            f"{recording.name}: a background needs at least 3 frames, this has {len(recording)}; "
            "give `preprocess = none`, or the other steps only"
        )
    count = min(_BACKGROUND_FRAMES, len(recording))
    chosen = np.unique(np.linspace(0, len(recording) - 1, count).astype(int))
    images = FrameCheck(recording).images(chosen)
    total, number = next(images).astype(np.float64), 1
    for image in images:
        total, number = np.minimum(total, image) if kind == "min" else total + image, number + 1
    return (total if kind == "min" else total / number).astype(float32)


def _subtract_background(image: ndarray, dark: ndarray) -> ndarray:
    """Image minus background, cut at zero; float32."""
    return np.maximum(image.astype(float32) - dark, 0)


def _clahe(image: ndarray, tile_px: float) -> ndarray:
    """Contrast-limited adaptive histogram equalisation in tiles of `tile_px`, float32."""
    if not tile_px >= 8:
        raise ValueError(f"clahe: tiles need at least 8 px, got {tile_px}")
    top = float(image.max())
    if top <= 0:
        return image.astype(float32)
    rows, columns = (max(1, round(n / tile_px)) for n in image.shape)
    levels = np.round(image.astype(float32) * (65535 / top)).astype(np.uint16)
    return cv2.createCLAHE(_CLIP, (columns, rows)).apply(levels).astype(float32) * (top / 65535)


def _highpass(image: ndarray, sigma_px: float) -> ndarray:
    """Image minus its Gaussian mean of width `sigma_px`, cut at zero."""
    if not sigma_px > 0:
        raise ValueError(f"highpass: sigma must be positive, got {sigma_px}")
    image = image.astype(float32)
    return np.maximum(image - cv2.GaussianBlur(image, (0, 0), sigma_px), 0)


def _cap_intensity(image: ndarray, n: float) -> ndarray:
    """Intensities cut above median + n standard deviations, against single bright particles."""
    if not n > 0:
        raise ValueError(f"cap: n must be positive, got {n}")
    image = image.astype(float32)
    return np.minimum(image, float(np.median(image)) + n * float(image.std()))


# of each step its default value and its function
_STEPS: dict[str, tuple[str, Callable[..., ndarray]]] = {
    "background": ("min", _subtract_background),
    "clahe": ("64", _clahe),
    "highpass": ("8", _highpass),
    "cap": ("3", _cap_intensity),
}


class Preprocessor:
    """The chain of named steps as a function of a frame."""

    def __init__(self, steps: Sequence[str], recording: Recording) -> None:
        self.steps: list[str] = []
        self._chain: list[tuple[Callable[..., ndarray], ndarray | float]] = []
        self._hidden: ndarray | None = None
        for text in steps:
            name, _, value = text.partition("=")
            if name not in _STEPS:
                known = ", ".join(_STEPS)
                raise ValueError(f"unknown pre-processing step {text!r}; known are {known}")
            default, function = _STEPS[name]
            value = value or default
            argument: ndarray | float
            if (name, value) == ("background", "static"):
                if (static := static_background(recording)) is None:
                    continue
                argument, self._hidden = static
            elif name == "background":
                argument = background(recording, value)
            else:
                try:
                    argument = float(value)
                except ValueError:
                    step = f"pre-processing step '{name}={value}'"
                    raise ValueError(f"{step}: {value!r} is not a number") from None
            self.steps.append(f"{name}={value}")
            self._chain.append((function, argument))

    def mask(self, body: ndarray | None) -> ndarray | None:
        """A frame's mask (true = body), with the pixels that something static saturates."""
        if self._hidden is None or not self._hidden.any():
            return body
        return self._hidden if body is None else self._hidden | (np.asarray(body) != 0)

    def __call__(self, image: ndarray) -> ndarray:
        """The cleaned frame: float32, or the frame itself without steps."""
        for function, argument in self._chain:
            image = function(image, argument)
        return image
