"""What must hold of any scene's run: the checks of docs/evidence/park/table.py.

Each check is a number, or a sentence that says why it does not apply.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from shapely import LinearRing, Point

from pipeline.case.interval_case import sides
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import (
    PER_FINGER,
    IntervalMesh,
    NodeMotion,
    read_intervals,
    read_planform,
    read_sweep,
)
from pipeline.formats.records import COMPARISON, FORCES, RUN
from pipeline.geometry.sweep import OUTER_PATCHES
from pipeline.runs.run import Run
from pipeline.scene.predicted import picture_of
from pipeline.structure.motion import EARLIER, felt
from pipeline.structure.water_inertia import forces_of_water
from piv.formats.plane_series import Planes, read_plane
from piv.vortices.contour import round_contour
from piv.vortices.find import Vortex, find_vortices
from piv.vortices.settings import VortexSettings
from postprocess.evidence import tip_vortex as tracks
from softfinger.sheets import make_sheet

_PLANES = 12  # of the whole tank
_SAME = 0.3  # radii: the same vortex in two views
_GROWN = 0.1  # of the largest of a run, by circulation or by peak and radius: others are young
_CLEAR = 2.0  # radii of a vortex from a contour that it leaves as it is
_EARLY = 0.02  # s of the first forces
_FIRST_STEPS = 5  # of the solver, whose pressure is not settled yet
# way of the tip over the thickness: beyond a sensor's noise, and before a vortex has a force
_BEGUN, _YOUNG = 0.01, 0.05
_LAYER = 0.012  # of the thickness, of a layer √(ν t): a thicker one's friction has a force
# of the room from the tank's sides to what the finger reaches: where contours of the total run
_SHARES = (0.3, 0.35, 0.4, 0.45, 0.5)
_ACCURATE = 1e-3  # of the inertia's sources: a coupled run's 3e-2 left up to 7 % of the force


class Limit(NamedTuple):
    """A check: its heading, the largest number that passes, and the reason for it."""

    about: str
    most: float
    reason: str


LIMITS = {
    "unexplained": Limit(
        "power unexplained",
        0.05,
        "shipped scenes leave 0.1 to 2 % by the sampling of the terms",
    ),
    "at_edge": Limit(
        "instants at which the strongest vortex, once grown, meets an edge within the water",
        0.0,
        "its circulation is not known there: the view is wrong",
    ),
    "changed_sign": Limit(
        "tracks that change sign", 0.0, "a vortex keeps its sense, so that another is followed"
    ),
    "in_view": Limit(
        "circulation in the view against the whole flow",
        0.03,
        "both sample the same flow at the same points; young vortices of two cells differ more",
    ),
    "total": Limit(
        "total circulation over the strongest vortex",
        0.005,
        "none was there before the motion; mean of contours that are two radii from any vortex",
    ),
    "early_force": Limit(
        "first force less that of added mass, over the forces on parts of the outline",
        0.03,
        "by the solver's own differences; cells and layers at the wall leave 1 to 1.5 %",
    ),
    "cost": Limit(
        "cost, a factor from the prediction",
        1.5,
        "what a user can plan with, once the speed of the machine is known",
    ),
    "uncommon": Limit(
        "difference of the instants of the cards", 0.0, "means are compared at common instants"
    ),
}


@dataclass(frozen=True)
class Outcome:
    """What a run shows by the names of LIMITS, and why it ended without a page ("": it has one).

    A text in place of a number says why a check does not apply.
    """

    values: dict[str, Any]
    ended: str

    def failed(self) -> list[str]:
        """Names of the checks that fail; of a run without a page that. A missing number fails."""
        if self.ended:
            return ["page"]
        return [name for name in LIMITS if self._fails(name)]

    def _fails(self, name: str) -> bool:
        value = self.values.get(name)
        if isinstance(value, str):
            return not value
        return value is None or not value <= LIMITS[name].most


def checks(run: Run) -> dict[str, float | str]:
    """Each number of LIMITS but the cost, or why there is none."""
    found: dict[str, Callable[[Run], float | str]] = {
        "unexplained": _unexplained,
        "at_edge": _at_edge,
        "changed_sign": _changed_sign,
        "early_force": _early_force,
        "uncommon": _uncommon,
    }
    return {name: measure(run) for name, measure in found.items()} | _whole_flow(run)


def _unexplained(run: Run) -> float:
    balance = RUN.read(run.out / "run" / "run.json")["power_balance"]
    return abs(float(balance["unexplained_fraction"]))


def _vortices(run: Run) -> list[pd.DataFrame]:
    """Vortices of the flow, and those of PIV where the run has it."""
    sources = ("cfd", "piv") if run.scene.filmed else ("cfd",)
    return [tracks.read_vortices(run.out / f"vortices_{source}.csv") for source in sources]


def _at_edge(run: Run) -> float:
    """Instants at which the largest vortex of the flow, or of PIV, meets an edge within the water.

    A vortex at the lid or a wall is cut by the water's own edge, which no view changes.
    """
    count, scene = 0, run.scene
    half = 0.5 * scene.tank.size[0]
    water = np.array([(-half, 0.0), (half, scene.tank.water_depth)])
    picture = np.array(picture_of(scene.camera))
    for table in _vortices(run):
        within = _nearest_within(table[["x", "y"]].to_numpy(), picture, water)
        table = table.assign(at_edge=table["at_edge"] * within)
        size = (table["peak_vorticity"] * table["radius"] ** 2).abs()
        if len(table):
            largest = size.groupby(table["time"]).idxmax()
            grown = largest[size[largest].to_numpy() > _GROWN * size.max()]
            count += int(table.loc[grown, "at_edge"].sum())
    return float(count)


def _nearest_within(places: np.ndarray, picture: np.ndarray, water: np.ndarray) -> np.ndarray:
    """Tell of places (n, 2) whether the nearest edge of a picture lies within the water.

    Both by their lower left and upper right corners (2, 2) in m.
    """
    away = np.abs(picture[:, None] - places).transpose(1, 0, 2).reshape(-1, 4)
    inside = ((picture - water) * [[1], [-1]] > 0).ravel()  # left, lower, right, upper edge
    return inside[away.argmin(axis=1)]


def _changed_sign(run: Run) -> float:
    count = 0
    for table in _vortices(run):
        signs = np.sign(table["peak_vorticity"]).groupby(table["track"]).nunique()
        count += int((signs > 1).sum())
    shown = pd.read_csv(run.out / "comparison.csv")
    for name in ("circulation_cfd", "circulation_piv"):
        if name in shown:
            count += int(np.sign(shown[name].dropna()).nunique() > 1)
    return float(count)


def _uncommon(run: Run) -> float | str:
    if not run.scene.filmed:
        return "no PIV"
    summary = COMPARISON.read(run.out / "comparison.json")["summary"]
    counts = [summary[source]["instants"] for source in ("cfd", "piv") if source in summary]
    if len(counts) == 1:
        return "a vortex near the tip in one source alone"
    return float(max(counts) - min(counts)) if counts else "no vortex near the tip"


def _whole_flow(run: Run) -> dict[str, float | str]:
    """The strongest vortex in the view against that of the whole tank, and the flow's sum."""
    scene = run.scene
    half, top = 0.5 * scene.tank.size[0], scene.tank.water_depth
    path = run.out / "whole_tank.h5"
    make_sheet(run, (-half, half, 0.0, top), path, quiet=True, most=_PLANES)
    table = tracks.read_vortices(run.out / "vortices_cfd.csv")
    settings = VortexSettings(**scene.vortices.model_dump(mode="json"))
    contours = _contours(_reached(run), np.array([(-half, 0.0), (half, top)]))
    found, sums = [], []
    with read_plane(path) as series:
        for plane in map(Planes(series).__getitem__, range(series.sizes["time"])):
            every = find_vortices(plane, settings)
            whole = [v for v in every if not v.at_edge]
            if not whole:
                continue
            clear = [c for c in contours if all(_clear(c, v) for v in every)]
            if clear:
                sums.append(abs(np.mean([round_contour(plane, c).circulation for c in clear])))
            one = max(whole, key=lambda v: abs(v.circulation_disc))
            now = table[(table["time"] - float(plane["time"])).abs() < 1e-6]
            away = np.hypot(now["x"] - one.x, now["y"] - one.y)
            seen = now[away < _SAME * one.radius]["circulation"].fillna(0.0)
            found.append((one.circulation_disc, float(seen.iloc[0]) if len(seen) else 0.0))
    path.unlink()
    if not found:
        return dict.fromkeys(("in_view", "total"), "no vortex in the tank")
    view, total = _against_whole(np.array(found), np.array(sums))
    return {"in_view": view, "total": "two halves cancel" if scene.pinch else total}


