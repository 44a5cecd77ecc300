"""Windows of time of findings: by bend angle, by gap, around contact, or within a stroke."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import ndarray

from postprocess.evidence.strokes import MIDDLE, stroke_window

# m of gap between tip and plane, over which a pinch is judged; nearer the two regions meet
APPROACH = (0.020, 0.005)
_CONTACT = 1e-4  # m above the residual gap: nearer, the tips count as in contact
_FORMS = (
    '"known", [a, b], { gap = [a, b] }, { contact = [a, b] }, { stroke = k, part = [a, b] }'
    " or { stroke = k, after = [a, b] }"
)


@dataclass(frozen=True)
class Window:
    """Two edges of a `kind`: "bend" (fractions of the change of bend angle), "gap" (m, falling),
    "contact" (s from contact), "part" (as "bend", of one stroke) or "after" (s from its start).

    "known" has none: it lasts while CFD and PIV know the tip's vortex.
    """

    kind: str
    edges: tuple[float, float]
    stroke: int = 0

    def words(self) -> str:
        """Describe the window to a reader."""
        a, b = self.edges
        return {
            "known": "while CFD and PIV know the tip vortex",
            "bend": f"{100 * a:.0f} to {100 * b:.0f} % of the bend",
            "gap": f"from a gap of {a * 1e3:g} mm between tip and plane down to {b * 1e3:g} mm",
            "contact": f"{a:+g} to {b:+g} s from contact",
            "part": f"{100 * a:.0f} to {100 * b:.0f} % of the bend of stroke {self.stroke + 1}",
            "after": f"{a:g} to {b:g} s after the start of stroke {self.stroke + 1}",
        }[self.kind]


@dataclass(frozen=True)
class Clock:
    """What windows are defined by: progress over time (s), gap (m) over gap_time, strokes' starts.

    `progress` as of postprocess.evidence.strokes (the bend in rad). `known`: from when to when CFD
    and PIV know the tip's vortex, s; None: never both, or there is no PIV.
    """

    time: ndarray
    progress: ndarray
    gap_time: ndarray | None = None
    gap: ndarray | None = None
    residual_gap: float = 0.0
    starts: tuple[float, ...] = ()
    known: tuple[float, float] | None = None

    def middle(self) -> tuple[float, float]:
        """First and last instant (s) of the middle of the stroke."""
        return stroke_window(self.time, self.progress, MIDDLE)

    def judged(self) -> tuple[float, float]:
        """While CFD and PIV know the vortex, else the middle of the stroke, s."""
        return self.known or self.middle()

    def stroke(self) -> tuple[float, float]:
        """From the beginning (s) until the stroke after that of `middle` begins, or to the end."""
        end = self.middle()[1]
        return float(self.time[0]), min([s for s in self.starts if s >= end] or [self.time[-1]])

    def gaps(self) -> tuple[ndarray, ndarray]:
        """Times (s) and gaps (m); ValueError where there is no second finger."""
        if self.gap is None or self.gap_time is None:
            raise ValueError(
                "the scene has one finger, so there is no gap to count from; kinematics.h5 has none"
            )
        return self.gap_time, self.gap

    def gap_at(self, time: ndarray) -> ndarray:
        """The gap (m) at other times (s)."""
        return np.interp(time, *self.gaps())

    def closing(self) -> tuple[float, float]:
        """First and last instant (s) of APPROACH; of the middle of the stroke if it is not met."""
        try:
            return interval(Window("gap", APPROACH), self)
        except ValueError:
            return self.middle()

    def met(self) -> float | None:
        """When the tips meet, s: the gap is within `_CONTACT` of the residual gap; or None."""
        contact = self.residual_gap + _CONTACT
        return gap_reached(self, contact) if self.gaps()[1].min() <= contact else None


def read_window(value: Any) -> Window:
    """The window that a finding gives; ValueError where it is none of the forms."""
    if value == "known":
        return Window("known", (0.0, 1.0))
    table: Any = {"bend": value} if isinstance(value, list) else value
    keys = set(table) if isinstance(table, dict) else set()
    if keys not in ({"bend"}, {"gap"}, {"contact"}, {"stroke", "part"}, {"stroke", "after"}):
        raise ValueError(f"{value!r} must be one of {_FORMS}")
    [kind], stroke = keys - {"stroke"}, int(table.get("stroke", 0))
    if not isinstance(table[kind], list) or len(table[kind]) != 2:
        raise ValueError(f"{value!r} needs two edges")
    a, b = (float(edge) for edge in table[kind])
    right, form = {
        "bend": (0 <= a < b <= 1, "two fractions of the stroke, rising, in 0…1"),
        "gap": (a > b >= 0, "two gaps in m, falling, as the fingers close"),
        "contact": (a < b, "two times in s, rising"),
    }[{"part": "bend", "after": "contact"}.get(kind, kind)]
    if not right:
        raise ValueError(f"{value!r} must be {form}")
    if stroke < 0:
        raise ValueError(f"{value!r}: strokes are counted from 0")
    return Window(kind, (a, b), stroke)


def interval(window: Window, clock: Clock) -> tuple[float, float]:
    """First and last instant, s; ValueError where the motion has no such gap, contact or stroke."""
    a, b = window.edges
    if window.kind == "known":
        return clock.judged()
    if window.kind == "bend":
        return stroke_window(clock.time, clock.progress, (a, b))
    if window.kind == "gap":
        return gap_reached(clock, a), gap_reached(clock, b)
    if window.kind == "contact":
        at = gap_reached(clock, clock.residual_gap + _CONTACT)
        return at + a, at + b
    if window.stroke >= len(clock.starts):
        raise ValueError(
            f"the window names stroke {window.stroke} (from 0) and the motion has"
            f" {len(clock.starts)} strokes"
        )
    start = clock.starts[window.stroke]
    if window.kind == "after":
        return start + a, start + b
    end = (*clock.starts, np.inf)[window.stroke + 1]
    within = (clock.time >= start) & (clock.time <= end)
    return stroke_window(clock.time[within], clock.progress[within], (a, b))


def gap_reached(clock: Clock, gap: float) -> float:
    """When the gap first falls to `gap` (m), in s; ValueError where it never does."""
    times, gaps = clock.gaps()
    below = np.flatnonzero(gaps <= gap)
    if below.size == 0:
        raise ValueError(
            f"the fingers never come within {gap * 1e3:.3g} mm of the plane between them;"
            f" the least gap is {gaps.min() * 1e3:.3g} mm"
        )
    k = int(below[0])
    if k == 0:
        return float(times[0])
    pair = slice(k - 1, k + 1)
    return float(np.interp(-gap, -gaps[pair], times[pair]))
