"""From unit cells to the finger: profile of the lower layer in the actuator's frame, its circle."""

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from pipeline.formats.bending_states import FloatArray

_STRICT = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}


def chain(
    half: FloatArray, angle: float, rest: FloatArray, chambers: int, end: float
) -> FloatArray:
    """Profile (point, 2) of a finger of unit cells, from the root's ventral edge.

    `half` (m, 2) is the deformed profile from the middle of a chamber to the middle of a gap, in
    the frame of the unit cell, `angle` (rad) the turn of its end, `rest` (m) its undeformed x. The
    outer walls are at `end` from the middle of a chamber. The root half of the first chamber is
    clamped, so that 2 n − 1 halves bend.
    """
    within = rest <= end * (1 + 1e-9)
    z = half[:, 0] - 1j * half[:, 1]  # y towards the ventral side
    turn = np.exp(1j * angle)
    forth = z - z[0]
    # mirrored at the plane in the middle of the gap, and starting level
    back = -np.conj((z - z[-1]) / turn)[::-1]
    pieces = [(end - rest[within][::-1]).astype(complex)]
    place, heading = complex(end), 1.0 + 0j
    for number in range(2 * chambers - 1):
        piece = back if number % 2 else forth
        if number == 2 * chambers - 2:
            piece = piece[within]
        pieces.append((place + heading * piece)[1:])
        place, heading = pieces[-1][-1], heading * turn
    line = np.concatenate(pieces)
    return np.stack([line.real, line.imag], -1)


def fit_circle(profile: FloatArray) -> tuple[float, float]:
    """Signed radius (m) of the least-squares circle through a profile (point, 2), and rms distance.

    Positive where the profile turns towards +y; infinite where it is straight to 1e-6 of its
    length. The distances (m) are geometric.
    """
    length = float(arc_length(profile)[-1])
    # of few chords, which noise turns by little
    few = profile[np.linspace(0, len(profile) - 1, min(8, len(profile))).round().astype(int)]
    middle = (len(few) - 1) // 2
    direction = np.unwrap(np.arctan2(*np.diff(few, axis=0).T[::-1]))
    a, b = np.cos(direction[middle]), np.sin(direction[middle])
    s, h = ((profile - few[middle : middle + 2].mean(0)) / length @ [[a, -b], [b, a]]).T

    def distance(unknowns: FloatArray) -> FloatArray:
        curvature, offset, turn = unknowns
        c, d = np.cos(turn), np.sin(turn)
        x, y = c * s + d * (h - offset), -d * s + c * (h - offset)
        # |x − centre| − R, without dividing by the curvature, which holds for a line too
        root = np.hypot(curvature * x, 1 - curvature * y)
        return (curvature * (x**2 + y**2) - 2 * y) / (1 + root)

    fit = least_squares(distance, [direction[-1] - direction[0], 0.0, 0.0], **_STRICT)
    curvature = float(fit.x[0])
    radius = length / curvature if abs(curvature) > 8e-6 else np.inf
    return radius, float(np.sqrt(np.mean(fit.fun**2))) * length


def arc_length(profile: FloatArray) -> FloatArray:
    """Length (point) along a profile (..., point, 2), zero at its start."""
    steps = np.linalg.norm(np.diff(profile, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, -1)], -1)


def smoothed(profiles: FloatArray, rest: FloatArray, intervals: int = 6) -> FloatArray:
    """Profiles (state, point, 2) without the chambers' ripple, at the same material points.

    Least-squares cubic splines over the undeformed length `rest` (point), on intervals longer than
    a pitch; the root keeps its place and direction. The ripple is below 0.1 mm, but normals of the
    bare profile would cross within the finger where it bends sharply.
    """
    s = (rest - rest[0]) / (rest[-1] - rest[0])
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, intervals + 1), np.ones(3)])
    basis = BSpline.design_matrix(s, knots, 3).toarray()
    result = np.empty_like(profiles)
    # the first coefficient is the root's place, the second its direction
    for axis, fixed in ((0, 1), (1, 2)):
        moved = (profiles[..., axis] - profiles[:, :1, axis]).T
        coefficients = np.linalg.lstsq(basis[:, fixed:], moved, rcond=None)[0]
        result[..., axis] = (basis[:, fixed:] @ coefficients).T + profiles[:, :1, axis]
    return result