def _clear(contour: np.ndarray, vortex: Vortex) -> bool:
    """Tell whether a vortex is far from a contour (4, 2) m."""
    away = LinearRing(contour).distance(Point(vortex.x, vortex.y))
    return bool(away > _CLEAR * vortex.radius)


def _reached(run: Run) -> np.ndarray:
    """Lower left and upper right corner (2, 2) m of what fingers reach and obstacles fill."""
    data = read_kinematics(run.scene.motion_folder / "kinematics.h5").data
    places = [data["shape_outline"].values.reshape(-1, 2)]
    places += [np.reshape(thing.polygon.bounds, (2, 2)) for thing in run.scene.obstacle or ()]
    every = np.vstack(places)
    return np.array([every.min(0), every.max(0)])


def _contours(reached: np.ndarray, water: np.ndarray) -> list[np.ndarray]:
    """Rectangles (4, 2) m between two given by their lower left and upper right corners (2, 2)."""
    boxes = [(water + share * (reached - water)).ravel() for share in _SHARES]
    return [np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) for x0, y0, x1, y1 in boxes]


def _against_whole(found: np.ndarray, sums: np.ndarray) -> tuple[float, float | str]:
    """Largest error of the view and largest sum over the strongest vortex; NaN where one is.

    `found` (instant, 2): circulation of the strongest vortex in the tank and in the view.
    """
    whole, seen = found.T
    largest = np.abs(whole).max()
    grown = np.abs(whole) > _GROWN * largest
    view = float(np.abs(seen[grown] / whole[grown] - 1.0).max())
    return view, float(sums.max() / largest) if len(sums) else "no contour clear of vortices"


