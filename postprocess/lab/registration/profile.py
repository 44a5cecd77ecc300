"""The lower-layer profile over time as the silhouette shows it: curvature fitted frame by frame, and the circle's R(t).

The finger is a strip of its thickness at rest whose lower layer turns by θ(s) = a₁σ + a₂(σ² − σ) + a₃(2σ³ − 3σ² + σ), σ = s/L, and is L = L₀(1 + a₄)
long: a₁ is the bend angle, a₂ and a₃ say how unevenly it is spread. Nothing of the finite-element analysis enters but the shape at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LSQUnivariateSpline
from scipy.optimize import minimize

from fileio.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.outline_profile import seen_outline
from postprocess.lab.registration.silhouette import inside_sum, outward, sides

POINTS = 141  # of a profile
STATES = 15
KNOTS_PER_S = 40.0  # of the spline over time: 25 ms, a sixteenth of a stroke
# rad, and a part: uneven bending and stretch are weakly expected to be small, so that a gap between particles bends no finger;
# the FEA's lower layer shortens by 2.4 % at 20 kPa
UNEVEN_STD, STRETCH_STD = 0.15, 0.03


@dataclass(frozen=True)
class Strip:
    """Outline points of the finger at rest, counter-clockwise: along the lower layer `s` (m), `height` above it and `side` (of
    `silhouette.sides`); and how the finger hangs.

    `ventral_root` (m, tank frame), `along` (unit vector from root to tip), `dorsal` (unit vector).
    """

    s: np.ndarray
    height: np.ndarray
    side: np.ndarray
    length: float
    thickness: float
    ventral_root: np.ndarray
    along: np.ndarray
    dorsal: np.ndarray


def strip_at_rest(kinematics: Kinematics) -> Strip:
    """The strip that the finger's shape at the start of the motion is. ValueError where that is not straight."""
    pressure = float(kinematics.law(kinematics.time[0]))
    if abs(float(kinematics.shape("bend", pressure))) > 0.05:
        raise ValueError(
            "the simulation's finger is bent at the start of its motion; the lower layer can be measured only where it starts straight"
        )
    outline = counter_clockwise(kinematics.shape("outline", pressure))
    dorsal, along = (
        kinematics.shape("dorsal_direction", pressure),
        kinematics.shape("tip_direction", pressure),
    )
    s, height = (outline - kinematics.root) @ along, (outline - kinematics.root) @ dorsal
    thickness = float(np.ptp(height))
    root = np.asarray(kinematics.root) + height.min() * dorsal
    side = sides(outward(outline), dorsal)
    return Strip(s, height - height.min(), side, kinematics.length, thickness, root, along, dorsal)


def turn(sigma: np.ndarray, a: np.ndarray) -> np.ndarray:
    """θ at fractions of the length, rad."""
    return a[0] * sigma + a[1] * (sigma**2 - sigma) + a[2] * (2 * sigma**3 - 3 * sigma**2 + sigma)


