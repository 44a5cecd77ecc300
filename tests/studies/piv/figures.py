"""Further figures of the benchmark: bias, vortex fit, five frames, threads, rendering."""

import os
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from piv.correlation.pair import Options, correlate_pair
from piv.images.open_recording import open_recording
from piv.sequence.multiframe import correlate_frames
from piv.sequence.sequence import SequenceOptions, correlate_recording
from piv.vortices.find import find_vortices
from tests.studies.piv.flows import CENTRE, lamb_oseen, uniform
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.particles import render
from tests.studies.piv.rendering import rendering

SETS = 96  # pairs of the sequence
TURN = 24  # after so many pairs its motion turns
TRIES = 3  # of each number of threads: other programs only ever make one slower


def peak_locking() -> str:
    """Largest mean error over shifts of 0 … 1 px, clean and noisy."""
    out = []
    for noise in (0.0, 0.05):
        worst = 0.0
        for k, shift in enumerate(np.linspace(0, 1, 11)):
            a, b = render_pair(
                uniform(shift, 1 - shift), (768, 1024), noise=noise, background=5.0, seed=1100 + k
            )
            ds = correlate_pair(a, b)
            inner = {"x": slice(32, 990), "y": slice(32, 735)}
            bias = [
                float(ds["u"].sel(inner).mean()) - shift,
                float(ds["v"].sel(inner).mean()) - (1 - shift),
            ]
            worst = max(worst, *np.abs(bias))
        out.append(f"{worst:.4f} px {'clean' if noise == 0 else 'with 5 % noise'}")
    return "- Largest mean bias over shifts of 0 … 1 px (peak locking): " + ", ".join(out) + "."


def noise_bound() -> str:
    """Cramér-Rao bound of a 32 × 32 window in the noisy images, and what is reached."""
    clean, _ = render_pair(uniform(4.63, -2.28), (1024, 1280), background=5.0, seed=1201)
    spectrum = np.abs(np.fft.fft2(clean - clean.mean())) ** 2 / clean.size
    f = 2 * np.pi * np.fft.fftfreq(clean.shape[1])
    bound = np.sqrt(2 * (0.05 * 255) ** 2 / (np.sum(spectrum * f**2) / clean.size) / 32**2)
    a, b = render_pair(uniform(4.63, -2.28), (1024, 1280), noise=0.05, background=5.0, seed=1201)
    out = []
    for smoothing in (True, False):
        ds = correlate_pair(a, b, smoothing=smoothing).sel(x=slice(24, 1255), y=slice(24, 999))
        out.append(float(np.sqrt(np.nanmean([(ds["u"] - 4.63) ** 2, (ds["v"] + 2.28) ** 2]))))
    return (
        f"- Uniform shift, 5 % noise: {out[0]:.4f} px, {out[1]:.4f} px without smoothing; the "
        "Cramér-Rao bound of a "
        f"32 × 32 px window in these images is {bound:.4f} px."
    )


def vortex_fit() -> str:
    """Lamb-Oseen fit of noisy PIV with a neighbour and background shear."""
    strength = 2 * np.pi * 40 * 6 * 1.12091 / (1 - np.exp(-(1.12091**2)))
    first, second = lamb_oseen(40, 6), lamb_oseen(35, -4, (CENTRE[0] + 240, CENTRE[1] + 60))

    def flow(x, y):
        one, two = first(x, y), second(x, y)
        return one[0] + two[0] + 0.006 * (y - CENTRE[1]) + 1.1, one[1] + two[1] - 0.7

    rows = []
    for seed in range(1301, 1307):
        a, b = render_pair(flow, (1024, 1280), noise=0.05, background=5.0, seed=seed)
        vortices = find_vortices(correlate_pair(a, b))
        v = min(vortices, key=lambda w: np.hypot(w.x - CENTRE[0], w.y - CENTRE[1]))
        rows.append(
            (
                np.hypot(v.x_fit - CENTRE[0], v.y_fit - CENTRE[1]),
                abs(v.circulation_fit / strength - 1),
                abs(v.core_radius / 40 - 1),
            )
        )
    centre, gamma, radius = np.sqrt(np.mean(np.square(rows), axis=0))
    return (
        f"- Vortex fit of noisy PIV (r_c = 40 px, neighbour, shear, drift; RMS of {len(rows)} "
        f"pairs): centre {centre:.3f} px, "
        f"circulation {gamma:.2%}, core radius {radius:.2%}."
    )


