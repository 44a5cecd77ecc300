"""One pose and one law of motion fitted to the finger's outline in many frames at once.

The likelihood of `silhouette` has a bump per particle and long narrow ridges. A population of
chains begins far apart and is cooled into it; chains that fare worse are replaced by copies of
better ones (Hukushima and Iba 2003). Steps are differences of other chains (ter Braak 2006). The
mean of the samples is the estimate: an edge lies half-way between the particles that bound it.
Fitting the law to all silhouettes, not to one bend per frame, uses every particle near an edge.
A frame's own deviation from the law is integrated out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
from scipy.optimize import least_squares
from scipy.special import logsumexp

from pipeline.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.pose import Pose
from postprocess.lab.silhouette import WaterLikelihood, integral_image, left_of

# state of a chain: x px, y px, angle, ln magnification (px per m), growth of the outline px, and
# factor, delay s, stretch
SIZE, SCALE, GROWTH, LAW, DELAY, FACTORS = 8, 3, 4, slice(5, 8), 6, [5, 7]
TABLE = 241  # shapes in the table that outlines are interpolated from
REACH = 0.15  # of the simulation's range: how far a recording may bend beyond the simulation
COLD = 2e-3  # share of the evidence at the beginning
HALF, EFFECTIVE = 14, 0.5  # chains in each half, and the share of them that a step of heat leaves
OUTSIDE = -1e9  # evidence beyond the table
JITTER = 1e-3  # of the chains' spread at the start, in each step
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(3)  # of a frame's deviation from the law
# range of a single frame's bend, in standard deviations, and its step, in the table's
FAR_OFF, FINE_STEP = 4.0, 0.1
# of a single frame's pose: prior (px, px, rad) about that of all, and how many are tried
POSE_STD, POSES = (6.0, 6.0, 0.04), 161


@dataclass(frozen=True)
class Frames:
    """`integral_image` of the frames' evidence (frame, …) less its `mean`, and times (s)."""

    integrals: np.ndarray
    mean: float
    times: np.ndarray
    independent: float  # share of independent frames: particles may stay where they are

    def at(self, chosen: np.ndarray) -> Frames:
        """The `chosen` frames (bool)."""
        return replace(self, integrals=self.integrals[chosen], times=self.times[chosen])


def prepare(
    images: list[np.ndarray],
    times: np.ndarray,
    evidence: WaterLikelihood,
    blind: np.ndarray,
    blur_px: float,
    independent: float,
) -> Frames:
    """Evidence of frames taken at `times` (s); `blind` (frame, rows, columns): pixels left out."""
    seen = [
        np.where(dark, np.float32(0), evidence.image(image, blur_px))
        for dark, image in zip(blind, images, strict=True)
    ]
    mean = float(np.mean([f.mean() for f in seen]))
    integrals = np.stack([integral_image(f, mean).astype(np.float32) for f in seen])
    return Frames(integrals, mean, np.asarray(times, float), independent)


