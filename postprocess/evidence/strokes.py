"""The stroke: which instants are its middle, and how fast the tip moves."""

import numpy as np
import xarray as xr
from numpy import ndarray

# of the change of bend angle: the middle of the stroke, over which flows are compared
MIDDLE = (0.25, 0.75)
REST = 1e-6  # rad or m: less is no motion but rounding


def progress(plane: xr.Dataset) -> ndarray:
    """Bend or turn of the first finger or body over time, rad; without one its distance, m."""
    turn, tip = plane["bend"].values[:, 0], plane["tip"].values[:, 0]
    return turn if np.ptp(turn) > REST else np.linalg.norm(tip - tip[0], axis=-1)


def stroke_window(time: ndarray, done: ndarray, part: tuple[float, float]) -> tuple[float, float]:
    """Instants (s) at which the `progress` has done the fractions `part` of its largest change.

    time (n) in s, done (n) in rad or m. Half of a stroke's time lies in its last degrees, so the
    fractions are of bend. ValueError where nothing moves, or without an instant.
    """
    if done.size == 0 or np.ptp(done) < REST:
        raise ValueError(
            "the finger does not move, so its stroke has no middle; check kinematics.h5"
        )
    change = done - done[0]
    end = int(np.argmax(np.abs(change)))
    share = np.maximum.accumulate(change[: end + 1] / change[end])
    rising = np.concatenate([[True], np.diff(share) > 0])
    edges = np.interp(part, share[rising], time[: end + 1][rising])
    if part[1] >= 1.0:
        edges[1] = time[-1]  # the whole stroke includes what happens after it
    return float(edges[0]), float(edges[1])


def tip_speed(time: ndarray, tip: ndarray) -> ndarray:
    """Speed (n, finger) of the tips, m/s, by central differences; tip: (n, finger, axis), m."""
    return np.linalg.norm(np.gradient(tip, time, axis=0), axis=-1)


def peak_tip_speed(time: ndarray, tip: ndarray) -> tuple[float, float]:
    """Largest tip speed (m/s) and when it occurs (s): the velocity scale of every comparison."""
    speed = tip_speed(time, tip).max(axis=1)
    at = int(np.argmax(speed))
    if speed[at] <= 0:
        raise ValueError(
            "the finger's tip does not move, so there is no velocity scale; check sheet.h5"
        )
    return float(speed[at]), float(time[at])
