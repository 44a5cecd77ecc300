"""Circulation and centre of the tip vortex at the instants that tell most, and their uncertainty.

While the vortex is smaller than an interrogation window, PIV takes a large share off it. The
virtual experiment shows that share, and the comparison begins where it costs least.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.inputs_toml import Input, Numerics
from postprocess.lab.data.pose import Pose
from postprocess.lab.judgement.case import Case, Effect
from postprocess.lab.judgement.measures import COLUMNS, measure, scatter
from postprocess.lab.judgement.motion import motion_of_run
from postprocess.lab.judgement.validation import Source, ValidatedQuantity

VORTEX = {  # quantity: columns, unit, label
    "circulation": (("circulation",), "m²/s", "circulation of the tip vortex"),
    "centre": (("x", "y"), "m", "centre of the tip vortex"),
}
FEWEST = 3  # instants
# what PIV changes of a flow is known from the simulation's; of one that differs by up to a third,
# it may differ by as much
UNLIKE = 1 / 3
POSTERIOR = "posterior of the registration"


def tables(case: Case) -> dict[str, pd.DataFrame]:
    """`measure` of every side."""
    sides = {"data": case.data, "virtual": case.virtual, "direct": case.direct}
    return {name: measure(case, p, name) for name, p in sides.items() if p is not None}


def effect_of(
    one: Input | Numerics, plane: xr.Dataset, run: Kinematics, case: Case, nominal: pd.DataFrame
) -> Effect:
    """The effect of a run with `plane`; `nominal`: the `measure` of `case.direct`."""
    table = (measure(case, plane, one.name) - nominal)[list(COLUMNS)]
    if isinstance(one, Input):
        kind, per_std, how = "input", one.std / abs(one.step), f"run with {one.key} {one.step:+g}"
    else:
        kind, per_std = "numerical", one.per_difference
        how = f"grid-convergence index of the run finer by {one.ratio:g}"
    return Effect(one.name, kind, how, float(per_std), table, *motion_of_run(case.kinematics, run))


def compared_instants(
    case: Case, measured: dict[str, pd.DataFrame]
) -> tuple[np.ndarray, dict[str, dict[str, float]]]:
    """Instants (instant,) bool that tell most of the circulation, and each side's scatter.

    All from one instant on at which every side and run has its vortex. That instant makes the
    predicted uncertainty of the mean least: the size of what PIV changes of it, the
    vectors' scatter, and the effect of the numerics. Without a virtual experiment, the later half.
    ValueError where there are fewer than three.
    """
    every = [*measured.values(), *(e.table for e in case.effects)]
    ok = np.logical_and.reduce([np.isfinite(t["circulation"].to_numpy()) for t in every])
    at = np.flatnonzero(ok)
    if at.size < FEWEST:
        raise ValueError(
            f"the tip vortex exists on all sides at only {at.size} instants; three are needed:"
            " take pictures of the whole stroke, or of more particles"
        )
    sides = {"data": case.data} | ({} if case.virtual is None else {"virtual": case.virtual})
    own = {name: scatter(plane, measured[name], at) for name, plane in sides.items()}
    begin = at.size // 2 if at.size >= 2 * FEWEST else 0
    if case.virtual is not None:
        times = case.direct["time"].values
        seen, true = (measured[name]["circulation"].to_numpy() for name in ("virtual", "direct"))
        random = np.hypot(own["data"]["circulation"], own["virtual"]["circulation"])

        def predicted(first: int) -> float:
            rows = at[first:]
            swirl = _swirl(measured["data"], rows)
            alike = independent_instants(times[rows], swirl, case.window_m)
            parts = [UNLIKE * np.mean(np.abs(seen[rows] - true[rows])), random / np.sqrt(alike)]
            parts += [e.std(("circulation",), rows)[0] for e in case.finer]
            return float(np.linalg.norm(parts))

        begin = min(range(at.size - FEWEST + 1), key=predicted)
    chosen = np.zeros(ok.size, bool)
    chosen[at[begin:]] = True
    return chosen, own


def independent_instants(times: np.ndarray, speed: float, window_m: float) -> float:
    """How many of the instants (s) count as independent in a mean.

    Errors at two instants correlate by the share of a window (m) that particles at `speed` (m/s)
    have not yet crossed.
    """
    apart = np.abs(times[:, None] - times[None, :])
    return float(times.size**2 / np.sum(np.clip(1 - speed * apart / window_m, 0.0, 1.0)))


def _swirl(data: pd.DataFrame, rows: np.ndarray) -> float:
    """Mean speed (m/s) around the tip vortex at its radius."""
    return float((data["circulation"].abs() / (2 * np.pi * data["radius"]))[rows].mean())


def flow_quantities(
    case: Case,
    measured: dict[str, pd.DataFrame],
    rows: np.ndarray,
    own: dict[str, dict[str, float]],
) -> list[ValidatedQuantity]:
    """Circulation and centre with all their sources, as means over the instants `rows`."""
    simulated = "virtual" if "virtual" in measured else "direct"
    times, swirl = case.direct["time"].values, _swirl(measured["data"], rows)
    out = []
    for name, (columns, unit, label) in VORTEX.items():
        names = list(columns)
        ours, direct, theirs = (
            measured[side].loc[rows, names].mean().to_numpy(float)
            for side in (simulated, "direct", "data")
        )
        error = (measured[simulated] - measured["data"]).loc[rows, names].to_numpy(float)
        each = {side: np.array([s[c] for c in columns]) for side, s in own.items()}
        random, instant = _random_sources(case, times[rows], swirl, error, each)
        rate = np.gradient(measured["direct"].loc[rows, names].to_numpy(float), times[rows], axis=0)
        sources = [
            *run_sources(case, columns, rows),
            *motion_sources(case, columns, rows),
            *random,
            *_registration_sources(case, name, theirs, rate.mean(axis=0)),
        ]
        if simulated == "virtual":
            how = "a third of what PIV changes of the simulation: the other flow may be unlike"
            sources.append(Source("PIV", "data", UNLIKE * np.abs(ours - direct), how))
        added = sum((e.moves(columns, rows) for e in case.finer), np.zeros(len(columns)))
        fixed = [s for s in sources if s not in random]
        quantity = ValidatedQuantity(
            name,
            label,
            unit,
            ours + added,
            direct + added,
            theirs,
            case.kinematics.tip_width if name == "centre" else float(abs(theirs[0])),
            sources,
            explained_by_motion(case, columns, rows),
            added if case.finer else None,
            _at_instant(fixed, instant),
        )
        out.append(quantity)
    return out


def _random_sources(
    case: Case, times: np.ndarray, swirl: float, error: np.ndarray, own: dict[str, np.ndarray]
) -> tuple[list[Source], dict[str, np.ndarray]]:
    """Random sources of a mean over instants (s), and each side's scatter at one instant.

    `swirl` (m/s) carries particles through a window; `error` (instant, component); `own`: scatter
    of one instant by the vectors' uncertainty, (component,) by side.
    """
    alike = independent_instants(times, swirl, case.window_m)
    sources = []
    for side, std in own.items():
        count = float(times.size) if side == "virtual" and case.fresh_pairs else alike
        whose = " of the virtual experiment" if side == "virtual" else ""
        how = f"Monte Carlo over the vectors' uncertainty{whose}; {count:.1f} of {times.size}"
        how += " instants count as independent"
        std_of_mean = std / np.sqrt(count)
        sources.append(Source("vectors" if side == "data" else "virtual vectors", "data",
                              std_of_mean, how))  # fmt: skip
    excess = excess_scatter(times, error, np.sum([std**2 for std in own.values()], axis=0))
    how = "scatter of E from instant to instant beyond the vectors' uncertainty"
    sources.append(Source("scatter", "data", excess / np.sqrt(alike), how))
    simulation = own.get("virtual", np.zeros_like(excess))
    return sources, {"data": np.hypot(own["data"], excess), "simulation": simulation}


def excess_scatter(times: np.ndarray, error: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Standard deviation of E (instant, component) about a straight line beyond a `variance`.

    It holds outliers beside the body and other errors that no vector's uncertainty knows.
    """
    basis = np.column_stack([np.ones_like(times), times - times.mean()])
    if times.size <= basis.shape[1]:
        return np.zeros(error.shape[1])
    rest = error - basis @ np.linalg.lstsq(basis, error, rcond=None)[0]
    seen = np.sum(rest**2, axis=0) / (times.size - basis.shape[1])
    return np.sqrt(np.maximum(seen - variance, 0.0))


