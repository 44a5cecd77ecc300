"""Cylinders: oscillating in still water, started impulsively, accelerated from rest."""

import numpy as np

from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.solve import forces, law_and_body, provenance, reference
from pipeline.kinematics.rigid_body import travelled
from pipeline.scene.scene import Scene

FIGURE_POINTS = 400
NAMES = (("phase", "phase"), ("force", "value"))  # of the reference in curves and in its file


def cycle_of(
    time: np.ndarray, force: np.ndarray, period: float, phase: np.ndarray, cycle: int = -1
) -> np.ndarray:
    """Force at `phase` (0…1) of one whole cycle; −1 is the last."""
    cycles = int(np.floor(time[-1] / period + 1e-6))
    begin = period * (cycle if cycle >= 0 else cycles + cycle)
    return np.interp(begin + phase * period, time, force)


def morison(
    velocity: np.ndarray,
    acceleration: np.ndarray,
    force: np.ndarray,
    density: float,
    diameter: float,
) -> tuple[float, float]:
    """Drag and added-mass coefficient of a moving body, from its force per metre.

    Least squares of F = −½ρD C_D |u|u − ¼πρD² C_A u̇.
    """
    drag_term = -0.5 * density * diameter * np.abs(velocity) * velocity
    mass_term = -0.25 * np.pi * density * diameter**2 * acceleration
    drag, mass = np.linalg.lstsq(np.column_stack([drag_term, mass_term]), force, rcond=None)[0]
    return float(drag), float(mass)


def oscillating(scene: Scene) -> Result:
    """In-line force over the last cycle, and Morison's coefficients: Dütsch et al. (1998).

    x = −A sin(2πt/T), Re = UD/ν = 100, KC = UT/D = 5.
    """
    ref, (law, body) = reference(scene.name), law_and_body(scene)
    history = forces(scene)
    omega = 2 * np.pi / law.period
    top = abs(law.amplitude) * omega
    scale = scene.fluid.density * top**2 * body.diameter
    phase = np.linspace(0, 1, FIGURE_POINTS + 1)

    def cycle_in(force: np.ndarray, number: int = -1) -> np.ndarray:
        return cycle_of(history.time, force, law.period, phase, number) / scale

    cycle, before = cycle_in(history.fx), cycle_in(history.fx, -2)
    wanted = np.array(ref["force"]["value"])
    at = np.interp(ref["force"]["phase"], phase, cycle)
    turn = 2 * np.pi * phase[:-1]
    u, a = law.amplitude * omega * np.cos(turn), -law.amplitude * omega**2 * np.sin(turn)
    drag, mass = morison(u, a, cycle[:-1] * scale, scene.fluid.density, body.diameter)
    fit = -0.5 * drag * np.abs(u) * u - 0.25 * np.pi * body.diameter * mass * a
    peaks = float(np.abs(cycle).max()), float(np.abs(wanted).max())
    rms, change = (float(np.sqrt(np.mean(d**2))) for d in (at - wanted, cycle - before))
    source, table = ref["force"]["source"], ref["morison"]["source"]
    digitised = "digitised points break antisymmetry by"
    checks = (
        Check("oscillating.peak", "peak in-line force / (ρU²D)", peaks[0], 0.02, "relative",
              f"half of what the {digitised}, 0.06 or 4 % of the peak", peaks[1], source),
        Check("oscillating.rms", "rms difference of the force over the cycle / (ρU²D)", rms, 0.08,
              "at most", "the digitised points themselves break antisymmetry by up to 0.06;"
              " the rest, 0.05, is 3 % of the peak", None, source),
        Check("oscillating.drag", "Morison drag coefficient C_D", drag, 0.05, "relative",
              "reference known to two decimals and quoted as 2.09 or 2.10; fits over a cycle"
              " differ by a few per cent", ref["morison"]["drag"], table),
        Check("oscillating.mass", "Morison added-mass coefficient C_A", mass, 0.05, "relative",
              "as for C_D", ref["morison"]["added_mass"], table),
        Check("oscillating.periodic", "difference of the last two cycles, rms / (ρU²D)", change,
              0.01, "at most", "else the start is not over"),
    )  # fmt: skip
    viscous = cycle_in(history.fx_viscous)
    shown = {"phase": phase, "force": cycle, "viscous": viscous, "fit": fit / top**2}
    curves = {name: values.tolist() for name, values in shown.items()}
    curves |= {f"reference_{name}": ref["force"][key] for name, key in NAMES}
    return Result(scene.name, scene.title, checks, curves, provenance=provenance(scene))


