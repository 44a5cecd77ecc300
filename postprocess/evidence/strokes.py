"""The stroke: which instants are its middle, and how fast the tip moves."""

from __future__ import annotations

import numpy as np

MIDDLE = (0.25, 0.75)  # of the change of bend angle: the middle of the stroke, over which flows are compared


def stroke_window(time: np.ndarray, bend: np.ndarray, part: tuple[float, float]) -> tuple[float, float]:
    """Instants (s) at which the bend angle has done the fractions `part` of its largest change.

    time (n) in s, bend (n) in rad. Fractions of bend, not of time: the three-pole law creeps into its end, and
    half of its time would lie in the last degrees. ValueError where the finger does not bend.
    """
    change = bend - bend[0]
    end = int(np.argmax(np.abs(change)))
    if abs(change[end]) < 1e-6:
        raise ValueError("the finger does not bend, so its stroke has no middle; check kinematics.h5")
    progress = np.maximum.accumulate(change[: end + 1] / change[end])
    rising = np.concatenate([[True], np.diff(progress) > 0])
    edges = np.interp(part, progress[rising], time[: end + 1][rising])
    if part[1] >= 1.0:
        edges[1] = time[-1]  # the whole stroke includes what happens after it
    return float(edges[0]), float(edges[1])


def tip_speed(time: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Speed (n, finger) of the tips in m/s by central differences; tip is (n, finger, axis) in m."""
    return np.linalg.norm(np.gradient(tip, time, axis=0), axis=-1)


def peak_tip_speed(time: np.ndarray, tip: np.ndarray) -> tuple[float, float]:
    """Largest tip speed (m/s) and when it occurs (s): the velocity scale of every comparison."""
    speed = tip_speed(time, tip).max(axis=1)
    at = int(np.argmax(speed))
    if speed[at] <= 0:
        raise ValueError("the finger's tip does not move, so there is no velocity scale; check sheet.h5")
    return float(speed[at]), float(time[at])