def _at_instant(fixed: list[Source], scatter: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Standard uncertainty of each side at one instant: `scatter`, and the `fixed` sources."""
    other = {side: np.zeros_like(std) for side, std in scatter.items()}
    for source in fixed:
        other["data" if source.kind == "data" else "simulation"] += source.std**2
    return {side: np.sqrt(std**2 + other[side]) for side, std in scatter.items()}


def _registration_sources(
    case: Case, name: str, value: np.ndarray, rate: np.ndarray
) -> list[Source]:
    """Effect of the uncertainty of pose and time on a quantity of the data."""
    registration = case.registration
    time = Source(
        "time", "data", np.abs(rate) * registration.law.std("delay"), "fit of the finger's motion"
    )
    if name == "circulation":  # goes with the square of the scale
        std = np.abs(value) * 2.0 * np.sqrt(registration.covariance[3, 3])
        return [time, Source("scale", "data", std, POSTERIOR)]
    jacobian = place_jacobian(registration.pose, value)
    std = np.sqrt(np.diag(jacobian @ registration.covariance @ jacobian.T))
    return [time, Source("pose", "data", std, POSTERIOR)]


def place_jacobian(pose: Pose, place: np.ndarray) -> np.ndarray:
    """Derivatives (2, 4) of a place (m, tank frame) in a picture by the pose.

    By (x px, y px, angle, ln magnification) in x_tank = R⁻¹ (px − at) scale + anchor. The signs
    matter: errors of shift, turn and scale correlate, since root and tip are both seen.
    """
    arm = np.asarray(place) - np.asarray(pose.anchor)
    shift = -pose.rotation.T * pose.pixel
    return np.column_stack([shift, [arm[1], -arm[0]], -arm])


def run_sources(case: Case, columns: tuple[str, ...], rows: np.ndarray) -> list[Source]:
    """Uncertainty of inputs and numerics by the runs beside the nominal one.

    Inputs of the motion count only where the recording does not show it. The FEA's band of the
    bend angle counts as the pressure that bends as much, scaled from the pressure's run.
    """
    seen = [part.effect.name for part in case.motion]
    effects = (e for e in case.effects if e.name not in seen)
    sources = [Source(e.name, e.kind, e.std(columns, rows), e.how) for e in effects]
    effect = case.effect("pressure")
    if not case.geometry or effect is None or seen:
        return sources
    std = np.abs(effect.moves(columns, rows)) * (case.bend_std / abs(effect.bend))
    how = "FEA's band, scaled from the run of the pressure"
    return [*sources, Source("geometry and material", "input", std, how)]


def motion_sources(case: Case, columns: tuple[str, ...], rows: np.ndarray) -> list[Source]:
    """Uncertainty of the recording's motion and of its linear effect.

    Flow goes with 1/(1 + x) for a motion x slower: a line through the run's x₀ is off by
    x(x − x₀), the part x − x₀ of what the motion explains.
    """
    sources = []
    for part in case.motion:
        moves, name = np.abs(part.effect.moves(columns, rows)), part.effect.name
        sources.append(Source(f"{name} as recorded", "data", moves * part.std, POSTERIOR))
        std, how = moves * abs(part.share) * part.unlike, "effect of the motion taken for linear"
        sources.append(Source(f"{name}, linear", "input", std, how))
    return sources


def explained_by_motion(
    case: Case, columns: tuple[str, ...], rows: np.ndarray
) -> np.ndarray | None:
    """Part of S − D due to the difference of the motions; None where that is not known."""
    if not case.motion:
        return None
    return -np.sum([part.share * part.effect.moves(columns, rows) for part in case.motion], axis=0)
