"""Which frames of a recording make a vector field."""

from dataclasses import dataclass, replace
from typing import Annotated

from piv.images.file_names import PAIRINGS
from piv.images.open_recording import pairs
from piv.images.recording import Recording


@dataclass(frozen=True)
class SequenceOptions:
    """Which frames make a vector field, and how they are prepared.

    `piv correlate --help` explains every field, which is an option there. ValueError where two of
    them contradict one another.

    Examples
    --------
    >>> piv.SequenceOptions(frames=5, preprocess="background=min,cap=3").steps
    ['background=min', 'cap=3']
    """

    pairing: Annotated[
        str | None,
        "1-2,2-3 (time-resolved) or 1-2,3-4 (pairs; default where the names end in A and B, a and "
        "b, _0 and _1 or _1 and _2; else 1-2,2-3)",
    ] = None
    skip: Annotated[int, "frames left out between the two of a pair"] = 0
    every: Annotated[int, "use every so many-th field"] = 1
    frames: Annotated[int, "2 for pairs; 3, 5, … for the multi-frame mode"] = 2
    shake: Annotated[bool, "multi-frame mode: take the camera's shake out"] = True
    preprocess: Annotated[
        str,
        "steps of piv.images.preprocess with commas, such as background=min,cap=3; "
        "none = as recorded",
    ] = "background=static"
    threads: Annotated[int, "fields computed at a time"] = 1
    ensemble: Annotated[bool, "one mean field from the summed correlations of all pairs"] = False
    keep_doubles: Annotated[
        bool, "take a picture that repeats the one before it for one of its own"
    ] = False

    @property
    def steps(self) -> list[str]:
        """Steps of the pre-processing."""
        return [step for step in self.preprocess.split(",") if step not in ("", "none")]

    def __post_init__(self) -> None:
        if self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {self.threads}")
        if self.frames != 2 and (self.frames < 3 or self.frames % 2 == 0):
            raise ValueError(
                f"frames must be 2, or odd for the multi-frame mode, got {self.frames}"
            )
        if self.frames == 2 and not self.shake:
            raise ValueError("`shake = False` is of the multi-frame mode; give 3 `frames` or more")
        if self.ensemble and self.frames != 2:
            raise ValueError("the ensemble is of pairs; leave out `frames`")
        if not isinstance(self.preprocess, str):
            raise ValueError(
                "preprocess must be one text of steps with commas, such as "
                f"'background=min,cap=3', got {self.preprocess!r}"
            )
        if "none" in self.preprocess.split(",") and self.preprocess != "none":
            raise ValueError(
                f"preprocess = {self.preprocess!r}: 'none' stands alone; "
                "leave out either it or the steps"
            )
        if self.frames > 2 and (self.pairing not in (None, PAIRINGS[0]) or self.skip):
            raise ValueError(
                "the multi-frame mode needs equally spaced frames: pairing '1-2,2-3' without skip"
            )

    def of(self, recording: Recording) -> "SequenceOptions":
        """With the pairing that the recording's names state; ValueError where they leave doubt."""
        if self.pairing is not None:
            return self
        if recording.pairing is None:
            raise ValueError(recording.pairing_doubt)
        return replace(self, pairing=recording.pairing)


def frame_sets(count: int, options: SequenceOptions) -> list[tuple[int, ...]]:
    """Indices of the frames of every vector field."""
    if options.frames == 2:
        assert options.pairing is not None  # of SequenceOptions.of
        return [
            tuple(p) for p in pairs(count, options.pairing, skip=options.skip, every=options.every)
        ]
    if count < options.frames:
        raise ValueError(
            f"{count} frames are too few for sets of {options.frames}; give fewer `frames`"
        )
    return [
        tuple(range(i, i + options.frames))
        for i in range(0, count - options.frames + 1, options.every)
    ]
