"""A whole recording to a plane series: field by field, in parallel, resumable."""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray
from tqdm import tqdm

from piv.correlation.nodes import vector_axes
from piv.correlation.options import Options
from piv.correlation.pair import correlate_pair
from piv.correlation.pair_images import BlankImage, check_images
from piv.files.errors import warn
from piv.formats.plane_series import (
    AXES,
    NO_PICTURE,
    REPEATED,
    absent,
    absent_field,
    provenance,
    usable,
)
from piv.formats.recording import CAMERA
from piv.formats.resumable import SeriesWriter
from piv.images.absent_frames import absent_frames
from piv.images.file_names import PAIRINGS
from piv.images.preprocess import Preprocessor
from piv.images.recording import Recording, UnreadableFrame
from piv.sequence.camera_shake import LEAST_SIDE, LEAST_VECTORS
from piv.sequence.chunks import BLOCK, Chunk, chunk_path, is_chunk, series_key
from piv.sequence.ensemble import correlate_ensemble
from piv.sequence.frame_sets import SequenceOptions, frame_sets
from piv.sequence.multiframe import correlate_frames
from piv.sequence.series_units import SeriesUnits

# s: a thread that needs Python's lock for a moment does not wait ten times as long for it
_HAND_OVER = 5e-4
_NAMED = 5  # frames without a field that are named
_ALTERNATE = 0.15  # of the vectors: by so much fewer in every other field mean frames of two pairs


def correlate_recording(
    recording: Recording,
    output: str | Path,
    options: Options,
    sequence: SequenceOptions,
    *,
    chunk: tuple[int, int] | None = None,
    quiet: bool = True,
) -> Path:
    """Correlate a recording into a plane series (docs/formats.md).

    Finished fields survive an interruption in `<output>.part` and are not computed again. The
    result depends neither on that nor on the number of threads. `piv.correlate` does it in one
    call.

    Parameters
    ----------
    recording
        As of `open_recording`; its finger variables are copied.
    output
        The file, .h5.
    options, sequence
        How images are correlated, and which make a field.
    chunk
        (k, n) writes only the k-th of n parts of the fields, beside `output`, for `chunks.join`.
    quiet
        Whether no bar of progress is shown.

    Returns
    -------
    pathlib.Path
        The file: SI where the recording has scale and times, else px and frames.

    Raises
    ------
    ValueError
        Where no field can be made.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     piv.correlate_recording(film, "film.h5", piv.Options(window=24), piv.SequenceOptions())
    PosixPath('film.h5')
    """
    sequence = sequence.of(recording)
    image = recording.frame(0)
    try:
        check_images([image], options.window)
    except ValueError as error:
        raise ValueError(f"{recording.name}: {error}") from None
    sets = frame_sets(len(recording), sequence)
    part = Chunk.of_series(len(sets), *chunk) if chunk else None
    here = slice(part.first, part.first + part.count) if part else slice(None)
    if not sequence.keep_doubles and np.ptp(image) > 0 and _all_equal(recording, sets):
        warn(
            f"{recording.name}: all pictures are equal, so every vector is at rest; give two "
            "exposures, or `keep_doubles` where this is meant"
        )
    lost = _absent_fields(recording, sets, here, sequence)
    if chunk and part:
        if sequence.ensemble:
            raise ValueError("an ensemble is one field: leave out `chunk` or `ensemble`")
        sets = sets[here]
        output = chunk_path(output, *chunk)
    if sequence.ensemble:
        sets, lost = [frames for k, frames in enumerate(sets) if k not in lost], {}
    frames = _Frames(recording, Preprocessor(sequence.steps, recording))
    units = SeriesUnits.of(recording, sets)
    x, y = units.axes(*vector_axes(recording.shape, options.spacing))
    settings = {**asdict(options), **asdict(sequence), "preprocess": frames.clean.steps}
    attrs, identity = _attributes(recording, units, settings, part)
    if part is not None and is_chunk(output, identity):
        return Path(output)
    time = units.time
    if sequence.ensemble:
        if "interval" not in attrs and units.interval is not None:
            raise ValueError(f"{recording.name}: an ensemble needs pairs of equal intervals")
        time = time.mean(keepdims=True)
    writer = SeriesWriter(output, x, y, time, units.names, attrs, [identity, recording.stamp])
    threads_before, interval_before = cv2.getNumThreads(), sys.getswitchinterval()
    tally = _Tally(len(sets))
    try:
        if sequence.ensemble:
            plane = correlate_ensemble(
                lambda i: frames.pair(sets[i]), len(sets), quiet=quiet, **asdict(options)
            )
            writer.write(0, units.fields(plane, 0))
            return writer.finish()
        cv2.setNumThreads(1)  # fields are the unit of parallel work
        sys.setswitchinterval(_HAND_OVER)
        for k in sorted(lost.keys() - writer.done):
            writer.write(k, absent_field((y.size, x.size), lost[k]))
        missing = [k for k in range(len(sets)) if k not in writer.done and k not in lost]
        bar = tqdm(total=len(sets), initial=len(sets) - len(missing), unit="field",
                   desc="correlate", disable=quiet or None)  # fmt: skip
        for k, plane in _in_parallel(missing, sets, frames.of, options, sequence):
            writer.write(k, units.fields(plane, k))
            tally.add(k, plane)
            bar.update()
        bar.close()
        if tally.blank == len(sets):
            raise ValueError(f"{recording.name}: no frame shows particles where it is not masked")
        for name, shape in recording.finger.items():
            values = _finger_in_sets(recording, name, sets)
            writer.add(name, AXES[name], (len(sets), *shape), values)
        return writer.finish()
    finally:
        sys.setswitchinterval(interval_before)
        cv2.setNumThreads(threads_before)
        writer.close()
        tally.tell(output, sequence.pairing == PAIRINGS[0])