def law_pressure(kinematics: Kinematics, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The simulation's law, stretched: pressures (Pa) at times of the recording's clock."""
    factor, delay, stretch = values
    start = float(kinematics.law(kinematics.time[0]))
    at = np.clip((np.asarray(times) - delay) / stretch, *kinematics.time)
    return start + factor * (kinematics.law(at) - start)


def law_through(
    kinematics: Kinematics, times: np.ndarray, values: np.ndarray, pressures: np.ndarray
) -> np.ndarray:
    """Values of the law nearest to `pressures` (Pa) of single frames, sought from `values` on."""

    def off(tried: np.ndarray) -> np.ndarray:
        return np.asarray(law_pressure(kinematics, times, tried) - pressures)

    return np.asarray(least_squares(off, values, x_scale=(0.02, 3e-3, 0.02)).x)


@dataclass(frozen=True)
class Shapes:
    """The finger's outlines in a table of pressures, and the simulation's law.

    `pressures` (n,) Pa, `outlines` (n, point, 2) m, `normals` (n, point, 2): outward unit normals.
    A *place* is an index into the table, fractional.
    """

    kinematics: Kinematics
    pressures: np.ndarray
    outlines: np.ndarray
    normals: np.ndarray

    @property
    def step(self) -> float:
        """Pressure (Pa) between two places."""
        return float(self.pressures[1] - self.pressures[0])

    def places_of(self, pressures: np.ndarray) -> np.ndarray:
        """Places of pressures (Pa)."""
        return (np.asarray(pressures) - self.pressures[0]) / self.step

    def thinned(self, every: int) -> Shapes:
        """One of `every` points of the outlines."""
        few = (np.ascontiguousarray(a[:, ::every]) for a in (self.outlines, self.normals))
        return Shapes(self.kinematics, self.pressures, *few)

    def mirrored(self) -> Shapes:
        """Of a finger that bends to the other side of the vertical through its root."""
        flip, root = np.array([-1.0, 1.0]), np.asarray(self.kinematics.root)
        turned = (self.outlines[:, ::-1] - root) * flip + root, self.normals[:, ::-1] * flip
        return Shapes(self.kinematics, self.pressures, *map(np.ascontiguousarray, turned))

    def places(self, times: np.ndarray, laws: np.ndarray) -> np.ndarray:
        """Places (chain, frame) by start + factor (law((t - delay)/stretch) - start)."""
        return self.places_of(law_pressure(self.kinematics, times, laws.T[:, :, None]))

    def scores(self, frames: Frames, states: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Evidence (chain, frame) of states (chain, 8) at `places` (chain, frame).

        `OUTSIDE` where a place is beyond the table.
        """
        of = frames.integrals, frames.mean, self.outlines, self.normals
        seats = np.ascontiguousarray(states[:, :5])
        inside = np.clip(places, 0, TABLE - 1)
        seen = _scores(*of, np.asarray(self.kinematics.root), seats, inside)
        return np.where(inside == places, seen, OUTSIDE)

    def evidence(self, frames: Frames, states: np.ndarray, apart: np.ndarray) -> np.ndarray:
        """Evidence (chain,) of states (chain, 8); `apart`: see `fit_outline`, in places."""
        at = self.places(frames.times, states[:, LAW])
        seen = [self.scores(frames, states, at + apart * node) for node in NODES]
        share = (WEIGHTS / WEIGHTS.sum())[:, None, None]
        each = logsumexp(frames.independent * np.array(seen), axis=0, b=share)
        return np.asarray(each.sum(axis=1))


def shapes_of(kinematics: Kinematics) -> Shapes:
    """The table of a motion."""
    reach = REACH * (kinematics.high - kinematics.low)
    pressures = np.linspace(kinematics.low - reach, kinematics.high + reach, TABLE)
    outlines = np.array([counter_clockwise(o) for o in kinematics.shape("outline", pressures)])
    along = np.roll(outlines, -1, axis=-2) - np.roll(outlines, 1, axis=-2)
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    normals /= np.maximum(np.hypot(normals[..., 0], normals[..., 1]), 1e-12)[..., None]
    return Shapes(kinematics, pressures, outlines, normals)


@numba.njit(cache=True)
def _scores(integrals, mean, outlines, normals, anchor, seats, places):
    """Evidence (chain, frame) inside the outlines at `places` in frames, with y up.

    `integrals` and `mean` as of `silhouette.integral_image`; `seats` (chain, 5): x and y (px) of
    `anchor` (m), angle, ln magnification and growth; `normals` as of `Shapes`.
    """
    points = outlines.shape[1]
    out = np.empty(places.shape)
    for chain in range(places.shape[0]):
        x0, y0, angle, ln_magnification, grown = seats[chain]
        magnification = np.exp(ln_magnification)
        c, s = np.cos(angle), np.sin(angle)
        for f in range(places.shape[1]):
            t = min(max(int(places[chain, f]), 0), outlines.shape[0] - 2)
            w = places[chain, f] - t
            total = px = py = 0.0
            for k in range(points + 1):
                m = k if k < points else 0
                x = (1 - w) * outlines[t, m, 0] + w * outlines[t + 1, m, 0] - anchor[0]
                y = (1 - w) * outlines[t, m, 1] + w * outlines[t + 1, m, 1] - anchor[1]
                nx, ny = normals[t, m, 0], normals[t, m, 1]
                qx = x0 + magnification * (c * x - s * y) + grown * (c * nx - s * ny)
                qy = y0 + magnification * (s * x + c * y) + grown * (s * nx + c * ny)
                if k > 0:
                    total += left_of(integrals[f], mean, px, py, qx, qy)
                px, py = qx, qy
            out[chain, f] = total
    return out


def state_of(pose: Pose, law: np.ndarray) -> np.ndarray:
    """The state (8,) of a pose and a law, with the outline as it is."""
    return np.array([*pose.at_px, pose.angle, -np.log(pose.pixel), 0.0, *law])


def pose_of(state: np.ndarray, anchor: tuple[float, float]) -> Pose:
    """The pose of a state (8,)."""
    x, y, angle, ln_magnification = (float(v) for v in state[:4])
    return Pose(1e3 * float(np.exp(-ln_magnification)), angle, anchor, (x, y))


def fit_outline(
    frames: Frames,
    shapes: Shapes,
    first: np.ndarray,
    begin: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray],
    apart: np.ndarray,
    sweeps: tuple[int, int],
    seed: int,
) -> np.ndarray:
    """Samples (sample, 8) of the posterior of pose and law, begun at `first` within `begin` (8,).

    `prior`: mean and standard deviation (8,; inf: none). `apart` (frame,) Pa: standard deviation
    of a frame from the law. `sweeps`: at each heat, and those that are kept.
    """
    rng, off = np.random.default_rng(seed), apart / shapes.step
    states = first + begin * rng.standard_normal((2 * HALF, SIZE))
    states[0] = first
    jitter, seen = JITTER * states.std(axis=0), shapes.evidence(frames, states, off)

    def sweep(heat: float) -> None:
        for mine, other in ((slice(HALF), slice(HALF, None)), (slice(HALF, None), slice(HALF))):
            one = rng.integers(HALF, size=HALF)
            two = (one + rng.integers(1, HALF, size=HALF)) % HALF
            step = 2.38 / np.sqrt(2 * SIZE) * (states[other][one] - states[other][two])
            tried = states[mine] + step + jitter * rng.standard_normal((HALF, SIZE))
            new = shapes.evidence(frames, tried, off)
            likely = [-0.5 * np.sum(((s - prior[0]) / prior[1]) ** 2, axis=1) for s in
                      (tried, states[mine])]  # fmt: skip
            gain = heat * (new - seen[mine]) + likely[0] - likely[1]
            taken = np.log(rng.random(HALF)) < gain
            states[mine][taken], seen[mine][taken] = tried[taken], new[taken]

    heat = COLD
    while heat < 1:
        for _ in range(sweeps[0]):
            sweep(heat)
        heat, shares = _next_heat(seen, heat)
        at = (rng.random() + np.arange(2 * HALF)) / (2 * HALF)
        left = rng.permutation(np.minimum(np.searchsorted(np.cumsum(shares), at), 2 * HALF - 1))
        states[:], seen[:] = states[left], seen[left]
    kept = []
    for k in range(sweeps[1] + sweeps[1] // 2):
        sweep(1.0)
        if k >= sweeps[1] // 2:
            kept.append(states.copy())
    return np.concatenate(kept)


def _next_heat(evidence: np.ndarray, heat: float) -> tuple[float, np.ndarray]:
    """The next share of the evidence (chain,) to count, at most 1, and the chains' weights.

    The weights keep at least `EFFECTIVE` of the chains.
    """
    for share in np.geomspace(2.0, 1.02, 20):
        new = min(heat * share, 1.0)
        weight = np.exp((new - heat) * (evidence - evidence.max()))
        weight /= weight.sum()
        if 1 / np.sum(weight**2) >= EFFECTIVE * evidence.size:
            break
    return new, weight


def single_frames(
    frames: Frames, shapes: Shapes, state: np.ndarray, law: np.ndarray, deviation: float
) -> tuple[np.ndarray, np.ndarray]:
    """What each frame shows by itself, and its standard deviation: (4, frame) each.

    Pressure (Pa) at a state (8,), by integration over a prior about `law` (frame,) of size
    `deviation` (Pa); then x, y (px) and angle (rad) of the pose at that pressure, each alone.
    """
    off = np.arange(-FAR_OFF, FAR_OFF, FINE_STEP / deviation * shapes.step)[:, None]
    tried = np.clip(law + off * deviation, shapes.pressures[0], shapes.pressures[-1])
    states = np.broadcast_to(state, (off.size, SIZE))
    found = [_expected(frames, shapes.scores(frames, states, shapes.places_of(tried)), off, tried)]
    places = shapes.places_of(found[0][0])
    off = np.linspace(-FAR_OFF, FAR_OFF, POSES)[:, None]
    for k, size in enumerate(POSE_STD):
        states = state + off * size * np.eye(SIZE)[k]
        at = np.broadcast_to(places, (POSES, places.size))
        tried = np.broadcast_to(states[:, [k]], at.shape)
        found.append(_expected(frames, shapes.scores(frames, states, at), off, tried))
    return np.array([mean for mean, _ in found]), np.array([std for _, std in found])


def _expected(
    frames: Frames, scores: np.ndarray, off: np.ndarray, tried: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (frame,) of values tried (try, frame) with a Gaussian prior."""
    weight = frames.independent * scores - 0.5 * off**2
    weight = np.exp(weight - weight.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * tried).sum(axis=0)
    return mean, np.sqrt((weight * (tried - mean) ** 2).sum(axis=0))
