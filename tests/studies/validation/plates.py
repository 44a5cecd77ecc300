"""The starting vortex of a sharp edge: a thin plate moved broadside on from rest, U ∝ t^m."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from pipeline.kinematics.rigid_body import travelled
from pipeline.scene.scene import Scene
from tests.studies.validation.checks import Check, Result
from tests.studies.validation.solve import provenance, reference

REACH = 4.0  # distances of the core from the edge within which its vortex is looked for
LARGEST = 0.15  # chords from the edge within which the core is looked for at the last instant
GROWTH = 1.1  # the core may have been so much farther out at the instant before: only there it is looked for
CORE_PART = 0.3  # of that distance: radius in which the least pressure is fitted
LEAST_VORTICITY = 0.5  # mean speed so far / chord: below it lies what the coarse far mesh makes of a potential flow


@dataclass(frozen=True)
class Shed:
    """What has left one edge at one instant: circulation (m²/s), centroid and core from the edge (x inboard, y behind; m)."""

    time: float
    way: float
    circulation: float
    centroid: tuple[float, float]
    core: tuple[float, float]
    attached_from: float  # x at which the flow behind the plate reattaches, from its centre


def cell_vorticity(plane: pv.DataSet) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centres (cell, 3), areas, vorticity (1/s) and pressure of a picture of the sheet."""
    cells = plane.point_data_to_cell_data().compute_cell_sizes(length=False, volume=False)
    gradient = np.asarray(cells["gradU"])
    centres = np.asarray(plane.cell_centers().points)
    return (
        centres,
        np.asarray(cells["Area"]),
        gradient[:, 1] - gradient[:, 3],
        np.asarray(cells["p"]),
    )


def reattachment(surface: pv.DataSet, half_chord: float, centre_y: float) -> float:
    """x of the inner end of the longest stretch behind the right half of the plate where water runs outwards along it."""
    points = np.asarray(surface.cell_centers().points)
    stress = np.asarray(surface["wallShearStress"])[
        :, 0
    ]  # of the wall on the water: against the flow
    behind = (points[:, 1] < centre_y) & (points[:, 0] > 0) & (points[:, 0] < half_chord)
    order = np.argsort(points[behind, 0])
    x, outwards = points[behind, 0][order], stress[behind][order] < 0
    change = np.flatnonzero(np.diff(np.concatenate([[0], outwards.astype(int), [0]])))
    begin, end = change[::2], change[1::2]
    if not len(begin):
        return half_chord
    longest = np.argmax(x[end - 1] - x[begin])
    return float(x[begin[longest]])


