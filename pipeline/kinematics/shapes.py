"""Shapes of the finger over pressure: states in, closed outlines and their rate of change out."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy import ndarray
from scipy.interpolate import CubicSpline

from pipeline.formats.bending_states import States
from pipeline.scene.sections import Chambers, Mount

# of the width of a gap between two chambers
_ROUNDING = 0.35  # radius of its corners
_TIP_PIECES, _POINTS = 8, 141  # of the tip, and of a profile of constant curvature
_STEP = 0.1  # from point to point of an outline with gaps
_SAG, _LONGEST = 0.01, 0.005  # of a corner's radius, of the length: by chords on a mount


@dataclass(frozen=True)
class Strip:
    """Points of the outline: arc length `s` (m) at rest, height `eta` (0 ventral, 1 dorsal).

    Points of a mount lie at s < 0, in the root's axes.
    """

    s: ndarray
    eta: ndarray


def arc_length(line: ndarray) -> ndarray:
    """Length (point,) along a polyline (point, 2), zero at its start."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def rounded_strip(
    length: float,
    thickness: ndarray,
    s: ndarray,
    root_radius: float,
    tip_radius: float,
    points: int = 480,
) -> Strip:
    """Outline of the undeformed finger with rounded corners, counter-clockwise, in even steps.

    `thickness` (point,) is at arc lengths `s` (point,), m.
    """
    limit = 0.49 * min(thickness[0], thickness[-1])
    fine = np.linspace(0, length, 2001)
    height = np.interp(fine, s, thickness)
    cut = np.zeros_like(fine)  # how far the corners' arcs cut into the strip
    for radius, distance in ((root_radius, fine), (tip_radius, length - fine)):
        r = min(radius, limit)
        near = distance < r
        cut[near] += r - np.sqrt(np.maximum(r**2 - (r - distance[near]) ** 2, 0))
    lower = np.column_stack([fine, cut])
    upper = np.column_stack([fine, height - cut])[::-1]
    loop = np.vstack([lower, upper, lower[:1]])
    walk = arc_length(loop)
    at = np.linspace(0, walk[-1], points, endpoint=False)
    x, y = np.interp(at, walk, loop[:, 0]), np.interp(at, walk, loop[:, 1])
    return Strip(s=x, eta=y / np.interp(x, s, thickness))


def with_chambers(
    strip: Strip, chambers: Chambers, length: float, thickness: ndarray, s: ndarray
) -> Strip:
    """A strip with gaps between the chambers on its first `length` (m), counter-clockwise.

    `thickness` (point,) is at arc lengths `s` (point,), m. ValueError where no wall stands between
    two gaps.
    """
    half, top = 0.5 * chambers.gap, 1.01 * float(thickness.max())
    wide = half + np.tan(np.radians(chambers.wedge_deg)) * max(top - chambers.wedge_from, 0.0)
    pitch = (length + chambers.gap) / chambers.count
    if chambers.floor >= thickness.min() or 2 * wide >= pitch - chambers.gap:
        raise ValueError(
            f"finger.chambers: {chambers.count} chambers, {pitch * 1e3:.3g} mm from one to the"
            f" next, leave no walls between gaps of {2e3 * wide:.3g} mm at the top from"
            f" {chambers.floor * 1e3:.3g} mm up in a finger {thickness.min() * 1e3:.3g} mm thick;"
            " give fewer, smaller gap or wedge_deg, or a lower floor"
        )
    r = _ROUNDING * chambers.gap
    if chambers.floor <= 2 * r:
        raise ValueError(
            f"finger.chambers.floor = {chambers.floor:g} m is too thin below gaps of"
            f" {chambers.gap:g} m, whose corners are rounded; give more than {2 * r:.3g}, or a"
            " smaller gap"
        )
    side = [(half, chambers.floor), (half, chambers.wedge_from), (wide, top)]
    gap = np.array([(-x, y) for x, y in side] + side[::-1])
    middles = pitch * np.arange(1, chambers.count) - half
    height = strip.eta * np.interp(strip.s, s, thickness)
    solid = shapely.Polygon(np.column_stack([strip.s, height]))
    solid -= shapely.union_all([shapely.Polygon(gap + np.array([x, 0.0])) for x in middles])
    ring = shapely.orient_polygons(solid.buffer(-r).buffer(2 * r).buffer(-r)).exterior
    at = np.linspace(0, ring.length, int(ring.length / (_STEP * chambers.gap)), endpoint=False)
    x, y = shapely.get_coordinates(shapely.line_interpolate_point(ring, at)).T
    return Strip(s=x, eta=y / np.interp(x, s, thickness))


def with_mount(strip: Strip, mount: Mount, thickness: ndarray, s: ndarray) -> Strip:
    """A strip with a sharp root as one outline with its mount, counter-clockwise.

    `thickness` (point,) is at arc lengths `s` (point,), m.
    """
    radius, half, corner = 0.5 * mount.diameter, 0.5 * thickness[0], mount.corner_radius
    height = strip.eta * np.interp(strip.s, s, thickness)
    disc = shapely.Point(-radius, half).buffer(radius, quad_segs=90)
    neck = shapely.box(-radius, 0.0, 0.0, thickness[0])
    finger = shapely.Polygon(np.column_stack([strip.s, height]))
    solid = shapely.union_all([disc, neck, finger]).buffer(corner, 32).buffer(-corner, 32)
    ring = shapely.orient_polygons(solid.simplify(_SAG * corner)).exterior
    x, y = shapely.get_coordinates(shapely.segmentize(ring, _LONGEST * s[-1]))[:-1].T
    return Strip(s=x, eta=y / np.interp(x, s, thickness))


