"""Free oscillation of a clamped elastic plate in still water: wet over dry frequency, damping."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import curve_fit

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import provenance, solved
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.scene.scene import Scene
from pipeline.scene.sections import Finger
from pipeline.structure.finger import ElasticFinger

NAME = "cantilever_plate"
ROWS = ("cantilever_wide_large", "cantilever_wide_small", "cantilever_slender_large",
        "cantilever_slender_small")  # fmt: skip
FIRST = 1.875104068711961  # root of the first mode
RELEASED = 0.1  # s, until when the shape without load moves
_SMALL = 0.1  # of the width: amplitudes that shed little
PANELS = 40, 24  # along and across the plate
# Brumley, Willcox and Sader (2010): hydrodynamic function over thickness / width without viscosity,
# and its real and imaginary part at ω b² / 4 ν = 1000; what viscosity adds then falls as 1 / √
THICKNESS = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.5])
INVISCID = np.array([1.0, 1.04551, 1.08816, 1.14064, 1.21703, 1.36368])
REAL = np.array([1.11746, 1.1465, 1.1843, 1.2346, 1.3117, 1.4670])
LOST = np.array([0.100688, 0.095021, 0.092307, 0.091476, 0.093044, 0.10247])
SOURCE = (
    "potential flow of the thin plate (doublet panels); thickness and viscosity: Brumley, Willcox &"
    " Sader 2010, Phys. Fluids 22:052001"
)
# A test of Lindholm, Kana, Chu and Abramson (J. Ship Res. 9, 1965): first mode of a square plate,
# rad/s dry and wet, as quoted by Monterrubio and Krysl (J. Vib. Acoust. 141:021008, 2019)
TEST = 12.30, 6.56
STEEL = 7.85, 0.0238  # density over that of water, thickness over length and width


def first_mode(part: np.ndarray) -> np.ndarray:
    """Deflection over that of the tip, at parts of the length from the clamp."""
    k = FIRST
    ratio = (np.sinh(k) - np.sin(k)) / (np.cosh(k) + np.cos(k))
    bent = np.cosh(k * part) - np.cos(k * part)
    return 0.5 * (bent - ratio * (np.sinh(k * part) - np.sin(k * part)))


def added_mass(aspect: float, shape: Callable[[np.ndarray], np.ndarray]) -> float:
    """Of a thin plate moving broadside as `shape` along it, over that of its strips, π ρ b² / 4.

    `aspect`: length over width. Panels of constant doublet strength, collocated in their middles.
    """
    along, across = (np.linspace(0, np.pi, n + 1) for n in PANELS)

    def places(angle, size):
        return 0.5 * size * (1 - np.cos(angle))

    def grid(x, y):
        return [part.ravel() for part in np.meshgrid(x, y, indexing="ij")]

    ends = places(along, aspect), places(across, 1.0)
    half = (
        places(0.5 * (along[1:] + along[:-1]), aspect),
        places(0.5 * (across[1:] + across[:-1]), 1.0),
    )
    x, y = grid(*half)
    through = np.zeros((len(x), len(x)))
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        corner = grid(*(end[k : len(end) - 1 + k] for end, k in zip(ends, (i, j), strict=True)))
        dx, dy = (a[:, None] - b for a, b in zip((x, y), corner, strict=True))
        through += (-1) ** (i + j) * np.hypot(dx, dy) / (dx * dy)
    velocity = shape(x / aspect)
    strength = np.linalg.solve(through / (4 * np.pi), velocity)
    area = np.outer(*map(np.diff, ends)).ravel()
    fine = (np.arange(2000) + 0.5) / 2000
    kinetic = abs(float(np.sum(strength * velocity * area)))
    return kinetic / (float(np.mean(shape(fine) ** 2)) * aspect) / (np.pi / 4)


def theory(finger: Finger, dry: float, viscosity: float) -> tuple[float, float]:
    """Wet over dry frequency, and share of the critical damping, of a plate as dense as water.

    `dry`: frequency without water, Hz.
    """
    width = finger.width
    ratio = finger.thickness / width
    free, real, lost = (np.interp(ratio, THICKNESS, table) for table in (INVISCID, REAL, LOST))
    mass, potential = ratio / (np.pi / 4), added_mass(finger.length / width, first_mode) * free
    wet = 1.0
    for _ in range(20):
        fade = (1000 / (np.pi / 2 * wet * dry * width**2 / viscosity)) ** 0.5
        total = mass + potential + fade * (real - free)
        wet = (mass / total) ** 0.5
    return float(wet), float(0.5 * fade * lost / total)


def square_steel_plate() -> float:
    """Wet over dry frequency of the plate of TEST, by the same theory without viscosity."""
    mass = STEEL[0] * STEEL[1] / (np.pi / 4)
    added = added_mass(1.0, first_mode) * np.interp(STEEL[1], THICKNESS, INVISCID)
    return float((mass / (mass + added)) ** 0.5)


def dry_frequency(scene: Scene) -> float:
    """Of the first mode without water, Hz."""
    finger, fluid = scene.finger, scene.fluid
    mass = fluid.density * finger.width * finger.thickness
    stiffness = scene.structure.bending_stiffness
    assert stiffness is not None
    return float(FIRST**2 / (2 * np.pi) * (stiffness / mass) ** 0.5 / finger.length**2)


def oscillation(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Time (s), deflection of the tip (m), parameters of its fit, and the rest (m)."""
    finger, file = ElasticFinger.of(scene), read_elastic_motion(scene.out / FILE)
    time, pressure, delta = (file[name].values for name in ("time", "pressure", "delta"))
    bent, unloaded = (
        finger.chain.profile(pressure, turn)[:, -1] @ finger.frame[:, 0]
        for turn in (delta, 0 * delta)
    )
    across, rest = bent - bent[0], float(unloaded[-1] - unloaded[0])
    free = time > RELEASED

    def swing(t, middle, swung, frequency, share, phase):
        turn = 2 * np.pi * frequency * (t - RELEASED)
        return middle + swung * np.exp(-share * turn) * np.cos(turn + phase)

    crossed = np.flatnonzero(np.diff(np.sign(across[free] - rest)))
    guess = 0.5 / float(np.diff(time[free][crossed]).mean())
    start = [rest, -rest, guess, 0.05, 0.5]
    fit, _ = curve_fit(swing, time[free], across[free], start, maxfev=20000)
    return time, across, fit, rest


