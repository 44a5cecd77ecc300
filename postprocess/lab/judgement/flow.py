"""Circulation and centre of the tip vortex at the instants that tell most, and their uncertainty.

While the vortex is smaller than an interrogation window, PIV takes a large share off it. The
virtual experiment shows that share, and the comparison begins where it costs least.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import usable
from postprocess.lab.data.inputs_toml import Input, Numerics
from postprocess.lab.data.pose import Pose
from postprocess.lab.judgement.case import Case, Effect
from postprocess.lab.judgement.measures import COLUMNS, measure, scatter
from postprocess.lab.judgement.motion import motion_of_run
from postprocess.lab.judgement.validation import POSTERIOR, Source, ValidatedQuantity

VORTEX = {  # quantity: columns, unit, label
    "circulation": (("circulation",), "m²/s", "circulation of the tip vortex"),
    "centre": (("x", "y"), "m", "centre of the tip vortex"),
}
FEWEST, LEAST = 3, 1 / 3  # instants, and the share of all that have a vortex on all sides
# what PIV changes of a flow is known from the simulation's; of one that differs by up to a third,
# it may differ by as much
UNLIKE = 1 / 3


def tables(case: Case) -> dict[str, pd.DataFrame]:
    """`measure` of every side."""
    sides = {"data": case.data, "virtual": case.virtual, "direct": case.direct}
    there = {name: plane for name, plane in sides.items() if plane is not None}
    # without pictures the vectors of all sides, since programs mask the body differently
    seen = case.registration.times.size > 0 or np.logical_and.reduce(
        [usable(plane).values for plane in there.values()]
    )
    return {name: measure(case, plane, name, seen) for name, plane in there.items()}


def effect_of(
    one: Input | Numerics, plane: xr.Dataset, nominal: pd.DataFrame, run: Kinematics, case: Case
) -> Effect:
    """The effect of a run with `plane`; `nominal`: the nominal run's `measure` at its instants."""
    change = measure(case, plane, one.name)[list(COLUMNS)] - nominal[list(COLUMNS)]
    known, times = change["circulation"].notna(), case.direct["time"].values
    at = nominal["time"][known]
    table = pd.DataFrame(
        {
            name: np.interp(times, at, values[known], np.nan, np.nan)
            for name, values in change.items()
        }
    )
    if isinstance(one, Input):
        kind, per_std, how = "input", one.std / abs(one.step), f"run with {one.key} {one.step:+g}"
    else:
        kind, per_std = "numerical", one.per_difference
        how = f"grid-convergence index of the run finer by {one.ratio:g}"
    return Effect(one.name, kind, how, float(per_std), table, *motion_of_run(case.kinematics, run))


def known_instants(case: Case, measured: dict[str, pd.DataFrame]) -> np.ndarray:
    """Instants (n,) at which every side and run has its vortex; ValueError for fewer than three."""
    every = [*measured.values(), *(e.table for e in case.effects)]
    at = np.flatnonzero(np.all([np.isfinite(t["circulation"].to_numpy()) for t in every], axis=0))
    if at.size < FEWEST:
        raise StageError(
            f"the tip vortex exists on all sides at only {at.size} instants; three are needed:"
            " take pictures of the whole stroke, or of more particles"
        )
    return at