class _Tally:
    """Counts of fields that need a word to the user."""

    def __init__(self, count: int) -> None:
        self.count, self.blank, self.shake_unknown = count, 0, 0
        self.shares: dict[int, float] = {}  # of usable vectors
        self.retried: Counter[str] = Counter()

    def add(self, k: int, plane: xr.Dataset) -> None:
        """Count the field of set `k`."""
        if absent(plane):
            self.blank += 1
        else:
            self.shares[k] = float(usable(plane).mean())
        self.shake_unknown += plane.attrs.get("shake_unknown", 0)
        self.retried.update([plane.attrs["retried"]] if "retried" in plane.attrs else [])

    def tell(self, output: str | Path, neighbours: bool) -> None:
        """Warn of what was counted; neighbours: whether a field begins with each frame."""
        if neighbours and (apart := alternating(self.shares)):
            warn(
                f"{output}: the shares of usable vectors alternate from field to field, "
                f"{apart[0]:.0%} and {apart[1]:.0%} in the median: are these pairs? "
                f"Then give `pairing = {PAIRINGS[1]}`"
            )
        for way, number in self.retried.most_common():
            warn(
                f"{output}: {number} of {self.count} fields were correlated another way, which "
                f"explains more of their pictures: {way}"
            )
        if self.blank:
            warn(
                f"{output}: {self.blank} fields are absent: a frame of theirs is of one grey level "
                "where it is not masked"
            )
        if self.shake_unknown:
            warn(
                f"{output}: the camera's shake could not be measured in {self.shake_unknown} of "
                f"{self.count} fields, which use their frames as recorded: it needs "
                f"{LEAST_SIDE} px each way and {LEAST_VECTORS} vectors that all pairs have; "
                "`shake = False` does not look for it"
            )


class _Frames:
    """Frames and masks of a recording, pre-processed; those of the last set are kept."""

    def __init__(self, recording: Recording, clean: Preprocessor) -> None:
        self.clean, self._recording = clean, recording
        self._last: dict[int, tuple[ndarray, Any]] = {}  # most sets share some

    def of(self, indices: tuple[int, ...]) -> tuple[list[ndarray], list[Any]]:
        """Read the images and the masks of a set."""
        self._last = {i: self._last.get(i) or self._read(i) for i in indices}
        images, masks = zip(*self._last.values(), strict=True)
        return list(images), list(masks)

    def pair(self, indices: tuple[int, ...]) -> tuple[ndarray, ndarray, list[Any]]:
        """Read a pair, as the ensemble takes it."""
        (a, b), masks = self.of(indices)
        return a, b, masks

    def _read(self, i: int) -> tuple[ndarray, Any]:
        return self.clean(self._recording.frame(i)), self.clean.mask(self._recording.mask(i))


def _attributes(
    recording: Recording, units: SeriesUnits, settings: dict[str, Any], part: Chunk | None
) -> tuple[dict[str, Any], str]:
    """Root attributes of the series, and what identifies it when it is resumed."""
    unused = ("threads",) if settings["ensemble"] else ("threads", "ensemble")
    settings = {key: value for key, value in settings.items() if key not in unused}
    attrs = {"source": "piv", **provenance(**settings), **_carried(recording)}
    if units.interval is not None and np.ptp(units.interval) <= 1e-6 * units.interval[0]:
        attrs["interval"] = float(f"{np.mean(units.interval):.12g}")
    identity = series_key([_seen(recording), settings, units.scale, units.origin, units.names])
    if part is not None:
        about = asdict(part) | {"identity": identity, "stamp": recording.stamp}
        attrs["chunk"] = identity = json.dumps(about)
    return attrs, identity


