"""What pictures made by interpolation of another one bias: python -m tests.studies.piv.interpolated.

Moved by half the displacement d in opposite directions, linearly interpolated pictures lose and shift the same in both, with a
period of two pixels of d. Prints the amplitude a of a sin(πd) in the errors of such pictures, and of the public pairs of
cylinders without noise (tests/studies/piv/public_data.py) the share of the errors' mean square that it explains, and the coverage before and without it.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import shift

from piv.correlation.pair import correlate_pair
from tests.shared_data import shared_data
from tests.studies.piv.particles import render
from tests.studies.piv.public_data import MASKED, QUENOT, cylinders
from tests.studies.piv.scores import FAR, UNCERTAIN, errors

SHIFTS = np.arange(0, 2, 0.25)  # px


def amplitude(d: np.ndarray, e: np.ndarray) -> float:
    """Of sin(πd) in the errors `e` of displacements `d` (px)."""
    wave = np.sin(np.pi * d)
    return float(np.sum(wave * e) / np.sum(wave**2))


def of_made_pictures(order: int) -> float:
    """Amplitude (px) in pictures moved by splines of this order; diameter 2 px, no noise."""
    one = render(lambda x, y: (0 * x, 0 * y), shape=(320, 400), seed=21, diameter=2.0, frames=(0,))[0]
    bias = []
    for d in SHIFTS:
        pair = (shift(one.astype(float), (0, way * d / 2), order=order, mode="nearest") for way in (-1, 1))
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


def main() -> None:
    """Print."""
    cv2.setNumThreads(1)
    for order, name in ((1, "linear"), (3, "cubic")):
        print(f"{name} interpolation: a = {of_made_pictures(order):.3f} px")
    data = shared_data()
    if data and (data / QUENOT).is_dir():
        print("\n".join(of_public_pairs(data)))


if __name__ == "__main__":
    main()
