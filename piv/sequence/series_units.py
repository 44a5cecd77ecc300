"""From px and frames of a recording to the units of its plane series."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.formats.recording import pixel_of
from piv.images.recording import Recording


@dataclass(frozen=True)
class SeriesUnits:
    """From px and frames to the units of the file."""

    scale: float
    origin: tuple[float, float]
    time: ndarray
    interval: ndarray | None  # s, per field; None where it is not known
    names: dict[str, str]  # of the axes, time and velocity

    @classmethod
    def of(cls, recording: Recording, sets: list[tuple[int, ...]]) -> "SeriesUnits":
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
                    "give `interval` or `rate` in their place"
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
