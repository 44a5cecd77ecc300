"""A plate that rotates in still water: the vortex of its tip, and discrete ones in the layer."""

from dataclasses import dataclass

import numpy as np
import shapely
import xarray as xr

from pipeline.kinematics.rigid_body import travelled
from pipeline.scene.scene import Scene
from piv.formats.plane_series import read_plane
from piv.vortices.find import plane_of
from piv.vortices.regions import Measures, find_regions
from piv.vortices.settings import VortexSettings
from piv.vortices.tracking import Tracker
from piv.vortices.vortex import Vortex
from softfinger.study.rows import read_study
from tests.studies.validation.checks import Check, Result
from tests.studies.validation.figures import ROTATED, rotating_flow
from tests.studies.validation.ledger import FOLDER
from tests.studies.validation.solve import CASES, law_and_body, provenance, reference, solved

STUDY = "plate_rotating"
# Of the length L from the axis to the tip:
LAYER, WHOLE = 1 / 80, 1 / 10  # smoothing at which secondary vortices and the primary one are found
VIEW = 1.2  # half of the square around the tip that is looked at
NEAR = 0.5  # from the tip at most, where a secondary vortex is released
AWAY = 0.1  # that it moves away at least: the root of the layer stays
STEP = 0.2  # most that the primary vortex moves between two pictures
OFF_PLATE = 3 * LAYER
LEAST = 0.005  # least circulation of a secondary vortex over Ω L²
LASTS = 5  # pictures, 20 ms or 8° of turn: what passes sooner is no vortex
FROM, TO = 15.0, 84.0  # turn in degrees over which they are counted
COMPARED = ROTATED  # up to this turn the primary vortex lies in the small cells of all grids
SPIRAL = 15.0, COMPARED  # turn over which its path is compared with Kaden's spiral
PICTURES = 25.0, 50.0, 75.0  # turn
PICTURE = FOLDER / "plate_rotating_flow.png"


@dataclass(frozen=True)
class Layer:
    """A run: its Reynolds number and cells over L; of each picture the turn, in degrees.

    The primary vortex's circulation over Ω L² and place over L, outwards from the tip and behind
    it; turns at which secondary vortices are released, and their median distance over L.
    """

    run: str
    level: str
    reynolds: float
    cells: float
    turn: list[float]
    circulation: list[float]
    place: list[tuple[float, float]]
    released: list[float]
    spacing: float


def _clockwise(plane: xr.Dataset, scale: float, least: float) -> list[Measures]:
    """Clockwise vortices of a plane at a smoothing length, strongest first."""
    settings = VortexSettings(min_circulation=least)
    found = find_regions(plane_of(plane, settings), scale, settings)
    return [region.measures for region in found if region.measures.circulation < 0]


def _around(plane: xr.Dataset, tip: np.ndarray, length: float) -> xr.Dataset:
    """The square around the tip."""
    x, y = (slice(q - VIEW * length, q + VIEW * length) for q in tip)
    return plane.sel(x=x, y=y).load()


