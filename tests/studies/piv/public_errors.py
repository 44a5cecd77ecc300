"""Where errors of the public pairs come from: python -m tests.studies.piv.public_errors.

Pictures made by interpolation of another one: moved by half the displacement d in opposite directions, linearly interpolated
pictures lose and shift the same in both, with a period of two pixels of d. Printed is the amplitude a of a sin(πd) in the
errors of such pictures, and of the public pairs of cylinders without noise (tests/studies/piv/public_data.py) the share of
the errors' mean square that it explains, and the coverage before and without it.
Waves that no window follows: of the simulated flows, what of the published field is shorter than SHORT beside the error.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import shift

from piv.correlation.pair import correlate_pair
from tests.shared_data import shared_data
from tests.studies.piv.particles import render
from tests.studies.piv.public_data import CAI, MASKED, QUENOT, cylinders, simulated
from tests.studies.piv.scores import FAR, UNCERTAIN, errors, judged

SHIFTS = np.arange(0, 2, 0.25)  # px
SHORT = 16  # px: two vectors, which is the shortest wave that they can show


def amplitude(d: np.ndarray, e: np.ndarray) -> float:
    """Of sin(πd) in the errors `e` of displacements `d` (px)."""
    wave = np.sin(np.pi * d)
    return float(np.sum(wave * e) / np.sum(wave**2))


def of_made_pictures(order: int) -> float:
    """Amplitude (px) in pictures moved by splines of this order; diameter 2 px, no noise."""
    one = render(lambda x, y: (0 * x, 0 * y), shape=(320, 400), seed=21, diameter=2.0, frames=(0,))[
        0
    ]
    bias = []
    for d in SHIFTS:
        pair = (
            shift(one.astype(float), (0, way * d / 2), order=order, mode="nearest")
            for way in (-1, 1)
        )
        ds = correlate_pair(*(np.clip(np.rint(i), 0, 255).astype(np.uint8) for i in pair))
        bias.append(float(ds["u"].sel(x=slice(40, 360), y=slice(40, 280)).mean()) - d)
    return amplitude(SHIFTS, np.array(bias))


def of_public_pairs(data: Path) -> list[str]:
    """A line for each clean pair of cylinders and component."""
    lines = []
    for pair in cylinders(data):
        if not pair.name.endswith("perfect"):
            continue
        flow, counts = next(iter(pair.rows.values()))
        ds = correlate_pair(*pair.images, **pair.runs[MASKED])
        x, y, e, std = errors(ds, flow)
        # single vectors that are wrong by much are another matter
        near = counts(x, y) & (np.abs(e) < FAR).all(axis=0) & (ds["flag"].values != UNCERTAIN)
        for name, d, own, told in zip("uv", flow(x, y), e, std, strict=True):
            d, own, told = d[near], own[near], told[near]
            a = amplitude(d, own)
            rest = own - a * np.sin(np.pi * d)
            lines.append(
                f"{pair.name}, {name}: a = {a:.3f} px, explains {1 - np.mean(rest**2) / np.mean(own**2):.0%}; "
                f"coverage {np.mean(np.abs(own) < told):.0%}, without it {np.mean(np.abs(rest) < told):.0%}"
            )
    return lines


def short_waves(flow: Callable, shape: tuple[int, int]) -> float:
    """RMS per component (px) of what of the flow in a picture of `shape` is shorter than SHORT."""
    rows, columns = shape
    field = np.stack(flow(*np.meshgrid(np.arange(columns), np.arange(rows))))
    field -= field.mean(axis=(1, 2), keepdims=True)
    # the edges are no waves
    power = np.abs(np.fft.fft2(field * np.hanning(rows)[:, None] * np.hanning(columns))) ** 2
    waves = np.hypot(*np.meshgrid(np.fft.fftfreq(columns), np.fft.fftfreq(rows)))
    return float(np.sqrt((field**2).mean() * power[:, waves > 1 / SHORT].sum() / power.sum()))


def of_simulated_flows(data: Path) -> list[str]:
    """A line for each pair."""
    lines = []
    for pair in simulated(data):
        flow, counts = next(iter(pair.rows.values()))
        error = judged(correlate_pair(*pair.images), flow, counts)
        short = short_waves(flow, pair.images[0].shape)
        rms = np.sqrt(np.mean(error.e[:, error.common] ** 2))
        lines.append(
            f"{pair.name}: {short:.3f} px of the field shorter than {SHORT} px, error {rms:.3f} px"
        )
    return lines


def main() -> None:
    """Print."""
    cv2.setNumThreads(1)
    for order, name in ((1, "linear"), (3, "cubic")):
        print(f"{name} interpolation: a = {of_made_pictures(order):.3f} px")
    data = shared_data()
    if data and (data / QUENOT).is_dir():
        print("\n".join(of_public_pairs(data)))
    if data and all((data / folder).is_dir() for folder in CAI):
        print("\n".join(of_simulated_flows(data)))


if __name__ == "__main__":
    main()
