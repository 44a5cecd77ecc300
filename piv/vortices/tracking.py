"""Vortices followed over frames: Hungarian assignment to constant-velocity Kalman predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

from piv.vortices.vortex import Vortex


@dataclass(frozen=True)
class TrackingSettings:
    """How detections join to tracks; lengths in radii, the same for every unit."""

    agility: Annotated[float, "standard deviation of the velocity change per frame, radii"] = 0.2
    scatter: Annotated[float, "scatter of a position beside its standard error, radii"] = 0.1
    gate: Annotated[float, "largest Mahalanobis distance between prediction and detection"] = 4.0
    max_step: Annotated[
        float, "largest distance of a detection from the prediction or the last one, radii"
    ] = 1.5
    circulation_change: Annotated[
        float, "relative change of circulation that costs as much as one standard deviation"
    ] = 0.5
    max_change: Annotated[
        float, "largest factor by which the circulation changes in a frame; beyond, another vortex"
    ] = 3.0
    max_missed: Annotated[int, "frames without detection after which a track ends"] = 3

    def __post_init__(self) -> None:
        for name in ("agility", "gate", "max_step", "circulation_change"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name):g}: give a positive number")
        if not self.max_change > 1:
            raise ValueError(f"max_change = {self.max_change:g}: give a number above 1")
        for name in ("scatter", "max_missed"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} = {getattr(self, name):g}: give no negative number")


class _Track:
    def __init__(self, identity: int, time: float, vortex: Vortex, noise: ndarray) -> None:
        self.identity, self.time, self.last = identity, time, vortex
        self.missed = self.skipped = 0
        self.state = np.array([vortex.x, vortex.y, 0.0, 0.0])
        self.covariance = np.zeros((4, 4))
        self.covariance[:2, :2] = noise
        self.young = True

    def predict(self, time: float, s: TrackingSettings) -> tuple[ndarray, ndarray]:
        """State and covariance at `time`."""
        dt, a = time - self.time, self.last.radius
        f = np.eye(4)
        f[0, 2] = f[1, 3] = dt
        p = self.covariance.copy()
        # no velocity is known yet: a step of one radius is one standard deviation
        if self.young:
            p[2, 2] = p[3, 3] = (a / dt) ** 2
        g = np.array([[dt / 2, 0], [0, dt / 2], [1, 0], [0, 1]])
        frames = 1 + self.missed + self.skipped
        return f @ self.state, f @ p @ f.T + g @ g.T * (s.agility * a * frames / dt) ** 2

    def update(
        self, time: float, vortex: Vortex, predicted: tuple[ndarray, ndarray], noise: ndarray
    ) -> None:
        state, p = predicted
        gain = p[:, :2] @ np.linalg.inv(p[:2, :2] + noise)
        self.state = state + gain @ (np.array([vortex.x, vortex.y]) - state[:2])
        self.covariance = (np.eye(4) - gain @ np.eye(2, 4)) @ p
        self.time, self.last, self.young = time, vortex, False
        self.missed = self.skipped = 0


class Tracker:
    """Gives each vortex the number of its track, frame by frame, from 0 on."""

    def __init__(self, settings: TrackingSettings | None = None) -> None:
        self.settings = settings or TrackingSettings()
        self._tracks: list[_Track] = []
        self._next = 0

    def skip(self) -> None:
        """Let an instant without a field pass, which ends no track."""
        for track in self._tracks:
            track.skipped += 1

    def update(
        self, time: float, vortices: Sequence[Vortex], fastest: float = float("inf")
    ) -> list[int]:
        """Track numbers of the `vortices` at `time`, which is later than the last.

        `fastest`: largest speed of the flow, which carries a vortex from one place to the next.
        """
        s = self.settings
        if self._tracks and time <= max(t.time for t in self._tracks):
            raise ValueError(
                f"tracking needs ascending times, got {time} after an equal or later one"
            )
        predictions = [t.predict(time, s) for t in self._tracks]
        noises = [_noise(v, s) for v in vortices]
        cost = np.full((len(self._tracks), len(vortices)), 1e9)
        for i, (track, (state, p)) in enumerate(zip(self._tracks, predictions, strict=True)):
            for j, vortex in enumerate(vortices):
                if _same(track, time, vortex, fastest, s):
                    cost[i, j] = _cost(track, state, p, vortex, noises[j], s)
        numbers = [-1] * len(vortices)
        for i, j in zip(*linear_sum_assignment(cost), strict=True):
            if cost[i, j] < 1e9:
                self._tracks[i].update(time, vortices[j], predictions[i], noises[j])
                numbers[j] = self._tracks[i].identity
        seen = set(numbers)
        for track in self._tracks:
            if track.identity not in seen:
                track.missed += 1
        self._tracks = [t for t in self._tracks if t.missed <= s.max_missed]
        for j, vortex in enumerate(vortices):
            if numbers[j] < 0:
                numbers[j] = self._next
                self._tracks.append(_Track(self._next, time, vortex, noises[j]))
                self._next += 1
        return numbers


def _noise(v: Vortex, s: TrackingSettings) -> ndarray:
    std = np.nan_to_num([v.x_std, v.y_std])  # at the edge of the plane it is not known
    return np.diag(std**2) + np.eye(2) * (s.scatter * v.radius) ** 2


def _same(track: _Track, time: float, vortex: Vortex, fastest: float, s: TrackingSettings) -> bool:
    """Whether a vortex may be the one of a track: by sense, circulation and place.

    A track ends where its vortex meets the edge of the plane. The flow carries a vortex by no more
    than its largest speed; what it takes up or loses moves its centre within its radius.
    """
    old, frames = track.last, 1 + track.missed + track.skipped
    turns = "peak_vorticity" if vortex.at_edge else "circulation_disc"
    if old.at_edge != vortex.at_edge or getattr(old, turns) * getattr(vortex, turns) <= 0:
        return False
    carried = fastest * (time - track.time) + max(old.radius, vortex.radius)
    if np.hypot(vortex.x - old.x, vortex.y - old.y) > carried:
        return False
    sizes = sorted(abs(v.circulation_disc) for v in (old, vortex))
    doubt = np.hypot(old.circulation_disc_std, vortex.circulation_disc_std)
    return vortex.at_edge or bool(sizes[1] <= s.max_change**frames * sizes[0] + 2 * doubt)


def _cost(
    track: _Track, state: ndarray, p: ndarray, vortex: Vortex, noise: ndarray, s: TrackingSettings
) -> float:
    old = track.last
    d = np.array([vortex.x, vortex.y]) - state[:2]
    far = s.max_step * max(old.radius, vortex.radius) * (1 + track.missed + track.skipped)
    squared = float(d @ np.linalg.solve(p[:2, :2] + noise, d))
    step = min(np.hypot(*d), np.hypot(vortex.x - old.x, vortex.y - old.y))  # predictions may lag
    if step > far or squared > s.gate**2:
        return 1e9
    if vortex.at_edge:
        return squared
    change = abs(np.log(vortex.circulation_disc / old.circulation_disc)) / s.circulation_change
    return squared + change**2