def layer_of(run: str, scene: Scene) -> Layer:
    """Vortices behind the tip on the sheet of a run."""
    law, body = law_and_body(scene)
    length, speed, centre = 0.5 * body.size, np.radians(law.rate), np.array(body.centre)
    unit, path = speed * length**2, travelled(law, scene.motion.end_time)
    tracker = Tracker()
    seen: dict[int, list[tuple[float, float]]] = {}
    turns, circulation, place, apart = [], [], [], []
    last = None
    with read_plane(scene.out / "sheet.h5") as sheet:
        for time in sheet["time"].values:
            turn = float(np.interp(time, path.time, path.distance))
            if not FROM <= turn <= TO:
                continue
            out = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
            tip = centre + length * out
            plane = _around(sheet.sel(time=time), tip, length)
            whole = _clockwise(plane, WHOLE * length, 10 * LEAST * unit)
            at = np.array([(m.x, m.y) for m in whole]).reshape(-1, 2)
            away = np.hypot(*(at - (tip if last is None else last)).T)
            near = np.flatnonzero(away < (NEAR if last is None else STEP) * length)
            if not len(near):
                continue
            primary = whole[near[0] if last is None else near[np.argmin(away[near])]]
            last = np.array([primary.x, primary.y])
            turns.append(turn)
            circulation.append(-primary.circulation / unit)
            place.append(_in_tip_frame(last - tip, out, length))
            small = _clockwise(plane, LAYER * length, LEAST * unit)
            wall = shapely.LinearRing(plane["outline"].values.reshape(-1, 2))
            small = [m for m in small if _free(m, wall, primary, length)]
            numbers = tracker.update(float(time), [_vortex(m) for m in small])
            for m, number in zip(small, numbers, strict=True):
                from_tip = float(np.hypot(m.x - tip[0], m.y - tip[1]) / length)
                seen.setdefault(number, []).append((turn, from_tip))
            points = np.array([(m.x, m.y) for m in small]).reshape(-1, 2)
            if len(points) > 1:
                gaps = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
                apart += np.sort(gaps, axis=1)[:, 1].tolist()
    released = [
        track[0][0]
        for track in seen.values()
        if len(track) >= LASTS and track[0][1] < NEAR and track[-1][1] > track[0][1] + AWAY
    ]
    return Layer(
        run, scene.level, unit / scene.fluid.kinematic_viscosity, length / scene.mesh.near_cell,
        turns, circulation, place, sorted(released),
        float(np.median(apart)) / length if apart else 0.0,
    )  # fmt: skip


def _in_tip_frame(away: np.ndarray, out: np.ndarray, length: float) -> tuple[float, float]:
    """Outwards and behind, over L; the plate turns counter-clockwise."""
    return float(away @ out / length), float((away[0] * out[1] - away[1] * out[0]) / length)


def _free(m: Measures, wall: shapely.LinearRing, primary: Measures, length: float) -> bool:
    """Whether a small vortex lies in the layer: off the plate, and beyond the primary's core."""
    within = np.hypot(m.x - primary.x, m.y - primary.y) < 0.5 * primary.radius
    return not within and wall.distance(shapely.Point(m.x, m.y)) > OFF_PLATE * length


def _vortex(m: Measures) -> Vortex:
    """For the tracker, which needs place, size and circulation."""
    whole = m.x, m.y, m.circulation, np.nan, m.radius, m.peak_vorticity, m.circulation, np.nan
    return Vortex(*whole, *(0.0,) * 9, *(np.nan,) * 9)


def _runs() -> list[tuple[Layer, Scene]]:
    """The study's runs, lowest Re and coarsest cells first; StageError where one is stale."""
    names = [row.run for row in read_study(CASES / "studies" / f"{STUDY}.csv")]
    scenes = {name: solved(name, STUDY) for name in names}
    runs = [(layer_of(name, scene), scene) for name, scene in scenes.items()]
    return sorted(runs, key=lambda run: (run[0].reynolds, run[0].cells))


def _at(layer: Layer, turn: float) -> float:
    """The primary vortex's circulation over Ω L² at a turn in degrees."""
    return float(np.interp(turn, layer.turn, layer.circulation))


def _exponent(layer: Layer) -> float:
    """Power of the tip's way with which the primary vortex's distance from it grows."""
    way, away = np.array(layer.turn), np.hypot(*np.array(layer.place).T)
    use = (way > SPIRAL[0]) & (way < SPIRAL[1])
    return float(np.polyfit(np.log(way[use]), np.log(away[use]), 1)[0])


