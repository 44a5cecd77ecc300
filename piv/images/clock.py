"""One clock: `interval` between the two exposures of a pair (s), `rate` of pairs (Hz)."""

import json

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.images.file_names import PAIRINGS
from piv.images.recording import Recording

INTERVAL_HELP = "s between the two exposures of a pair"
RATE_HELP = "pairs per second"


def frame_times(
    frames: ndarray, mode: str, interval: float | None, rate: float | None, skip: int = 0
) -> ndarray | None:
    """Times (s) of frames by number, from the clock of their pairs; None where it is not known.

    interval: s between the two exposures of a pair; rate: pairs per second. Of time-resolved frames
    one gives the other. ValueError where the two contradict one another.
    """
    for name, value in (("interval", interval), ("rate", rate)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"`{name}` must be positive, got {value:g}")
    if mode == PAIRINGS[0]:
        if interval and rate and abs(interval * rate / (1 + skip) - 1) > 1e-3:
            raise ValueError(
                f"`interval` {interval:g} s and `rate` {rate:g} Hz contradict one another for "
                f"the pairing {mode!r}; give one of them, or `pairing = {PAIRINGS[1]}`"
            )
        period = interval / (1 + skip) if interval is not None else rate and 1 / rate
        return None if period is None else np.asarray(frames, float) * period
    if rate is not None and interval is None:
        raise ValueError("`rate` of pairs needs `interval`, the time between their two exposures")
    if rate is None or interval is None:
        return None
    if interval * rate >= 1:
        raise ValueError(
            f"`interval` {interval:g} s does not fit between pairs at `rate` {rate:g} Hz"
        )
    pair, second = np.divmod(frames, 2)
    return pair / rate + second * interval


def set_clock(
    recording: Recording, mode: str, interval: float | None, rate: float | None, skip: int = 0
) -> None:
    """Give a recording the times that `interval` and `rate` (as of `frame_times`) state."""
    times = frame_times(np.arange(len(recording)), mode, interval, rate, skip)
    if mode == PAIRINGS[1] and interval is not None:
        if times is None and len(recording) == 2:
            times = interval * np.arange(2.0)
        elif times is None and recording.times is not None:
            times = recording.times.copy()
            times[1::2] = times[: len(times) // 2 * 2 : 2] + interval
            if not (np.diff(times) > 0).all():
                raise ValueError(
                    f"{recording.name}: `interval` {interval:g} s does not fit between its pairs, "
                    f"{float(np.diff(times[::2]).min()):g} s apart"
                )
        recording.interval = interval
        recording.attrs.pop("frame_rate_hz", None)
    elif times is not None:
        recording.attrs["frame_rate_hz"] = 1 / float(times[1])
    if times is not None:
        recording.times = times


def interval_of(plane: xr.Dataset, interval: float | None) -> float:
    """The interval (s) that a file states or the caller gives; ValueError for neither, or both."""
    stated = plane.attrs.get("interval")
    if stated is not None and interval is not None and abs(interval / stated - 1) > 1e-3:
        raise ValueError(f"`interval` {interval:g} contradicts the file, which states {stated:g} s")
    known = interval if stated is None else float(stated)
    if known is None:
        raise ValueError("the file states no time between the exposures of a pair; give `interval`")
    if not (np.isfinite(known) and known > 0):
        raise ValueError(f"`interval` must be positive, got {known:g}")
    return known


def seconds(plane: xr.Dataset, interval: float, rate: float | None) -> ndarray:
    """Times (s) of a series' instants, from frames by the pairing that the series was made with.

    ValueError where that is not known nor a `rate`.
    """
    time = plane["time"]
    if time.attrs.get("units") == "s":
        if rate is not None:
            raise ValueError("`rate` contradicts the file, which has its times in s")
        return time.values
    settings = json.loads(plane.attrs.get("settings", "{}"))
    mode, skip = settings.get("pairing"), settings.get("skip", 0)
    if mode is None:  # of other programs: instants are counted
        if rate is None and time.size > 1:
            raise ValueError(f"{time.size} instants without times; give `rate`, pairs per second")
        return time.values / (rate or 1.0)
    reach = (settings["frames"] - 1 if settings.get("frames", 2) > 2 else 1 + skip) / 2
    ends = np.rint(time.values[:, None] + [-reach, reach])
    times = frame_times(ends, mode, interval, rate, skip)
    if times is None:
        if time.size > 1:
            raise ValueError(f"{time.size} pairs without times; give `rate`, pairs per second")
        return np.array([interval / 2])
    return times.mean(axis=1)
