"""Least squares with priors: parameters with bands and correlations, and which the data tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

FloatArray = np.ndarray
BAND = 1.96  # standard deviations of a 95 % band
TOLD = 0.7  # of the prior's standard deviation: what is not below it the data do not tell
_STEP = 0.05  # of the prior's standard deviation, of the differences that give the Jacobian
_LEAST_NOISE = 0.75  # of the first guess: no edge is known better, however well a fit goes
_LAGS = 25  # of the correlation of residuals over time, at most


@dataclass(frozen=True)
class Parameter:
    """A parameter with its prior: mean and standard deviation. `ratio`: fitted by its logarithm."""

    name: str
    prior: float
    std: float
    unit: str = ""
    ratio: bool = False

    def value(self, z: float) -> float:
        """The value at `z` standard deviations from the prior; of a ratio they are relative."""
        return self.prior * float(np.exp(self.std * z)) if self.ratio else self.prior + self.std * z


@dataclass(frozen=True)
class Fit:
    """The estimate `z` in standard deviations of the priors, with its covariance.

    `rms` of the residuals and `noise` that is believed, in their unit; `share`: of independent
    residuals among them.
    """

    parameters: tuple[Parameter, ...]
    z: FloatArray
    covariance: FloatArray
    rms: float
    noise: float
    share: float

    def values(self, z: FloatArray | None = None) -> dict[str, float]:
        """The parameters by name, at the estimate or at another `z`."""
        at = self.z if z is None else z
        return {p.name: p.value(x) for p, x in zip(self.parameters, at, strict=True)}

    @property
    def std(self) -> FloatArray:
        """Standard uncertainties, in standard deviations of the priors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation (parameter, parameter)."""
        return self.covariance / np.outer(self.std, self.std)

    def table(self) -> list[dict[str, Any]]:
        """By parameter: value, bands (95 %), whether the data tell it, and its strongest tie."""
        rows = []
        for k, (parameter, z, std) in enumerate(
            zip(self.parameters, self.z, self.std, strict=True)
        ):
            ties = np.abs(self.correlation[k]) * (np.arange(len(self.z)) != k)
            other = int(np.argmax(ties))
            rows.append(
                {
                    "name": parameter.name,
                    "unit": parameter.unit,
                    "value": parameter.value(z),
                    "band": [parameter.value(z + side * BAND * std) for side in (-1, 1)],
                    "prior": [parameter.value(side * BAND) for side in (-1, 1)],
                    "told": bool(std < TOLD),
                    "at_edge": bool(abs(z) > BAND),
                    "tied_to": self.parameters[other].name,
                    "correlation": float(self.correlation[k, other]),
                }
            )
        return rows

    def draws(self, count: int, seed: int = 1) -> FloatArray:
        """Parameters (draw, parameter) as `z` from the estimate's Gaussian."""
        return np.random.default_rng(seed).multivariate_normal(self.z, self.covariance, count)


def fit(
    parameters: list[Parameter],
    residuals: Callable[[dict[str, float]], list[FloatArray]],
    noise: float,
    most: float = np.inf,
    start: FloatArray | None = None,
) -> Fit:
    """The most probable parameters; `residuals`: of each record (time, point), 0 where it fits.

    `noise`: a first guess of the residuals' standard deviation. The second round takes what the
    first has left, and counts residuals that go together over time or along the body once. Of an
    instant at most `most` count: what biases an edge biases all of a side. `start`: in standard
    deviations of the priors.
    """
    names = [parameter.name for parameter in parameters]

    def left(z: FloatArray) -> list[FloatArray]:
        pairs = zip(names, parameters, z, strict=True)
        return residuals({name: parameter.value(x) for name, parameter, x in pairs})

    def weighed(z: FloatArray, weight: float) -> FloatArray:
        return np.concatenate([*(weight * part.ravel() for part in left(z)), z])

    def slopes(z: FloatArray, weight: float) -> FloatArray:
        here = weighed(z, weight)
        steps = [weighed(z + _STEP * e, weight) - here for e in np.eye(len(z))]
        return np.stack(steps, axis=-1) / _STEP

    z = np.zeros(len(parameters)) if start is None else start
    points = left(z)[0].shape[1]
    share, size = min(most / points, 1.0), noise
    for close in (1e-2, 1e-4):
        weight = share**0.5 / size
        found = least_squares(
            weighed, z, slopes, args=(weight,), bounds=(-4.0, 4.0), xtol=1e-4, ftol=close
        )
        z, parts = found.x, left(found.x)
        rms = float(np.sqrt(np.mean(np.concatenate([p.ravel() for p in parts]) ** 2)))
        size = max(rms, _LEAST_NOISE * noise)
        share = independent_share(parts, most)
    jacobian = slopes(z, share**0.5 / size)
    return Fit(tuple(parameters), z, np.linalg.inv(jacobian.T @ jacobian), rms, size, share)


def independent_share(parts: list[FloatArray], most: float = np.inf) -> float:
    """Share of independent residuals, of records (time, point) that are smooth in both directions.

    One over the sum of the correlation over lags until it first vanishes, in each direction; of
    the points of an instant at most `most` count.
    """
    shares = []
    for axis in (0, 1):
        total = np.zeros(_LAGS + 1)
        for part in parts:
            moved = np.moveaxis(part, axis, 0)
            for lag in range(min(_LAGS, len(moved) - 1) + 1):
                total[lag] += float(np.sum(moved[lag:] * moved[: len(moved) - lag]))
        if total[0] <= 0:
            return 1.0
        correlation = total / total[0]
        negative = np.flatnonzero(correlation <= 0)
        until = int(negative[0]) if len(negative) else _LAGS + 1
        shares.append(1 / (1 + 2 * float(correlation[1:until].sum())))
    points = float(np.mean([part.shape[1] for part in parts]))
    return float(np.clip(shares[0] * min(shares[1], most / points), 1e-3, 1.0))