def lowest(points: np.ndarray, pressure: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Place (2,) of least pressure: that of a paraboloid through the points (n, 2) around the lowest one."""
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


def shed(scene: Scene, time: float, way: float, sheet: Path, wall: Path, within: float) -> Shed:
    """Vorticity of the right edge's sign behind the plate, outboard of where the flow reattaches; its core is `within` m of the edge."""
    body = scene.body
    assert body is not None
    assert body.chord is not None
    assert body.thickness is not None
    half, y = 0.5 * body.chord, body.centre[1] + way
    centres, area, omega, pressure = cell_vorticity(pv.read(sheet))
    inner = reattachment(pv.read(wall), half, y)
    edge = np.array([half, y])
    distance = np.hypot(*(centres[:, :2] - edge).T)
    behind = centres[:, 1] < y
    away = behind & (centres[:, 0] > 0) & (y - centres[:, 1] > 2 * body.thickness) & (omega < 0)
    near = away & (distance < within)
    core = lowest(centres[near, :2], pressure[near], edge)
    reach = REACH * float(np.hypot(*(core - edge)))
    least = LEAST_VORTICITY * way / (time * body.chord)
    mine = behind & (distance < reach) & (centres[:, 0] > inner) & (omega < -least)
    strength = omega[mine] * area[mine]
    total = float(strength.sum())
    middle = strength @ centres[mine, :2] / total
    return Shed(
        time, way, -total, (half - middle[0], y - middle[1]), (half - core[0], y - core[1]), inner
    )


def history(scene: Scene, case: Path) -> list[Shed]:
    """Every picture of the sheet after the smooth start."""
    law, body = scene.motion.displacement, scene.body
    assert law is not None
    assert body is not None
    assert body.chord is not None
    path = travelled(law, scene.motion.end_time)
    folder = case / "postProcessing"
    files = sorted((float(f.name), f / "sheet.vtk") for f in (folder / "sheetSurface").glob("*"))
    rows: list[Shed] = []
    within = LARGEST * body.chord
    # from the last to the first: the least pressure behind an accelerated plate is at its middle, where the vortex is small
    for t, file in reversed(files):
        if t > law.start + 1.5 * law.smoothing:
            wall = folder / "fingerSurface" / file.parent.name / "finger.vtk"
            rows.append(
                shed(scene, t, float(np.interp(t, path.time, path.distance)), file, wall, within)
            )
            within = GROWTH * float(np.hypot(*rows[-1].core))
    return rows[::-1]


def measure(scene: Scene) -> Result:
    """Exponents of circulation and displacement over a decade of time in the self-similar range."""
    law, body = scene.motion.displacement, scene.body
    assert law is not None
    assert law.exponent is not None
    assert law.rate is not None
    assert body is not None
    assert body.chord is not None
    ref = reference(scene.name)
    rows = history(scene, scene.out / "case" / "interval_0")
    # a sudden start is replaced by one half the smoothing later: the way travelled is the same from then on
    origin = law.start + (0.5 * law.smoothing if law.exponent == 0 else 0.0)
    time = np.array([r.time for r in rows]) - origin
    gamma = np.array([r.circulation for r in rows])
    centroid = np.hypot(*np.array([r.centroid for r in rows]).T)
    core = np.hypot(*np.array([r.core for r in rows]).T)
    first, last = ref["range"]["from"], ref["range"]["to"]
    m = law.exponent
    wanted = {"circulation": (4 * m + 1) / 3, "displacement": 2 * (m + 1) / 3}
    why = "0.05 in the exponent is 12 % over the decade, about what the mesh may change the finger's circulation by"
    checks = (
        Check(f"{scene.name}.circulation", "exponent of the shed circulation over time",
              exponent(time, gamma, first, last), 0.05, "absolute", why, wanted["circulation"], ref["range"]["source"]),
        Check(f"{scene.name}.core", "exponent of the core's distance from the edge (least pressure)",
              exponent(time, core, first, last), 0.05, "absolute", why, wanted["displacement"], ref["range"]["source"]),
        Check(f"{scene.name}.centroid", "exponent of the distance of the shed vorticity's centroid",
              exponent(time, centroid, first, last), 0.05, "absolute", why, wanted["displacement"], ref["range"]["source"]),
    )  # fmt: skip
    speed = law.rate * last**m
    unit = speed * body.chord
    curves = {
        "time": time.tolist(), "way": [r.way / body.chord for r in rows], "from": first, "to": last,
        "circulation": (gamma / unit).tolist(), "core": (core / body.chord).tolist(),
        "centroid": (centroid / body.chord).tolist(), "wanted": wanted,
    }  # fmt: skip
    half = np.sqrt(first * last)
    local = [
        f"{exponent(time, gamma, *part):.2f}, {exponent(time, core, *part):.2f}"
        for part in ((first, half), (half, last))
    ]
    begin = int(np.argmax(time >= first))
    layer = float(np.sqrt(scene.fluid.kinematic_viscosity * time[begin]) / core[begin])
    remarks = (
        f"Local exponents (circulation, core) of the first and the last half of the decade: {local[0]}; {local[1]}.",
        f"Where the decade begins the core is {core[begin] / body.thickness:.2g} thicknesses of the plate from the edge, and the"
        f" layer at the wall, √(νt), is {layer:.0%} of that distance.",
    )
    text = (
        f"U ∝ t^{m:g}. The shed circulation is the vorticity that leaves the edge and does not reattach: that of the edge's sign"
        f" behind the plate, outboard of where the flow reattaches. The decade, {first:g} s < t < {last:g} s, ends where the plate"
        f" has gone {np.interp(last, time, curves['way']):.2g} chords; the core is"
        f" {np.interp(last, time, core) / body.chord:.2g} chords from the edge there."
    )
    return Result(scene.name, scene.title, text, checks, curves, remarks, provenance(scene))


def exponent(time: np.ndarray, value: np.ndarray, first: float, last: float) -> float:
    """Power of time that a value follows from `first` to `last`, every part of the span in log time counting alike."""
    at = np.linspace(np.log(first), np.log(last), 50)
    return float(np.polyfit(at, np.interp(at, np.log(time), np.log(value)), 1)[0])
