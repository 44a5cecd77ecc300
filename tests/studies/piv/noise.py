"""Noise of the vectors with and without smoothing, its reach, and the sampling kernel."""

import numpy as np

from piv.correlation.interpolate import kernel_values
from piv.correlation.pair import correlate_pair
from tests.studies.piv.flows import CENTRE, SHAPE, Case, lamb_oseen, uniform
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.scores import errors, rms

PAIRS = 6
WINDOW = 32


def smoothing(first: int) -> str:
    """Noise with and without smoothing: in uniform flow, in a vortex core, and at the edges."""
    vortex = Case(lamb_oseen(40, 6), core=80)
    core: dict[bool, list] = {True: [], False: []}
    flat: dict[bool, list] = {True: [], False: []}
    told = []
    for seed in range(first, first + PAIRS):
        for flow, keep in ((vortex.flow, core), (uniform(4.63, -2.28), flat)):
            pair = render_pair(flow, SHAPE, seed=seed, noise=0.05, background=5.0)
            for smooth in (True, False):
                x, y, e, std = errors(correlate_pair(*pair, smoothing=smooth), flow)
                if keep is core:
                    e = e[:, np.hypot(x - CENTRE[0], y - CENTRE[1]) < vortex.core]
                elif smooth:
                    told.append(std)
                keep[smooth].append(e)
    edge = np.minimum.reduce([x, SHAPE[1] - 1 - x, y, SHAPE[0] - 1 - y])
    middle = edge >= 5 * WINDOW
    e, std = np.stack(flat[True]), np.stack(told)
    rings = []
    for k in range(4):
        ring = (edge >= max(k * WINDOW, WINDOW / 2)) & (edge < (k + 1) * WINDOW)
        rings.append(
            f"{rms(e[..., ring]) / rms(e[..., middle]):.1f} "
            f"({rms(std[..., ring]) / rms(std[..., middle]):.1f})"
        )
    plain = np.stack(flat[False])
    parts = [
        f"- What `--no-smoothing` leaves out (5 % noise, {PAIRS} pairs): uniform flow "
        f"{rms(plain[..., middle]):.4f} → {rms(e[..., middle]):.4f} px "
        f"({rms(plain[..., middle]) / rms(e[..., middle]):.1f}×), core of a vortex of 40 px "
        f"{rms(np.stack(core[False])):.4f} → {rms(np.stack(core[True])):.4f} px "
        f"({rms(np.stack(core[False])) / rms(np.stack(core[True])):.1f}×).",
        "- Noise of vectors in uniform flow is correlated by over 0.2 up to a distance of "
        f"{reach(e):.1f} windows, without smoothing {reach(plain):.1f}.",
        "- Noise near the picture's edge over that of the middle (as the uncertainty says), "
        "uniform flow, first to fourth window from the edge: " + ", ".join(rings) + ".",
    ]
    return "\n".join(parts)


def reach(e: np.ndarray) -> float:
    """Distance (windows) along rows at which errors at 8 px are last correlated by over 0.2."""
    e = np.nan_to_num(e[..., 20:-20, 20:-20])
    lags = range(1, 40)
    common = [np.mean(e[..., lag:] * e[..., :-lag]) / np.mean(e**2) for lag in lags]
    above = [lag for lag, c in zip(lags, common, strict=True) if c > 0.2]
    return max(above, default=0) * 8 / WINDOW


def sampling() -> str:
    """Share of the spectrum's mirror image, of the sampling kernel and of a cubic B-spline."""
    x = np.linspace(-2, 2, 4001)

    def response(frequency: float) -> float:
        return float(np.trapezoid(kernel_values(x) * np.cos(2 * np.pi * frequency * x), x))

    own, spline = abs(response(0.6) / response(0.4)), (np.sinc(0.6) / np.sinc(0.4)) ** 4
    return (
        f"- Mirror image of the spectrum at 0.4 cycles/px: {own:.1%} with this sampling kernel, "
        f"{spline:.0%} with a cubic B-spline of the same cost."
    )
