"""The starting vortex of a sharp edge: a thin plate moved broadside on from rest, U ∝ t^m."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import law_and_body, provenance, reference
from pipeline.kinematics.rigid_body import travelled
from pipeline.scene.scene import Scene

REACH = 4.0  # distances of the core from the edge within which its vortex lies
LARGEST = 0.15  # chords from the edge within which the core lies at the last instant
GROWTH = 1.1  # largest factor of the core's distance from an instant to the one before
CORE_PART = 0.3  # of that distance: radius of the fit of the least pressure
# Mean speed so far / chord: smaller vorticity is an error of the coarse mesh far away.
LEAST_VORTICITY = 0.5


@dataclass(frozen=True)
class _Shed:
    """Vorticity that has left one edge at one instant.

    Circulation in m²/s; centroid and core in m from the edge, x inboard, y behind.
    """

    time: float
    circulation: float
    centroid: tuple[float, float]
    core: tuple[float, float]


def _reattachment(surface: pv.DataSet, half_chord: float, centre_y: float) -> float:
    """x at which the flow behind the right half of the plate reattaches.

    Inner end of the longest stretch along which water runs outwards.
    """
    points = np.asarray(surface.cell_centers().points)
    # wall shear stress is that of the wall on the water: against the flow
    stress = np.asarray(surface["wallShearStress"])[:, 0]
    behind = (points[:, 1] < centre_y) & (points[:, 0] > 0) & (points[:, 0] < half_chord)
    order = np.argsort(points[behind, 0])
    x, outwards = points[behind, 0][order], stress[behind][order] < 0
    change = np.flatnonzero(np.diff(np.concatenate([[0], outwards.astype(int), [0]])))
    begin, end = change[::2], change[1::2]
    if not len(begin):
        return half_chord
    return float(x[begin[np.argmax(x[end - 1] - x[begin])]])


def _lowest(points: np.ndarray, pressure: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Place (2,) of least pressure, by a paraboloid through the points (n, 2) around it."""
    first = points[np.argmin(pressure)]
    radius = CORE_PART * np.hypot(*(first - edge))
    x, y = (points - first).T
    near = np.hypot(x, y) < radius
    if near.sum() < 12:
        return first
    x, y = x[near], y[near]
    matrix = np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])
    _, b, c, d, e, f = np.linalg.lstsq(matrix, pressure[near], rcond=None)[0]
    if 4 * d * f <= e**2:
        return first
    step = np.linalg.solve([[2 * d, e], [e, 2 * f]], [-b, -c])
    return first + step if np.hypot(*step) < radius else first


def _shed(scene: Scene, time: float, way: float, sheet: Path, wall: Path, within: float) -> _Shed:
    """Vorticity of the right edge's sign behind the plate, outboard of the reattachment.

    The core lies within `within` m of the edge.
    """
    _, body = law_and_body(scene)
    half, y = 0.5 * body.chord, body.centre[1] + way
    cells = pv.read(sheet).point_data_to_cell_data().compute_cell_sizes(length=False, volume=False)
    gradient, area, pressure = (np.asarray(cells[name]) for name in ("gradU", "Area", "p"))
    centres = np.asarray(cells.cell_centers().points)
    omega = gradient[:, 1] - gradient[:, 3]
    edge = np.array([half, y])
    distance = np.hypot(*(centres[:, :2] - edge).T)
    behind = centres[:, 1] < y
    away = behind & (centres[:, 0] > 0) & (y - centres[:, 1] > 2 * body.thickness) & (omega < 0)
    near = away & (distance < within)
    core = _lowest(centres[near, :2], pressure[near], edge)
    reach = REACH * float(np.hypot(*(core - edge)))
    least = LEAST_VORTICITY * way / (time * body.chord)
    outboard = centres[:, 0] > _reattachment(pv.read(wall), half, y)
    mine = behind & (distance < reach) & outboard & (omega < -least)
    strength = omega[mine] * area[mine]
    total = float(strength.sum())
    middle = strength @ centres[mine, :2] / total
    return _Shed(time, -total, tuple(edge - middle), tuple(edge - core))


def _history(scene: Scene) -> list[_Shed]:
    """Every picture of the sheet after the smooth start."""
    law, body = law_and_body(scene)
    path = travelled(law, scene.motion.end_time)
    folder = scene.out / "case" / "interval_0" / "postProcessing"
    files = sorted((float(f.name), f / "sheet.vtk") for f in (folder / "sheetSurface").glob("*"))
    rows: list[_Shed] = []
    within = LARGEST * body.chord
    # From last to first: the least pressure behind an accelerated plate is at its middle, where
    # the vortex is small.
    for time, file in reversed(files):
        if time > law.start + 1.5 * law.smoothing:
            wall = folder / "fingerSurface" / file.parent.name / "finger.vtk"
            way = float(np.interp(time, path.time, path.distance))
            rows.append(_shed(scene, time, way, file, wall, within))
            within = GROWTH * float(np.hypot(*rows[-1].core))
    return rows[::-1]


def measure(scene: Scene) -> Result:
    """Exponents of circulation and displacement over a decade of time in the self-similar range."""
    law, body = law_and_body(scene)
    span, m, chord = reference(scene.name)["range"], law.exponent, body.chord
    rows = _history(scene)
    # half the smoothing later a sudden start has covered the same distance
    origin = law.start + (0.5 * law.smoothing if m == 0 else 0.0)
    time = np.array([r.time for r in rows]) - origin
    gamma = np.array([r.circulation for r in rows])
    centroid = np.hypot(*np.array([r.centroid for r in rows]).T)
    core = np.hypot(*np.array([r.core for r in rows]).T)
    first, last = span["from"], span["to"]
    wanted = {"circulation": (4 * m + 1) / 3, "displacement": 2 * (m + 1) / 3}
    why = (
        "0.05 in the exponent is 12 % over the decade, about what the mesh may change the finger's"
        " circulation by"
    )
    distance = wanted["displacement"]
    checks = tuple(
        Check(f"{scene.name}.{name}", f"exponent of {what}", _exponent(time, value, first, last),
              0.05, "absolute", why, power, span["source"])
        for name, what, value, power in (
            ("circulation", "the shed circulation over time", gamma, wanted["circulation"]),
            ("core", "the core's distance from the edge (least pressure)", core, distance),
            ("centroid", "the distance of the shed vorticity's centroid", centroid, distance),
        )
    )  # fmt: skip
    curves = {"time": time, "circulation": gamma / (law.rate * last**m * chord)}
    curves |= {"core": core / chord, "centroid": centroid / chord}
    curves = {name: value.tolist() for name, value in curves.items()}
    curves |= {"from": first, "to": last, "wanted": wanted}
    return Result(scene.name, scene.title, checks, curves, provenance(scene))


def _exponent(time: np.ndarray, value: np.ndarray, first: float, last: float) -> float:
    """Power of time that a value follows, with equal weight of every part of the log time."""
    at = np.linspace(np.log(first), np.log(last), 50)
    return float(np.polyfit(at, np.interp(at, np.log(time), np.log(value)), 1)[0])