def impulsive(scene: Scene) -> Result:
    """Drag coefficient over time against Koumoutsakos & Leonard (1995).

    Time counts from the middle of the smooth start, so that the way is that of a sudden one.
    """
    ref, (law, body) = reference(scene.name)["drag"], law_and_body(scene)
    history = forces(scene)
    radius = 0.5 * body.diameter
    scaled = law.rate * (history.time - (law.start + 0.5 * law.smoothing)) / radius
    unit = 0.5 * scene.fluid.density * law.rate**2 * body.diameter
    drag, friction = -history.fx / unit, -history.fx_viscous / unit
    use = "a use: a third of the 10 % that the mesh may change the finger's force by"
    checks = tuple(
        Check(f"impulsive.{time:g}", f"C_D at T = Ut/R = {time:g}",
              float(np.interp(time, scaled, drag)), 0.03, "relative", use, value, ref["source"])
        for time, value in zip(ref["time"], ref["value"], strict=True)
    )  # fmt: skip
    later = scaled > 0.5 * law.rate * law.smoothing / radius
    step = max(1, later.sum() // FIGURE_POINTS)
    shown = {"time": scaled, "drag": drag, "friction": friction}
    curves = {name: values[later][::step].tolist() for name, values in shown.items()}
    curves |= {"reference_time": ref["time"], "reference_drag": ref["value"]}
    return Result(scene.name, scene.title, checks, curves, provenance=provenance(scene))


def accelerating(scene: Scene) -> Result:
    """Force from rest: added mass ρπR², less the thin layer at the wall (Stokes and Basset).

    That of the layer is 4ρR√(πν) ∫ U̇/√(t−τ) dτ.
    """
    law, body = law_and_body(scene)
    density, viscosity = scene.fluid.density, scene.fluid.kinematic_viscosity
    radius = 0.5 * body.diameter
    history = forces(scene)
    path = travelled(law, scene.motion.end_time)
    acceleration = np.gradient(path.rate, path.time, edge_order=2)
    now = np.interp(history.time, path.time, acceleration)
    layer = np.array([history_integral(path.time, acceleration, t) for t in history.time])
    layer *= 4 * density * radius * np.sqrt(np.pi * viscosity)
    angle = np.radians(law.direction_deg)
    along = -(history.fx * np.cos(angle) + history.fy * np.sin(angle))
    steady = history.time >= law.start + 1.2 * law.smoothing
    early = ~steady & (now > 0.5 * now.max())
    coefficient = (along - layer) / (density * np.pi * radius**2 * now.clip(1e-9))
    constant = coefficient[steady]
    worst = constant[np.argmax(np.abs(constant - 1))]
    theory = "potential flow: ρπR² (Lamb, Hydrodynamics, §68)"
    use = "a use: a fifth of the 10 % that the mesh may change the finger's force by, most of which"
    rows = (
        ("mass", "added-mass coefficient, mean while a is constant", constant.mean(),
         f"{use} is added mass"),
        ("worst", "the same, farthest from 1", worst, "the same bound at every time step"),
        ("rise", "the same while a rises, mean over its upper half", coefficient[early].mean(),
         "a changing acceleration tests the time scheme"),
    )  # fmt: skip
    checks = tuple(
        Check(f"accelerating.{name}", what, float(value), 0.02, "relative", why, 1.0, theory)
        for name, what, value, why in rows
    )
    mass_force = density * np.pi * radius**2 * now
    shown = {"time": history.time, "force": along, "layer": layer, "mass_force": mass_force}
    curves = {name: values.tolist() for name, values in shown.items()}
    return Result(scene.name, scene.title, checks, curves, provenance=provenance(scene))


def history_integral(time: np.ndarray, rate: np.ndarray, now: float) -> float:
    """∫ rate(τ)/√(now − τ) dτ from 0 to `now`; exact for a rate that is linear between samples."""
    inside = time < now - 1e-12
    if not inside.any():
        return 0.0
    t, r = np.append(time[inside], now), np.append(rate[inside], np.interp(now, time, rate))
    left, right = np.sqrt(now - t[:-1]), np.sqrt(np.maximum(now - t[1:], 0))
    slope = np.diff(r) / np.diff(t)
    # with s = now − τ: rate = r_left + slope (s_left − s)
    whole = 2 * (left - right) * (r[:-1] + slope * left**2)
    return float(np.sum(whole - slope * 2 / 3 * (left**3 - right**3)))
