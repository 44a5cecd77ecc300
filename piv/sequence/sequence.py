"""A whole recording to a plane series: field by field, in parallel, resumable."""

import json
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray
from tqdm import tqdm

from piv.correlation.options import Options
from piv.correlation.pair import correlate_pair
from piv.correlation.pair_images import check_images
from piv.formats.plane_series import AXES, provenance, usable
from piv.formats.recording import CAMERA, pixel_of
from piv.formats.resumable import SeriesWriter
from piv.images.image_files import PAIRINGS
from piv.images.open_recording import pairs
from piv.images.preprocess import Preprocessor
from piv.images.recording import Recording
from piv.sequence.camera_shake import LEAST_SIDE, LEAST_VECTORS
from piv.sequence.chunks import BLOCK, Chunk, chunk_path, is_chunk, series_key
from piv.sequence.ensemble import correlate_ensemble
from piv.sequence.multiframe import correlate_frames

# s: a thread that needs Python's lock for a moment does not wait ten times as long for it
_HAND_OVER = 5e-4
_ALTERNATE = 0.15  # of the vectors: by so much fewer in every other field mean frames of two pairs


@dataclass(frozen=True)
class SequenceOptions:
    """Which frames make a vector field."""

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
            raise ValueError("shake = false is of the multi-frame mode; give frames = 3 or more")
        if self.ensemble and self.frames != 2:
            raise ValueError("the ensemble is of pairs; leave out --frames")
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
            f"{count} frames are too few for sets of {options.frames}; give a smaller --frames"
        )
    return [
        tuple(range(i, i + options.frames))
        for i in range(0, count - options.frames + 1, options.every)
    ]


def correlate_recording(
    recording: Recording,
    output: str | Path,
    options: Options,
    sequence: SequenceOptions,
    *,
    chunk: tuple[int, int] | None = None,
    quiet: bool = True,
) -> Path:
    """Correlate a recording into the plane series `output` (docs/formats.md); returns its path.

    SI where the recording has scale and times, else px and frames. Its finger variables are copied.
    Finished fields survive an interruption in `<output>.part` and are not computed again.
    The result depends neither on that nor on the number of threads.
    chunk: (k, n) writes only the k-th of n parts of the fields, beside `output`, for `chunks.join`.
    """
    sequence = sequence.of(recording)
    image = recording.frame(0)
    try:
        check_images([image], options.window)
    except ValueError as error:
        raise ValueError(f"{recording.name}: {error}") from None
    sets = frame_sets(len(recording), sequence)
    part = Chunk.of_series(len(sets), *chunk) if chunk else None
    if chunk and part:
        if sequence.ensemble:
            raise ValueError("an ensemble is one field: leave out --chunk or --ensemble")
        sets = sets[part.first : part.first + part.count]
        output = chunk_path(output, *chunk)
    clean = Preprocessor(sequence.steps, recording)
    cleaned: dict[int, tuple[ndarray, Any]] = {}  # of the last set: most share some

    def load(indices: tuple[int, ...]) -> tuple[list[ndarray], list[Any]]:
        now = {
            i: cleaned[i]
            if i in cleaned
            else (clean(recording.frame(i)), clean.mask(recording.mask(i)))
            for i in indices
        }
        cleaned.clear()
        cleaned.update(now)
        return [image for image, _ in now.values()], [mask for _, mask in now.values()]

    units = _SeriesUnits.of(recording, sets)
    x, y = units.axes(*options.axes(recording.shape))
    settings = {**asdict(options), **asdict(sequence), "preprocess": clean.steps}
    for key in ("threads", "ensemble")[: 1 if sequence.ensemble else 2]:
        del settings[key]
    attrs = {"source": "piv", **provenance(**settings), **_carried(recording)}
    if units.interval is not None and np.ptp(units.interval) <= 1e-6 * units.interval[0]:
        attrs["interval"] = float(f"{np.mean(units.interval):.12g}")
    identity = series_key([_seen(recording), settings, units.scale, units.origin, units.names])
    if part is not None:
        attrs["chunk"] = identity = json.dumps(asdict(part) | {"identity": identity})
        if is_chunk(output, identity):
            return Path(output)
    time = units.time
    if sequence.ensemble:
        if "interval" not in attrs and units.interval is not None:
            raise ValueError(f"{recording.name}: an ensemble needs pairs of equal intervals")
        time = time.mean(keepdims=True)
    writer = SeriesWriter(output, x, y, time, units.names, attrs, identity)
    threads_before, interval_before = cv2.getNumThreads(), sys.getswitchinterval()
    shake_unknown, shares = 0, {}
    try:
        if sequence.ensemble:

            def pair(i: int) -> tuple[Any, Any, Any]:
                (a, b), masks = load(sets[i])
                return a, b, masks

            plane = correlate_ensemble(pair, len(sets), quiet=quiet, **asdict(options))
            writer.write(0, units.fields(plane, 0))
            return writer.finish()
        cv2.setNumThreads(1)  # fields are the unit of parallel work
        sys.setswitchinterval(_HAND_OVER)
        missing = [k for k in range(len(sets)) if k not in writer.done]
        bar = tqdm(
            total=len(sets),
            initial=len(writer.done),
            unit="field",
            desc="correlate",
            disable=quiet or None,
        )
        for k, plane in _in_parallel(missing, sets, load, options, sequence):
            writer.write(k, units.fields(plane, k))
            shares[k] = float(usable(plane).mean())
            shake_unknown += plane.attrs.get("shake_unknown", 0)
            bar.update()
        bar.close()
        for name, shape in recording.finger.items():
            values = _finger_in_sets(recording, name, sets)
            writer.add(name, AXES[name], (len(sets), *shape), values)
        return writer.finish()
    finally:
        sys.setswitchinterval(interval_before)
        cv2.setNumThreads(threads_before)
        writer.close()
        if sequence.pairing == PAIRINGS[0] and (apart := alternating(shares)):
            print(
                f"{output}: the shares of usable vectors alternate from field to field, "
                f"{apart[0]:.0%} and {apart[1]:.0%} in the median: are these pairs? "
                f"Then give --pairing {PAIRINGS[1]}",
                file=sys.stderr,
            )
        if shake_unknown:
            print(
                f"{output}: the camera's shake could not be measured in {shake_unknown} of "
                f"{len(sets)} fields, which use their frames as recorded: it needs "
                f"{LEAST_SIDE} px each way and {LEAST_VECTORS} vectors that all pairs have; "
                "--no-shake (shake = false) does not look for it",
                file=sys.stderr,
            )


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
        if len(images) == 2:
            return correlate_pair(*images, mask=masks, **asdict(options))
        return correlate_frames(images, mask=masks, shake=sequence.shake, **asdict(options))

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