def measure() -> Result:
    """Checks of the layer's reported states, and of the grid."""
    runs = _runs()
    by_re: dict[int, list[Layer]] = {}
    shown: dict[float, Scene] = {}
    for layer, scene in runs:
        by_re.setdefault(round(layer.reynolds), []).append(layer)
        shown[layer.reynolds] = scene  # at last the finest
    ref = reference(STUDY)
    low, middle, high = by_re.values()
    told, spiral = ref["layer"]["source"], ref["spiral"]
    many = "secondary vortices released"
    checks = [
        Check("rotating.continuous", f"{many}, {_words(low[-1])}", len(low[-1].released), 0.0,
              "at most", "one continuous layer is reported; it says something only once higher Re"
              " show vortices", None, told),
        Check("rotating.unstable", f"{many}, {_words(middle[-1])}", len(middle[-1].released), 1.0,
              "at least", "secondary vortices are reported to emerge", None, told),
        Check("rotating.discrete", f"{many}, {_words(high[-1])}", len(high[-1].released), 3.0,
              "at least", "a series of discrete vortices is reported", None, told),
    ]  # fmt: skip
    for name, layers in (("840", low), ("1955", middle), ("11150", high)):
        coarser, finest = layers[-2:]
        words = f"at Re {name}, {coarser.level} against {finest.level}"
        checks.append(
            Check(f"rotating.circulation_{name}",
                  f"primary vortex's circulation / ΩL² at {COMPARED:g}° of turn {words}",
                  _at(coarser, COMPARED), 0.04, "relative", "as wanted of the finger at medium",
                  _at(finest, COMPARED), f"grid {finest.level}")
        )  # fmt: skip
    checks.append(
        Check("rotating.spiral", "exponent of the primary vortex's distance from the tip over the"
              f" tip's way, {SPIRAL[0]:g} to {SPIRAL[1]:g}° of turn, Re 11150", _exponent(high[-1]),
              0.1, "absolute", "the speed rises over the first 12° of the way, the plate is not"
              " half-infinite, and the source itself modifies the spiral", spiral["exponent"],
              spiral["source"])
    )  # fmt: skip
    curves = {layer.run: vars(layer) for layers in by_re.values() for layer in layers}
    remarks = tuple(_remark(layer) for layer, _ in runs)
    text = (
        "A plate turns about its middle at constant speed after 12° of smooth start, in two"
        " dimensions. Lower Re take a higher viscosity. A secondary vortex is a clockwise region"
        f" of the flow smoothed over L/{1 / LAYER:.0f}, off the plate and outside the primary"
        f" vortex's core, with at least {LEAST:.1%} of ΩL², that lasts {LASTS} pictures (8°)"
        f" and is first seen within {NEAR:g} L of the tip, from {FROM:g} to {TO:g}° of turn."
    )
    pictures = {reynolds: _pictures(scene) for reynolds, scene in shown.items()}
    rotating_flow(pictures, PICTURES, PICTURE)
    return Result(STUDY, runs[-1][1].title, text, tuple(checks), curves, remarks,
                  provenance(runs[-1][1]))  # fmt: skip


def _words(layer: Layer) -> str:
    return f"Re {layer.reynolds:.0f}, {layer.cells:.0f} cells over L, to {layer.turn[-1]:.0f}°"


def _remark(layer: Layer) -> str:
    """Frequency and spacing of a run's secondary vortices."""
    count = len(layer.released)
    words = (
        f"{layer.run}, {_words(layer)}: {count} secondary vortices; primary"
        f" Γ / ΩL² = {_at(layer, COMPARED):.3f} at {COMPARED:g}°"
    )
    if count < 2:
        return f"{words}."
    interval = float(np.median(np.diff(layer.released)))
    return (
        f"{words}; one each {interval:.0f}° of turn (f / Ω = {57.3 / interval:.2g}),"
        f" {layer.spacing:.2f} L apart."
    )


def _pictures(scene: Scene) -> list[xr.Dataset]:
    """The sheet around the tip at PICTURES, in lengths from the axis and turns of the plate."""
    law, body = law_and_body(scene)
    path, length = travelled(law, scene.motion.end_time), 0.5 * body.size
    speed, centre = np.radians(law.rate), body.centre
    pictures = []
    with read_plane(scene.out / "sheet.h5") as sheet:
        for turn in PICTURES:
            time = float(np.interp(turn, path.distance, path.time))
            plane = sheet.sel(time=time, method="nearest").load()
            plane["outline"] = (plane["outline"] - np.array(centre)) / length
            x, y = (plane["x"] - centre[0]) / length, (plane["y"] - centre[1]) / length
            unit, plane = speed * length, plane.assign_coords(x=x, y=y)
            pictures.append(plane.assign(u=plane["u"] / unit, v=plane["v"] / unit))
    return pictures
