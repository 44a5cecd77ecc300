"""One call from images of any kind to vectors."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.correlation.options import Options, with_fields
from piv.files.errors import warn
from piv.files.settings import build
from piv.formats.plane_series import read_plane
from piv.formats.recording import CAMERA
from piv.images.clock import INTERVAL_HELP, RATE_HELP, set_clock
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.images.recording import Recording
from piv.images.recordings.double_frames import DoubleFrames
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording

_MUCH = 0.7  # of the picture: bodies in a flow are smaller
_FURTHER = ("chunk", "mask", "roi", "roi_unit", "colour", "layout")  # that no dataclass has


@dataclass(frozen=True)
class RecordingCamera:
    """Scale, origin and clock that replace those of the recording."""

    scale_mm_per_px: Annotated[
        float | None, "mm per pixel (default the recording's, else results in px)"
    ] = None
    origin_x_px: Annotated[
        float | None, "x of the origin, px from the left (default the recording's, else 0)"
    ] = None
    origin_y_px: Annotated[
        float | None, "y of the origin, px up from the bottom (default the recording's, else 0)"
    ] = None
    interval: Annotated[float | None, f"{INTERVAL_HELP} (default the recording's)"] = None
    rate: Annotated[
        float | None, f"{RATE_HELP} (default the recording's, else times in frames)"
    ] = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            origin = name.startswith("origin")
            if value is not None and not (np.isfinite(value) and (origin or value > 0)):
                raise ValueError(
                    f"{name} = {value:g}: give a {'finite' if origin else 'positive'} number"
                )


class _Arrays(Recording):
    """Pictures in memory."""

    def __init__(self, images: Sequence[Any]) -> None:
        if not len(images):
            raise ValueError("name a recording, or give two or more pictures")
        super().__init__("images", len(images))
        self._images = [np.asarray(image) for image in images]
        for k, image in enumerate(self._images):
            if image.ndim != 2:
                raise ValueError(f"image {k} is of shape {image.shape}; give 2-D grey values")
        digest = sha256()
        for image in self._images:
            digest.update(image.tobytes())
        self.key = digest.hexdigest()

    def _read(self, i: int) -> ndarray:
        return self._images[i]


@with_fields(Options, SequenceOptions, RecordingCamera)
def correlate(
    *source: Any,
    output: str | Path | None = None,
    mask: Any = None,
    roi: tuple[float, float, float, float] | None = None,
    roi_unit: str = "px",
    colour: str = "refuse",
    layout: str | None = None,
    quiet: bool = True,
    **options: Any,
) -> xr.Dataset:
    """Correlate images, a film or pairs to vectors, as `piv correlate` does.

    Parameters
    ----------
    source
        Names of two or more images, or one name: of a folder, a glob such as "run/*.tif", a film
        or a recording. Or pictures in memory, row 0 at the top: two or more arrays (row, column),
        or one (frame, row, column). Or a recording of `open_recording`.
    output
        Plane series .h5 to write, for long recordings; an interrupted call resumes. Without it the
        vectors are kept in memory.
    mask, roi, roi_unit
        As of `part_of_recording`.
    colour, layout
        As of `open_recording`.
    quiet
        Whether no bar of progress is shown.
    options
        Fields of `Options` and `SequenceOptions`; scale_mm_per_px, origin_x_px, origin_y_px,
        interval (s between the exposures of a pair) and rate (pairs per second).

    Returns
    -------
    xarray.Dataset
        u, v, their standard uncertainties, valid and flag over (time, y, x); over (y, x) where
        there is one field, as of two images. In m/s and s where scale and clock are known, else in
        px and frames.

    Raises
    ------
    ValueError, FileNotFoundError
        One sentence with the file and the remedy.
    TypeError
        For an unknown option, with the nearest spelling.

    Examples
    --------
    >>> field = piv.correlate("docs/tutorials/frames/frame_0.png",
    ...                       "docs/tutorials/frames/frame_1.png", window=24)
    >>> field["u"].dims, field["u"].attrs["units"]
    (('y', 'x'), 'px')
    """
    own = {"mask": mask, "roi": roi, "roi_unit": roi_unit, "colour": colour, "layout": layout}
    given = source[0] if len(source) == 1 else list(source)
    with TemporaryDirectory() as folder:
        path = Path(output) if output is not None else Path(folder) / "vectors.h5"
        plane = read_plane(correlate_to(given, path, own | options, quiet=quiet))
        if output is None:
            with plane:
                plane = plane.load()
    return plane.isel(time=0) if plane.sizes["time"] == 1 else plane


def correlate_to(
    source: Any, output: str | Path, settings: dict[str, Any], *, quiet: bool = True
) -> Path:
    """Correlate `source` into the plane series `output`; returns its path, that of the chunk.

    `settings`: what `correlate` takes, and chunk "k/n"; ValueError for other keys.
    """
    options, sequence, camera = build(
        settings, Options, SequenceOptions, RecordingCamera, more=_FURTHER
    )
    chunk = _chunk(settings["chunk"]) if settings.get("chunk") else None
    with _open(source, settings) as recording:
        if len(recording) < 2:
            raise ValueError(
                f"{recording.name}: one frame is no pair; give two images or a recording, or "
                "`layout` where the picture holds both exposures"
            )
        if recording.lossy and (chunk is None or chunk[0] == 1):
            warn(
                f"{recording.name}: JPEG loses detail of the particles; save TIFF or PNG where you "
                "can"
            )
        sequence = sequence.of(recording)
        assert sequence.pairing is not None
        set_clock(recording, sequence.pairing, camera.interval, camera.rate, sequence.skip)
        if (
            camera.scale_mm_per_px is not None
            and recording.times is None
            and recording.interval is None
        ):
            raise ValueError(
                f"{recording.name}: `scale_mm_per_px` gives m/s with the time between the "
                "exposures; give `interval` too"
            )
        recording.attrs |= {
            k: float(v) for k, v in vars(camera).items() if v is not None and k in CAMERA
        }
        mask = settings.get("mask")
        part = part_of_recording(
            recording, mask, settings.get("roi"), roi_unit=settings.get("roi_unit", "px")
        )
        _ask_about_mask(part, mask)
        return correlate_recording(part, output, options, sequence, chunk=chunk, quiet=quiet)


def _open(source: Any, settings: dict[str, Any]) -> AbstractContextManager[Recording]:
    """The recording of what `correlate` takes."""
    first = source[0] if isinstance(source, list | tuple) and source else source
    colour, layout = settings.get("colour", "refuse"), settings.get("layout")
    if isinstance(first, str | Path):
        return open_recording(source, colour=colour, layout=layout)
    if colour != "refuse":
        raise ValueError(f"`colour` {colour} is of files; these pictures are of grey values")
    return _borrowed(source if isinstance(source, Recording) else _Arrays(source), layout)


@contextmanager
def _borrowed(recording: Recording, layout: str | None) -> Iterator[Recording]:
    """A recording of the caller, which stays open; it gets its own scale and clock back."""
    _ = recording.shape  # the first frame read tells `bits`
    attrs, times, interval = dict(recording.attrs), recording.times, recording.interval
    try:
        yield recording if layout is None else DoubleFrames(recording, layout)
    finally:
        recording.attrs.clear()  # parts of a recording share them
        recording.attrs.update(attrs)
        recording.times, recording.interval = times, interval


def _ask_about_mask(part: Recording, mask: Any) -> None:
    """Ask where a mask leaves so little of the picture that it may be inverted."""
    body = None if mask is None else part.mask(0)
    if body is not None and (share := float(body.mean())) > _MUCH:
        name = mask if isinstance(mask, str | Path) else "the mask"
        warn(
            f"{name}: masks {share:.0%} of the picture; is it inverted? A mask is white, or true, "
            "on the body, where no vectors are"
        )


def _chunk(text: str) -> tuple[int, int]:
    """(k, n) of "k/n"."""
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal()):
        raise ValueError(f"chunk must be k/n, such as 2/8, got {text!r}")
    return int(number), int(of)