def _all_equal(recording: Recording, sets: list[tuple[int, ...]]) -> bool:
    """Whether all pictures of `sets` are the same; false where one cannot be read."""
    first, *others = sorted({i for frames in sets for i in frames})
    try:
        picture = recording.frame(first)
        return all(np.array_equal(picture, recording.frame(i)) for i in others)
    except UnreadableFrame:
        return False


def _absent_fields(
    recording: Recording, sets: list[tuple[int, ...]], part: slice, sequence: SequenceOptions
) -> dict[int, int]:
    """Flag of each field of `sets[part]` that is absent, by its number in it; warns of them.

    ValueError where none is left, unless the only one: its own error says more.
    """
    if len(sets) < 2:
        return {}
    faults = absent_frames(
        recording, sets, part, couples=sequence.pairing == PAIRINGS[1],
        repeats=not sequence.keep_doubles,
    )  # fmt: skip
    flags = {
        k: max(faults[i].flag for i in frames if i in faults)
        for k, frames in enumerate(sets[part])
        if not faults.keys().isdisjoint(frames)
    }
    if not flags:
        return {}
    some = [fault.why for fault in faults.values()][:_NAMED]
    more = f"\n... and {len(faults) - len(some)} more frames" if len(faults) > len(some) else ""
    repeated = any(fault.flag == REPEATED for fault in faults.values())
    way = "; `keep_doubles` takes a repeated picture for one of its own" if repeated else ""
    if len(flags) == len(sets):
        raise ValueError(
            f"{recording.name}: no field has whole frames of its own ({some[0]}); give each "
            f"picture once{way}"
        )
    count = len(sets[part])
    text = f"{recording.name}: fields with such frames are absent, {len(flags)} of {count}{way}"
    warn("\n".join(some) + f"{more}\n{text}")
    return flags


def alternating(shares: dict[int, float]) -> tuple[float, float] | None:
    """Median shares of even and odd fields where those of one kind are all clearly lower."""
    kinds = [np.array([s for k, s in shares.items() if k % 2 == odd]) for odd in (0, 1)]
    if min(map(len, kinds)) < 2:
        return None
    low, high = sorted(kinds, key=np.median)
    if np.median(high) - np.median(low) < _ALTERNATE or low.max() >= high.min():
        return None
    return float(np.median(kinds[0])), float(np.median(kinds[1]))


def _seen(recording: Recording) -> list[Any]:
    """Identity of a recording: name, length, size, first frame's mean, ends in time, key."""
    times = recording.times
    ends = None if times is None else [float(times[0]), float(times[-1])]
    mean = float(np.mean(recording.frame(0)))
    return [recording.name, len(recording), list(recording.shape), mean, ends, recording.key]


def _in_parallel(
    missing, sets, load, options: Options, sequence: SequenceOptions
) -> Iterator[tuple[int, xr.Dataset]]:
    """Fields in order; frames are read here, at most threads + 1 sets wait in memory."""

    def field(images: list[ndarray], masks: list[Any]) -> xr.Dataset:
        try:
            if len(images) == 2:
                return correlate_pair(*images, mask=masks, **asdict(options))
            return correlate_frames(images, mask=masks, shake=sequence.shake, **asdict(options))
        except BlankImage:
            if len(sets) == 1:
                raise
            x, y = vector_axes(images[0].shape, options.spacing)
            nothing = absent_field((y.size, x.size), NO_PICTURE)
            return xr.Dataset({name: (("y", "x"), values) for name, values in nothing.items()})

    with ThreadPoolExecutor(sequence.threads) as pool:
        running: list[tuple[int, Future]] = []
        try:
            for k in missing:
                running.append((k, pool.submit(field, *load(sets[k]))))
                if len(running) > sequence.threads:
                    done, future = running.pop(0)
                    yield done, future.result()
            for done, future in running:
                yield done, future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _carried(recording: Recording) -> dict[str, Any]:
    """Root attributes of the recording that stay true of its vectors."""
    names = [*CAMERA, "seed"]
    names += ["tip_width"] if recording.finger else []
    return {n: recording.attrs[n] for n in names if recording.attrs.get(n) is not None}


def _finger_in_sets(
    recording: Recording, name: str, sets: list[tuple[int, ...]]
) -> Iterator[ndarray]:
    """A finger variable at the middle of each set, block by block; directions stay unit vectors."""
    for begin in range(0, len(sets), BLOCK):
        block = sets[begin : begin + BLOCK]
        first = block[0][0]
        values = recording.variable(name, slice(first, block[-1][-1] + 1))
        middle = np.stack([0.5 * (values[s[0] - first] + values[s[-1] - first]) for s in block])
        if name.endswith("_direction"):
            middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
        yield middle