def measure() -> Result:
    """Frequencies and damping of two plates at two amplitudes."""
    checks, curves = [], {}
    for row in ROWS:
        scene = solved(row, stage="solve")
        finger, dry = scene.finger, dry_frequency(scene)
        wet, share = theory(finger, dry, scene.fluid.kinematic_viscosity)
        time, across, fit, rest = oscillation(scene)
        about = f"L/b = {finger.length / finger.width:g}, amplitude {rest / finger.width:.2f} b"
        checks.append(
            Check(f"{row}.frequency", f"wet over dry frequency, {about}", float(fit[2]) / dry, 0.03,
                  "relative", "6 % of the mass of plate and water", wet, SOURCE)
        )  # fmt: skip
        damping = f"{row}.damping", f"damping over the critical, {about}", float(fit[3])
        if rest < _SMALL * finger.width:
            why = "a third of it changes the amplitude by 6 % a cycle"
            checks.append(Check(*damping, 0.3, "relative", why, share, SOURCE))
        else:
            why = f"theory of small amplitudes, {share:.3g}: vortices at the edges add to it"
            checks.append(Check(*damping, share, "at least", why))
        curves[row] = {"time": time.tolist(), "deflection": (across / rest).tolist()}
    why = "asked of the theory; computations that others published are 0.564 to 0.574"
    checks.append(
        Check("cantilever_square.test", "wet over dry frequency, L/b = 1, theory against a test",
              square_steel_plate(), 0.05, "relative", why, TEST[1] / TEST[0],
              "Lindholm et al. 1965, as quoted by Monterrubio & Krysl 2019")
    )  # fmt: skip
    return Result(NAME, scene.title, tuple(checks), curves, provenance=provenance(scene))