def pieces(profile: ndarray) -> tuple[ndarray, ndarray]:
    """Tangent angles and lengths (state, piece) of profiles (state, point, 2)."""
    x, y = np.moveaxis(np.diff(profile, axis=1), -1, 0)
    angle = np.unwrap(np.arctan2(y, x), axis=1)
    return angle - 2 * np.pi * np.round(angle[:, :1] / (2 * np.pi)), np.hypot(x, y)


def profile_splines(states: States) -> tuple[CubicSpline, CubicSpline, CubicSpline]:
    """Tangent angle and length of the pieces of the profile, and thickness, over pressure."""
    tables = *pieces(states.profile), states.thickness
    angles, lengths, thickness = (CubicSpline(states.pressure, table) for table in tables)
    return angles, lengths, thickness


def node_angle(angle: ndarray) -> ndarray:
    """Tangent angle (…, point) at a profile's points, from those of its pieces."""
    ends = 1.5 * angle[..., [0, -1]] - 0.5 * angle[..., [1, -2]]
    inner = 0.5 * (angle[..., 1:] + angle[..., :-1])
    return np.concatenate([ends[..., :1], inner, ends[..., 1:]], axis=-1)


class FingerShapes:
    """Finger shapes as smooth functions of pressure.

    Cubic splines interpolate the tangent angle, the length and the thickness of each piece of the
    profile, not its points, so that few states suffice and lengths stay true.
    """

    def __init__(self, states: States, strip: Strip) -> None:
        self._angle, self._length, self._thickness = profile_splines(states)
        rest = int(np.argmin(np.abs(states.pressure)))
        self._s = arc_length(states.profile[rest])
        self.strip = strip
        self._root_thickness = float(states.thickness[rest, 0])
        self.tip_thickness = float(states.thickness[rest, -1])  # of the finger's end at rest, m

    def bend(self, pressure: float) -> float:
        """Bend angle γ (rad): the turn of the tangent from root to tip."""
        angle = self._node_angle(pressure)
        return float(angle[-1] - angle[0])

    def outline(self, pressure: float) -> ndarray:
        """Closed outline (point, 2) in the actuator frame, origin at the middle of the root."""
        return self._place(self.strip, pressure)

    def tip(self, pressure: float) -> ndarray:
        """Rows: middle of the tip, unit tangent out of it, unit vector to the dorsal side."""
        middle = self._place(Strip(self._s[-1:], np.array([0.5])), pressure)[0]
        angle = self._node_angle(pressure)[-1]
        return np.array([middle, [np.cos(angle), np.sin(angle)], [np.sin(angle), -np.cos(angle)]])

    def _node_angle(self, pressure: float) -> ndarray:
        return node_angle(self._angle(pressure))

    def _place(self, strip: Strip, pressure: float) -> ndarray:
        parts = self._angle, self._length, self._thickness
        return self.place(strip, *(part(pressure) for part in parts))

    def place(self, strip: Strip, angle: ndarray, length: ndarray, thickness: ndarray) -> ndarray:
        """Points (n, 2) of a strip, by the `pieces` of a profile and its thickness (point,)."""
        s = strip.s
        behind = s < 0  # on the mount, which is at rest
        thickness = np.where(behind, self._root_thickness, np.interp(s, self._s, thickness))
        turn = np.where(behind, 0.0, np.interp(s, self._s, node_angle(angle)))
        dorsal = np.column_stack([np.sin(turn), -np.cos(turn)])
        tangent = np.column_stack([np.cos(angle), np.sin(angle)])
        steps = length[:, None] * tangent
        curve = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        on_curve = np.column_stack([np.interp(s, self._s, c) for c in curve.T])
        on_curve[behind, 0] = s[behind]
        root = np.array([0.0, -0.5 * self._root_thickness])
        return on_curve + (strip.eta * thickness)[:, None] * dorsal - root


def add_tip(states: States, length: float, thickness: float | None) -> States:
    """States with a straight tip of `length` along the end's tangent, tapering to `thickness`."""
    if length <= 0:
        return states
    last = np.diff(states.profile[:, -2:], axis=1)[:, 0]
    tangent = last / np.hypot(last[:, :1], last[:, 1:])
    steps = np.linspace(0, length, _TIP_PIECES + 1)[1:]
    extension = states.profile[:, -1:, :] + steps[None, :, None] * tangent[:, None, :]
    end = states.thickness[:, -1:]
    goal = end if thickness is None else np.full_like(end, thickness)
    taper = end + (goal - end) * steps[None, :] / length
    return States(
        states.pressure,
        np.concatenate([states.profile, extension], axis=1),
        np.concatenate([states.thickness, taper], axis=1),
        states.curvature_std,
    )


def circular_states(pressure: ndarray, bend: ndarray, length: float, thickness: float) -> States:
    """States of constant curvature: a profile of fixed `length` bent by `bend` (state,) rad."""
    s = np.linspace(0, 1, _POINTS)
    angle = bend[:, None] * (0.5 * (s[1:] + s[:-1]))[None]
    piece = (length / (_POINTS - 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # chords of a circle are shorter than its arc: keep the points on the circle
    half = bend[:, None] / (_POINTS - 1) / 2
    piece = piece * np.sinc(half / np.pi)[..., None]
    profile = np.concatenate([np.zeros((len(pressure), 1, 2)), np.cumsum(piece, axis=1)], axis=1)
    return States(pressure, profile, np.full((len(pressure), _POINTS), thickness))