def five_frames() -> str:
    """RMS of the five-frame mode against pairs, in a steady vortex and a uniform flow."""
    flow = lamb_oseen(40, 6)

    def path(x, y, t):
        u, v = flow(x, y)
        rx, ry = x - CENTRE[0], y - CENTRE[1]
        turn = (rx * v - ry * u) / (rx**2 + ry**2 + 1e-9) * t
        c, s = np.cos(turn), np.sin(turn)
        return CENTRE[0] + c * rx - s * ry, CENTRE[1] + s * rx + c * ry

    out = []
    for label, f, p in (("vortex", flow, path), ("uniform flow", uniform(4.63, -2.28), None)):
        frames = render(f, seed=1401, noise=0.05, frames=(-2, -1, 0, 1, 2), path=p)
        pair = render(f, seed=1401, noise=0.05, frames=(-0.5, 0.5), path=p)
        score = []
        for ds in (correlate_pair(*pair), correlate_frames(frames)):
            ds = ds.sel(x=slice(24, 1255), y=slice(24, 999))
            u, v = f(*np.meshgrid(ds["x"], ds["y"]))
            score.append(float(np.sqrt(np.nanmean([(ds["u"] - u) ** 2, (ds["v"] - v) ** 2]))))
        out.append(f"{label} {score[0]:.4f} → {score[1]:.4f} px ({score[0] / score[1]:.1f}×)")
    return "- Five frames against two (5 % noise): " + ", ".join(out) + "."


def threads() -> str:
    """Wall time of a sequence on one core and on two."""
    cores = sorted(os.sched_getaffinity(0))
    frames = render(
        uniform(3.1, 1.3), seed=1500, noise=0.05, frames=range(-TURN // 2, TURN // 2 + 1)
    )
    wall: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # there and back again: over so many pictures the particles would leave
        for k in range(SETS + 1):
            cv2.imwrite(str(folder / f"{k:03d}.tif"), frames[abs((k + TURN) % (2 * TURN) - TURN)])

        def fields(used: list[int], threads: int) -> None:
            os.sched_setaffinity(0, set(used))
            output = folder / "vectors.h5"
            with open_recording(folder) as recording:
                correlate_recording(recording, output, Options(), SequenceOptions(threads=threads))
            output.unlink()

        ways = {
            "one core": lambda: fields(cores[:1], 1),
            "two threads": lambda: fields(cores[:2], 2),
            "one thread": lambda: fields(cores[:2], 1),
        }
        for way, run in list(ways.items()) * TRIES:
            start = time.perf_counter()
            run()
            wall[way] = min(wall.get(way, np.inf), time.perf_counter() - start)
    os.sched_setaffinity(0, set(cores))
    gain = {way: wall["one core"] / seconds for way, seconds in wall.items()}
    load = os.getloadavg()[0]
    return (
        f"- Two threads on two cores against one on one core, sequence of {SETS} pairs with "
        f"reading and writing, each the best of {TRIES}: {gain['two threads']:.2f}×; "
        f"one thread where a second core reads and writes for it {gain['one thread']:.2f}× "
        f"({SETS / wall['two threads']:.1f} pairs/s with two threads; load of the machine: "
        f"{load:.1f} of {os.cpu_count()} cores)."
    )


def extra_figures() -> str:
    """All of them as lines of Markdown."""
    return "\n".join(
        [noise_bound(), peak_locking(), vortex_fit(), five_frames(), threads(), rendering()]
    )