def profile(strip: Strip, a: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Lower layer (point, 2) in the actuator frame: x along the finger at rest, y to the ventral side, m."""
    sigma = np.linspace(0, 1, points)
    middle = turn(0.5 * (sigma[1:] + sigma[:-1]), a)
    pieces = (
        strip.length * (1 + a[3]) / (points - 1) * np.column_stack([np.cos(middle), np.sin(middle)])
    )
    return np.vstack([[0.0, 0.0], np.cumsum(pieces, axis=0)])


def bent_outline(strip: Strip, a: np.ndarray) -> np.ndarray:
    """Outline (point, 2) in the tank frame."""
    line, sigma = profile(strip, a), np.linspace(0, 1, POINTS)
    at = np.clip(strip.s / strip.length, 0, 1)
    angle = turn(at, a)
    x = np.interp(at, sigma, line[:, 0]) + strip.height * np.sin(angle)
    y = np.interp(at, sigma, line[:, 1]) - strip.height * np.cos(angle)
    return strip.ventral_root + x[:, None] * strip.along - y[:, None] * strip.dorsal


def fit_profile(
    integral: np.ndarray,
    mean: float,
    strip: Strip,
    pose: Pose,
    nuisance: np.ndarray,
    first_bend: float,
    weight: float,
) -> np.ndarray:
    """a₁ … a₄ of one frame (`integral_image` of its evidence less `mean`), its outline drawn with `nuisance` (4,).

    `weight`: share of the evidence that is independent.
    """

    expected = np.array([UNEVEN_STD, UNEVEN_STD, STRETCH_STD])

    def loss(a: np.ndarray) -> float:
        outline = bent_outline(strip, a)
        drawn = seen_outline(
            pose, outline, np.column_stack([outward(outline), strip.side]), nuisance
        )
        uneven = 0.5 * np.sum((a[1:] / expected) ** 2)
        return uneven - weight * inside_sum(integral, np.ascontiguousarray(drawn), mean)

    a = np.array([first_bend, 0.0, 0.0, 0.0])
    for size in (0.06, 0.02):
        simplex = np.vstack([a, a + size * np.diag([1.0, 1.0, 1.0, 0.2])])
        a = minimize(
            loss,
            a,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3},
        ).x
    return a


def circle(line: np.ndarray) -> tuple[float, float]:
    """Radius (m, positive towards the ventral side, infinite where straight) and rms residual of the least-squares circle."""
    x, y = line.T
    if np.ptp(y) < 1e-6 * np.ptp(x):
        return float("inf"), float(np.std(y))
    solution, *_ = np.linalg.lstsq(
        np.column_stack([x, y, np.ones_like(x)]), x**2 + y**2, rcond=None
    )
    cx, cy = solution[:2] / 2
    radius = float(np.sqrt(solution[2] + cx**2 + cy**2))
    if radius > 1e3 * np.ptp(x):
        return float("inf"), float(np.std(y))
    return float(np.sign(cy) * radius), float(np.std(np.hypot(x - cx, y - cy)))


def smooth_history(times: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Cubic least-squares spline (C2) with knots every 25 ms through noisy values."""
    inner = np.arange(times[0], times[-1], 1 / KNOTS_PER_S)[1:]
    while inner.size and times.size < inner.size + 8:
        inner = inner[::2]
    return LSQUnivariateSpline(times, values, inner[(inner > times[2]) & (inner < times[-3])], k=3)(
        at
    )


def motion_values(
    kinematics: Kinematics, strip: Strip, times: np.ndarray, shapes: np.ndarray, end_time: float
) -> dict[str, np.ndarray]:
    """Variables of motion.h5 from a₁ … a₄ (frame, 4) at `times` (s of the simulation's clock)."""
    order = np.argsort(times)
    times, shapes = times[order], shapes[order]
    at = np.linspace(max(times[0], 0.0), min(times[-1], end_time), 121)
    bend = smooth_history(times, shapes[:, 0], at)
    pressure = kinematics.pressure_of_bend(bend)
    spread = np.polynomial.polynomial.polyfit(shapes[:, 0], shapes[:, 1:], 2)
    low, high = float(pressure.min()), float(pressure.max())
    margin = 0.03 * (high - low) + 1.0
    states = np.linspace(low - margin, high + margin, STATES)
    bends = kinematics.bend(states)
    uneven = np.polynomial.polynomial.polyval(
        np.clip(bends, shapes[:, 0].min(), shapes[:, 0].max()), spread
    ).T
    lines = np.array(
        [profile(strip, np.array([b, *a])) for b, a in zip(bends, uneven, strict=True)]
    )
    seen = np.array([circle(profile(strip, a)) for a in shapes])
    return {
        "time": at,
        "pressure": pressure,
        "bend": bend,
        "state_pressure": states,
        "profile_x": lines[..., 0],
        "profile_y": lines[..., 1],
        "thickness": np.full(lines.shape[:2], strip.thickness),
        "seen": times,
        "seen_bend": shapes[:, 0],
        "seen_radius": seen[:, 0],
        "seen_residual": seen[:, 1],
    }