def compared_instants(
    case: Case,
    measured: dict[str, pd.DataFrame],
    at: np.ndarray,
    columns: tuple[str, ...],
    random: np.ndarray,
) -> np.ndarray:
    """The instants of `at` that tell most of a quantity: those of least predicted uncertainty.

    That is what PIV changes of it, `random`, the vectors' scatter (component,), and the effect of
    the numerics. A circulation lasts: all from one instant on. A place does not, since errors of a
    path grow: a third of the instants. Without a virtual experiment the later half.
    """
    if "virtual" not in measured:
        return at[at.size // 2 if at.size >= 2 * FEWEST else 0 :]
    least = max(FEWEST, int(LEAST * at.size))
    times, names = case.direct["time"].values, list(columns)
    changed = (measured["virtual"] - measured["direct"])[names].to_numpy(float)

    def predicted(rows: np.ndarray) -> float:
        alike = independent_instants(times[rows], _swirl(measured["data"], rows), case.window_m)
        parts = [UNLIKE * np.mean(np.abs(changed[rows]), axis=0), random / np.sqrt(alike)]
        return float(np.linalg.norm([*parts, *(e.std(columns, rows) for e in case.finer)]))

    starts = range(at.size - least + 1)
    lasts = columns == VORTEX["circulation"][0]
    return min((at[k:] if lasts else at[k : k + least] for k in starts), key=predicted)


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


def flow_quantities(case: Case, measured: dict[str, pd.DataFrame]) -> list[ValidatedQuantity]:
    """Circulation and centre with all their sources, as means over the instants that tell most."""
    simulated = "virtual" if "virtual" in measured else "direct"
    registration, at, out = case.registration, known_instants(case, measured), []
    sides = {"data": case.data} | ({} if case.virtual is None else {"virtual": case.virtual})
    own = {name: scatter(plane, measured[name], at) for name, plane in sides.items()}
    for name, (columns, unit, label) in VORTEX.items():
        spread = {side: np.array([std[c] for c in columns]) for side, std in own.items()}
        variance = np.sum([std**2 for std in spread.values()], axis=0)
        rows = compared_instants(case, measured, at, columns, np.sqrt(variance))
        times = case.direct["time"].values[rows]
        alike = independent_instants(times, _swirl(measured["data"], rows), case.window_m)
        ours, direct, theirs = (
            measured[side].loc[rows, list(columns)].to_numpy(float)
            for side in (simulated, "direct", "data")
        )
        excess = excess_scatter(times, ours - theirs, variance)
        value, rate = theirs.mean(axis=0), np.gradient(direct, times, axis=0).mean(axis=0)
        delay = np.abs(rate) * registration.law.std("delay")
        if name == "circulation":  # goes with the square of the scale
            seat = "scale", 2 * np.abs(value) * np.sqrt(registration.covariance[3, 3])
        else:
            turn = place_jacobian(registration.pose, value)
            seat = "pose", np.sqrt(np.diag(turn @ registration.covariance @ turn.T))
        found = [
            ("scatter", excess / np.sqrt(alike), "scatter of E beyond the vectors' uncertainty"),
            ("time", delay, "fit of the finger's motion"),
            (*seat, POSTERIOR),
        ]
        for side, std in spread.items():
            count = times.size if side == "virtual" and case.fresh_pairs else alike
            how = f"{count:.1f} of {times.size} instants count as independent"
            found.append(
                ("vectors" if side == "data" else "virtual vectors", std / count**0.5, how)
            )
        if simulated == "virtual":
            how = "a third of what PIV changes of the simulation: the other flow may be unlike"
            found.append(("PIV", UNLIKE * np.abs((ours - direct).mean(axis=0)), how))
        sources = [Source(what, "data", std, how) for what, std, how in found]
        added = sum((e.moves(columns, rows) for e in case.finer), np.zeros(len(columns)))
        quantity = ValidatedQuantity(
            name,
            label,
            unit,
            ours.mean(axis=0) + added,
            value,
            case.kinematics.tip_width if name == "centre" else float(abs(value[0])),
            run_sources(case, columns, rows) + sources,
            explained_by_motion(case, columns, rows),
            added if case.finer else None,
            (float(times[0]), float(times[-1])),
        )
        known = np.hypot(quantity.u_kind("numerical"), quantity.u_kind("input"))
        quantity.instant["data"] = np.hypot(
            np.hypot(spread["data"], excess), quantity.u_kind("data")
        )
        quantity.instant["simulation"] = np.hypot(spread.get("virtual", 0.0), known)
        out.append(quantity)
    return out


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

    Where the recording shows the motion, how well it is known takes the place of the inputs of the
    motion, and its effect is linear: flow goes with 1/(1 + x) for a motion x slower, and a line
    through the run's x₀ is off by x(x − x₀), the part x − x₀ of what the motion explains. Else the
    FEA's band of the bend counts as the pressure that bends as much.
    """
    sources = []
    for e in case.effects:
        moves = np.abs(e.moves(columns, rows))
        if e.share is None:
            sources.append(Source(e.name, e.kind, e.std(columns, rows), e.how))
        else:
            std, how = moves * e.share_std, POSTERIOR
            sources.append(Source(f"{e.name} as recorded", "data", std, how))
            std, how = moves * abs(e.share) * e.unlike, "effect of the motion taken for linear"
            sources.append(Source(f"{e.name}, linear", "input", std, how))
        if e.name == "pressure" and case.geometry and not case.of_motion:
            std, how = moves * case.bend_std / abs(e.bend), "FEA's band, by the pressure's run"
            sources.append(Source("geometry and material", "input", std, how))
    return sources


def explained_by_motion(
    case: Case, columns: tuple[str, ...], rows: np.ndarray
) -> np.ndarray | None:
    """Part of S − D due to the difference of the motions; None where that is not known."""
    parts = [e.share * e.moves(columns, rows) for e in case.of_motion if e.share is not None]
    return -np.sum(parts, axis=0) if parts else None
