"""Luhar and Nepf's blades in a current: drag and bent shape against their model."""

import numpy as np
from scipy.integrate import solve_bvp

from docs.evidence.validation.checks import Check, How, Result
from docs.evidence.validation.solve import CASES, provenance, solved
from docs.evidence.validation.turek_hron import end_of_flag, forces
from pipeline.scene.scene import Scene
from softfinger.study.rows import read_study

NAME = "luhar_nepf"
LATE = 0.5  # of the run, after which it is averaged
PLATE = 1.95  # drag coefficient of a long flat plate, which their model takes
GRAVITY = 9.81  # m/s²
SOURCE = "model of Luhar & Nepf 2011, doi 10.4319/lo.2011.56.6.2003, drag coefficient "


def blade(cauchy: float, buoyancy: float) -> np.ndarray:
    """Effective length, and place of the tip downstream and along the blade, over its length.

    Their balance of bending, weight and pressure across a blade that does not stretch.
    """
    part, state = np.linspace(0, 1, 101), np.zeros((6, 101))
    for drag in cauchy * np.linspace(0.1, 1, 10):  # each from the shape before

        def slopes(_: np.ndarray, y: np.ndarray, drag: float = drag) -> np.ndarray:
            c, s = np.cos(y[0]), np.sin(y[0])
            bend = y[3] * s - y[2] * c
            return np.array([y[1], bend, -drag * c**3, drag * c * c * s - buoyancy, s, c])

        found = solve_bvp(
            slopes, lambda a, b: np.r_[a[0], a[4], a[5], b[1], b[2], b[3]], part, state
        )
        part, state = found.x, found.y
    return np.array([state[2, 0] / cauchy, state[4, -1], state[5, -1]])


def published(scene: Scene, coefficient: float) -> np.ndarray:
    """Drag coefficient of the blade by its length, and the place of its tip, both by the model."""
    finger, fluid, structure = scene.finger, scene.fluid, scene.structure
    assert structure.bending_stiffness
    assert structure.density
    assert scene.current
    cube = finger.width * finger.length**3 / structure.bending_stiffness
    weight = (structure.density - fluid.density) * GRAVITY * finger.thickness * cube
    cauchy = 0.5 * fluid.density * coefficient * (scene.current.speed or 0.0) ** 2 * cube
    return blade(cauchy, weight) * [coefficient, 1, 1]


def mean(series: tuple[np.ndarray, np.ndarray]) -> float:
    """Of the late part of the run."""
    time, value = series
    return float(value[time > LATE * time[-1]].mean())


def measure() -> Result:
    """Of the rigid blade its drag coefficient, of each bent one drag, its share, and the tip."""
    checks, rigid = [], 0.0
    asked: tuple[float, How, str] = 0.06, "relative", "asked of the drag"
    for row in read_study(CASES / "studies" / f"{NAME}.csv"):
        scene = solved(row.run, NAME, "solve")
        assert scene.current
        speed, finger = scene.current.speed or 0.0, scene.finger
        area = 0.5 * scene.fluid.density * speed**2 * finger.length * finger.width
        drag = mean(forces(scene)["drag"]) * finger.width
        which = "half the" if scene.model.kind == "half" else "the whole"
        where = f"of {which} blade at {100 * speed:g} cm/s"
        if not scene.coupled:
            rigid, source = drag / area, "flat plate, by Luhar & Nepf 2011"
            what = f"drag coefficient {where}, kept straight"
            checks.append(Check(f"{row.run}.coefficient", what, rigid, *asked, PLATE, source))
            continue
        own, theirs = published(scene, rigid), published(scene, PLATE)
        tip = abs(mean(end_of_flag(scene)["across"]))
        checks += [
            Check(f"{row.run}.share", f"drag {where}, over that by the straight one's coefficient",
                  drag / area / rigid, *asked, own[0] / rigid, f"{SOURCE}{rigid:.3g}"),
            Check(f"{row.run}.drag", f"drag {where}", 1e3 * drag, *asked, 1e3 * theirs[0] * area,
                  f"{SOURCE}{PLATE}", "mN"),
            Check(f"{row.run}.tip", f"tip {where}, downstream", tip, 3.0, "absolute",
                  "6 % of the length", 1e3 * theirs[1] * finger.length, f"{SOURCE}{PLATE}", "mm"),
        ]  # fmt: skip
    return Result(NAME, scene.title, tuple(checks), provenance=provenance(scene))