@dataclass(frozen=True)
class _SeriesUnits:
    """From px and frames to the units of the file."""

    scale: float
    origin: tuple[float, float]
    time: ndarray
    interval: ndarray | None  # s, per field; None where it is not known
    names: dict[str, str]  # of the axes, time and velocity

    @classmethod
    def of(cls, recording: Recording, sets: list[tuple[int, ...]]) -> "_SeriesUnits":
        """m/s where scale and interval are known, else px; s where times are known, else frames."""
        scale = pixel_of(recording.attrs)
        times = recording.times
        left, bottom = recording.corner_px
        interval = None
        if times is None:
            middle = np.array([0.5 * (s[0] + s[-1]) for s in sets])
            if recording.interval is not None:
                interval = np.full(len(sets), recording.interval)
        else:
            middle = np.array([0.5 * (times[s[0]] + times[s[-1]]) for s in sets])
            interval = np.array([(times[s[-1]] - times[s[0]]) / (len(s) - 1) for s in sets])
            if not (interval > 0).all():
                raise ValueError(
                    f"{recording.name}: the frames' times do not ascend; "
                    "give --interval or --rate in their place"
                )
        units = {"x": "m", "y": "m", "time": "frame" if times is None else "s", "u": "m/s"}
        if scale is None or interval is None:
            units |= {"x": "px", "y": "px", "u": "px"}
            return cls(1.0, (-left, -bottom), middle, interval, units)
        origin = (
            float(recording.attrs.get("origin_x_px", 0)) - left,
            float(recording.attrs.get("origin_y_px", 0)) - bottom,
        )
        return cls(scale, origin, middle, interval, units)

    def axes(self, x: ndarray, y: ndarray) -> tuple[ndarray, ndarray]:
        """Coordinates of the vectors from those in px."""
        return (x - self.origin[0]) * self.scale, (y - self.origin[1]) * self.scale

    def fields(self, plane: xr.Dataset, index: int) -> dict[str, ndarray]:
        """Variables of one field in the file's units."""
        per_second = 1.0
        if self.names["u"] == "m/s" and self.interval is not None:
            per_second = self.scale / self.interval[index]
        factor = dict.fromkeys(("u", "v", "u_std", "v_std"), per_second)
        return {str(n): plane.variables[n].values * factor.get(str(n), 1) for n in plane.data_vars}


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