def _early_force(run: Run) -> float | str:
    """RMS of the first force less that of the water's inertia, over the latter's on its parts."""
    first, step = _first_mesh(run), run.scene.numerics.time_step
    forces = FORCES.read(run.out / "run" / "forces.csv")
    time = forces["time"].to_numpy()
    time = time[time < first.interval.end - step]
    wall = first.planform["wall"].values
    moved = np.array([first.motion.nodes(t)[wall] for t in time])
    way = np.linalg.norm(moved - moved[0], axis=-1).max(axis=1) / run.scene.finger.thickness
    begins = float(time[np.argmax(way > _BEGUN)])
    some = (time > _FIRST_STEPS * step) & (time <= begins + max(_EARLY, 20 * step)) & (way < _YOUNG)
    since = np.maximum(time - time[np.argmax(way > 0.1 * _BEGUN)], 0.0)
    layer = np.sqrt(run.scene.fluid.kinematic_viscosity * since) / run.scene.finger.thickness
    some &= layer < _LAYER
    if some.sum() < 3:
        return f"{some.sum()} time steps before vortices and friction have a force"
    at = time[some][:: max(1, int(some.sum()) // 10)]
    parts = np.array([_inertia(run, first, t, step) for t in at])
    got = np.stack([np.interp(at, forces["time"], forces[n]) for n in ("fx", "fy")], axis=1)
    scale = np.linalg.norm(parts, axis=-1).sum(axis=1)
    return float(np.sqrt(((got - parts.sum(axis=1)) ** 2).sum() / (scale**2).sum()))


def _first_mesh(run: Run) -> IntervalMesh:
    """The first mesh of a run with its motion."""
    folder = run.scene.motion_folder
    law = read_kinematics(folder / "kinematics.h5").law
    interval = read_intervals(folder)[0]
    planform = read_planform(folder, interval.mesh)
    motion = NodeMotion.of(law, planform)
    return IntervalMesh(interval, planform, read_sweep(run.out, interval.name), motion)


def _inertia(run: Run, mesh: IntervalMesh, time: float, step: float) -> np.ndarray:
    """Forces (part, 2) N of the water that an accelerated finger moves, by potential flow."""
    scene, file = run.scene, mesh.planform
    walls = np.zeros((1, *file["points"].shape[1:]))
    wall = file["wall"].values
    nodes = [mesh.motion.nodes(time - k * step)[wall] for k in range(EARLIER + 1)]
    walls[0, wall] = felt(np.array(nodes).reshape(EARLIER + 1, -1), step).reshape(-1, 2)
    size = np.abs(walls).max() or 1.0  # of a start from rest squares leave single precision
    gaps = sides(file) == OUTER_PATCHES.index("gap")
    _, force = forces_of_water(
        file,
        mesh.sweep,
        mesh.motion.nodes(time),
        walls / size,
        gaps,
        scene.fluid.density,
        PER_FINGER[scene.model.kind],
        _ACCURATE,
    )
    return np.asarray(size * force[0])
