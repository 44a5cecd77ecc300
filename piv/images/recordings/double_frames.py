"""Pictures that hold both exposures of a pair."""

import numpy as np

from piv.images.file_names import PAIRINGS
from piv.images.recording import Recording

LAYOUTS = ("top-bottom", "left-right")


class DoubleFrames(Recording):
    """The exposures of another recording's pictures: first the upper half, or the left one."""

    def __init__(self, whole: Recording, layout: str) -> None:
        if layout not in LAYOUTS:
            raise ValueError(f"`layout` must be one of {', '.join(LAYOUTS)}, got {layout!r}")
        super().__init__(whole.name, 2 * len(whole))
        self.whole, self._axis = whole, LAYOUTS.index(layout)
        length = whole.shape[self._axis]
        if length % 2:
            raise ValueError(
                f"{whole.frame_name(0)}: {length} px cannot be halved into two exposures; "
                f"leave out `layout`, or cut the pictures"
            )
        self.attrs, self.files, self.lossy = whole.attrs, whole.files, whole.lossy
        self.attrs.pop("frame_rate_hz", None)  # that of pairs
        self.key = whole.key
        self.pairing = PAIRINGS[1]
        self.missing = frozenset(2 * k + n for k in whole.missing for n in (0, 1))

    def _read(self, i: int) -> np.ndarray:
        return self._half(self.whole.frame(i // 2), i)

    def _half(self, picture: np.ndarray, i: int) -> np.ndarray:
        return np.split(picture, 2, axis=self._axis)[i % 2]

    def mask(self, i: int) -> np.ndarray | None:
        """The body in frame `i` where the pictures know it."""
        whole = self.whole.mask(i // 2)
        return None if whole is None else self._half(whole, i)

    def frame_name(self, i: int) -> str:
        """What a message calls frame `i`."""
        return f"{self.whole.frame_name(i // 2)}: exposure {'AB'[i % 2]}"

    def close(self) -> None:
        """Close the pictures."""
        self.whole.close()
