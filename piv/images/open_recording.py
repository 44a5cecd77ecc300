"""Opening recordings of any kind, and pairing their frames.

Frames stay in image order (row 0 at the top) through masks and pre-processing.
`piv.correlation.pair` gives its result in px with y up from the centre of the bottom row of pixels;
`piv.images.calibration` takes such px to metres. `row_to_y_px` is the relation between the two, the
only flip of y in the project.
"""

import glob
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from piv.images.file_names import PAIRINGS, in_couples
from piv.images.image_files import COLOURS, JPEG_SUFFIXES, ImageFiles
from piv.images.recording import Recording
from piv.images.recordings.cine import Cine
from piv.images.recordings.davis import DavisImages
from piv.images.recordings.double_frames import DoubleFrames
from piv.images.recordings.photron import Photron, exported, set_rate
from piv.images.recordings.recording_file import RecordingFile
from piv.images.recordings.tiff import TIFF_SUFFIXES
from piv.images.recordings.video import Video

IMAGE_SUFFIXES = (*TIFF_SUFFIXES, ".png", ".bmp", *JPEG_SUFFIXES, ".pgm")
DAVIS_SUFFIXES = (".im7",)
VIDEO_SUFFIXES = (".avi", ".mp4", ".mov", ".mkv", ".wmv", ".m4v", ".webm")
PHOTRON_SUFFIXES = (".mraw", ".cihx", ".cih")
CINE_SUFFIXES = (".cine",)
HDF5_SUFFIXES = (".h5", ".hdf5")

__all__ = ["PAIRINGS", "Recording", "open_recording", "pairs", "row_to_y_px"]


def open_recording(
    source: str | Path | Sequence[str | Path],
    *,
    colour: str = "refuse",
    layout: str | None = None,
) -> Recording:
    """Open a recording of any kind for lazy reading; a context manager.

    Parameters
    ----------
    source
        Image files in their order, a folder or a glob of images (names in natural order: 2 before
        10), a TIFF stack, a video, a Photron .mraw/.cihx/.cih, a Phantom .cine, DaVis .im7, or
        images.h5.
    colour
        How coloured images become grey: refuse, luma or green (`piv.images.image_files.to_grey`).
    layout
        "top-bottom" or "left-right" where each picture holds both exposures of a pair.

    Returns
    -------
    Recording
        `len(r)`, `r.frame(i)` (row 0 at the top), `r.mask(i)`, `r.times` (s, to be set where they
        are not known), `r.attrs`.

    Raises
    ------
    ValueError, FileNotFoundError
        One sentence with the file and the remedy.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     len(film), film.shape
    (6, (192, 224))
    """
    if isinstance(source, str | Path):
        paths = files_of(source)
    else:
        paths = files_of(source[0]) if len(source) == 1 else [Path(p) for p in source]
    if not paths:
        raise ValueError("name a recording: image files, a folder, a video, an .mraw or an .h5")
    if colour not in COLOURS:
        raise ValueError(f"`colour` must be one of {', '.join(COLOURS)}, got {colour!r}")
    recording = _open_files(paths, colour)
    return recording if layout is None else DoubleFrames(recording, layout)


def _open_files(paths: list[Path], colour: str) -> Recording:
    suffixes = {p.suffix.lower() for p in paths}
    if suffixes <= set(IMAGE_SUFFIXES):
        return ImageFiles(paths, colour=colour)
    if suffixes <= set(DAVIS_SUFFIXES):
        return DavisImages(paths)
    if len(paths) > 1:
        raise ValueError(
            f"{paths[0]} and {len(paths) - 1} more: only image files can be joined to a recording"
        )
    path, suffix = paths[0], paths[0].suffix.lower()
    if suffix in PHOTRON_SUFFIXES and (files := exported(path)):
        recording = _open_files(in_couples(files), colour)
        set_rate(recording, path)
        return recording
    kinds = {
        VIDEO_SUFFIXES: Video, PHOTRON_SUFFIXES: Photron, HDF5_SUFFIXES: RecordingFile,
        CINE_SUFFIXES: Cine,
    }  # fmt: skip
    for own, kind in kinds.items():
        if suffix in own:
            recording = kind(path)
            if kind is Video:
                set_rate(recording, path)
            return recording
    known = IMAGE_SUFFIXES + DAVIS_SUFFIXES + sum(kinds, ())
    raise ValueError(f"{path}: unknown kind of recording {suffix!r}; known are {' '.join(known)}")


def files_of(source: str | Path) -> list[Path]:
    """Files of a name, a folder or a glob, in natural order; FileNotFoundError or ValueError."""
    path = Path(source)
    if path.is_dir():
        read = IMAGE_SUFFIXES + DAVIS_SUFFIXES
        images = [p for p in path.iterdir() if p.suffix.lower() in read and p.is_file()]
        if not images:
            raise ValueError(f"{path}: the folder holds no image ({' '.join(read)})")
        kinds = sorted({p.suffix.lower() for p in images})
        if len(kinds) > 1:
            raise ValueError(
                f"{path}: the folder mixes {' and '.join(kinds)}; choose with a glob such as "
                f"'*{kinds[0]}'"
            )
        return in_couples(images)
    if path.exists() or not glob.has_magic(str(source)):
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file or folder")
        return [path]
    files = [Path(p) for p in glob.glob(str(source))]
    if not files:
        raise FileNotFoundError(f"{source}: no file matches")
    return in_couples(files)


def pairs(n: int, mode: str = "1-2,2-3", *, skip: int = 0, every: int = 1) -> list[tuple[int, int]]:
    """Indices of the two frames of every pair in a recording of `n` frames.

    `mode` "1-2,2-3": time-resolved, each frame with the one `1 + skip` later; "1-2,3-4":
    frame-straddling couples, where `skip` has no meaning. `every`: keep each `every`-th pair.
    Raises ValueError where no pair remains, and for an odd `n` in couples.
    """
    if mode not in PAIRINGS:
        raise ValueError(
            f"pairing must be one of {' and '.join(map(repr, PAIRINGS))}, got {mode!r}"
        )
    if skip < 0 or every < 1:
        raise ValueError(
            f"skip must be at least 0 and every at least 1, got skip={skip}, every={every}"
        )
    if mode == "1-2,2-3":
        index_pairs = [(i, i + 1 + skip) for i in range(n - 1 - skip)]
    else:
        if skip:
            raise ValueError(
                "skip has no meaning with the pairing '1-2,3-4'; use 'every' to leave out couples"
            )
        if n % 2:
            raise ValueError(
                f"{n} frames cannot be paired '1-2,3-4': the last frame has no partner"
            )
        index_pairs = [(i, i + 1) for i in range(0, n, 2)]
    if not index_pairs:
        raise ValueError(f"{n} frames give no pair with the pairing {mode!r} and skip={skip}")
    return index_pairs[::every]


def row_to_y_px(row: np.ndarray | float, rows: int) -> np.ndarray:
    """Image row (0 at the top) to y in px (up, 0 at the bottom row's centre), and back."""
    return (rows - 1) - np.asarray(row, float)
