"""The flow's quantities with their uncertainty from runs, vectors and registration."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import Kinematics
from postprocess.lab.data.inputs_toml import Input, Numerics
from postprocess.lab.data.pose import Pose
from postprocess.lab.judgement.inputs_of_budget import Case, Effect, stacked
from postprocess.lab.judgement.measures import measure, scatter
from postprocess.lab.judgement.motion import motion_of_run
from postprocess.lab.judgement.validation import FieldComparison, Source, ValidatedQuantity

VORTEX = {  # quantity: columns, unit, label
    "circulation": (("circulation",), "m²/s", "circulation of the tip vortex"),
    "centre": (("x", "y"), "m", "centre of the tip vortex"),
    "core_radius": (("core_radius",), "m", "core radius of the tip vortex"),
    "jet_speed": (("jet_speed",), "m/s", "jet speed at the tip"),
}
# sources that a mean over instants makes smaller
RANDOM = ("vectors", "virtual vectors", "scatter")
SIDES = {"data": (RANDOM[0], ""), "virtual": (RANDOM[1], " of the virtual experiment")}
GROWTH = 3.0  # ratio of PIV's growth to the flow's beyond which it tells nothing (seen: 1.5 to 2.6)
SWIRL = 0.638  # largest speed of a Lamb-Oseen vortex over circulation/(2π core radius)
BY_PIV = "what PIV takes off the simulation, "
OF_RUNS = BY_PIV + "of what the finer runs add"
OF_MOTION = (
    "what PIV makes of the motion's part; of a circulation between the part itself and as much as"
    " it makes of the growth between the instants"
)
OF_ERROR = BY_PIV + "of E: the two flows are measured alike only as far as they are alike"
POSTERIOR = "posterior of the registration"


def tables(case: Case) -> dict[str, pd.DataFrame]:
    """`measure` of every side."""
    sides = {"data": case.data, "virtual": case.virtual, "direct": case.direct}
    return {name: measure(case, p, name) for name, p in sides.items() if p is not None}


def common_rows(measured: dict[str, pd.DataFrame], window: tuple[float, float]) -> np.ndarray:
    """Instants of the window at which every side has its vortex (instant,) bool.

    ValueError where there are fewer than three, or none on one side of the window's middle.
    """
    first = next(iter(measured.values()))
    ok = first["time"].between(*window).to_numpy()
    for table in measured.values():
        ok = ok & np.isfinite(table["circulation"].to_numpy())
    if ok.sum() < 3:
        raise ValueError(
            f"the tip vortex exists on all sides at only {ok.sum()} instants between"
            f" {window[0]:.3f} and {window[1]:.3f} s; three are needed"
        )
    seen = first["time"].to_numpy()[ok]
    if not seen[0] <= 0.5 * (window[0] + window[1]) <= seen[-1]:
        raise ValueError(
            f"the tip vortex exists on all sides only from {seen[0]:.3f} to {seen[-1]:.3f} s, which"
            f" leaves out the middle of {window[0]:.3f} to {window[1]:.3f} s, where it is compared;"
            " take pictures of the whole stroke, or of more particles"
        )
    return ok


def effect_of(
    one: Input | Numerics, plane: xr.Dataset, run: Kinematics, case: Case, nominal: pd.DataFrame
) -> Effect:
    """The effect of a run with `plane`; `nominal`: the `measure` of `case.direct`."""
    window, table = case.window, measure(case, plane, one.name)
    rows = common_rows({"nominal": nominal, one.name: table}, window)
    change = means(table, rows, window) - means(nominal, rows, window)
    scatter = 0.0 * change  # the step of an input is far enough for its effect to stand out
    if isinstance(one, Input):
        kind, per_std, how = "input", one.std / abs(one.step), f"run with {one.key} {one.step:+g}"
    else:
        kind, per_std = "numerical", one.per_difference
        how = f"run finer by {one.ratio:g}, whose change is added to the simulation; that run's"
        how += " grid-convergence index"
        scatter = mean_std((table - nominal)[rows], nominal["time"][rows], window)
    field = (stacked(plane) - stacked(case.direct)).astype(float)
    motion = motion_of_run(case.kinematics, run)
    return Effect(one.name, kind, how, float(per_std), change, scatter, field, *motion)


def means(table: pd.DataFrame, rows: np.ndarray, window: tuple[float, float]) -> pd.Series:
    """Means over the window (s): a straight line through the chosen instants, in the middle.

    A vortex grows through the stroke: a plain mean would follow whichever instants show it.
    """
    chosen, middle = table.loc[rows], 0.5 * (window[0] + window[1])
    out = {}
    for name in chosen.columns.drop("time"):
        seen = chosen[["time", name]].dropna()
        out[name] = np.polynomial.Polynomial.fit(seen["time"] - middle, seen[name], 1)(0.0)
    return pd.Series(out)


def mean_factor(times: np.ndarray, window: tuple[float, float]) -> float:
    """Uncertainty of `means` over that of a plain mean, at instants (s)."""
    off = 0.5 * (window[0] + window[1]) - times.mean()
    return float(np.sqrt(1 + off**2 / max(float(times.var()), 1e-12)))


def mean_std(differences: pd.DataFrame, times: pd.Series, window: tuple[float, float]) -> pd.Series:
    """Standard uncertainty of `means` of differences, by their scatter about the line."""
    at, chosen = times.to_numpy(), differences.drop(columns="time")
    scatter = excess_scatter(at, chosen.to_numpy(float), np.zeros(chosen.shape[1]))
    return pd.Series(scatter * mean_factor(at, window) / np.sqrt(at.size), index=chosen.columns)


def flow_quantities(
    case: Case, measured: dict[str, pd.DataFrame], rows: np.ndarray
) -> list[ValidatedQuantity]:
    """Circulation, centre, core radius and jet speed with all their sources."""
    base = {name: means(table, rows, case.window) for name, table in measured.items()}
    simulated = "virtual" if "virtual" in measured else "direct"
    at = np.flatnonzero(rows)
    own = {"data": scatter(case, case.data, measured["data"], at)}
    if case.virtual is not None:
        own["virtual"] = scatter(case, case.virtual, measured["virtual"], at)
    out = []
    for name, (columns, unit, label) in VORTEX.items():
        take = lambda s, columns=columns: np.array([float(s[c]) for c in columns])  # noqa: E731
        rates = np.array([_mean_rate(measured["direct"], c, rows) for c in columns])
        error = (measured[simulated] - measured["data"]).loc[rows, list(columns)].to_numpy(float)
        each = {side: take(s) for side, s in own.items()}
        random, instant = _vector_sources(case, base["data"], rows, error, each)
        ours, direct, theirs = (take(base[side]) for side in (simulated, "direct", "data"))
        # a place has no size that a measurement could take a share of
        share = 0.0 if name == "centre" else abs(1 - float(direct[0] / ours[0]))
        gain, spread = 1.0, share
        if name == "circulation":
            gain, spread = gain_of_growth(measured[simulated], measured["direct"], rows)
        sources = [*run_sources(case, columns), *motion_sources(case, columns, gain), *random]
        sources += _registration_sources(case, name, theirs, rates)
        added = sum((e.moves(columns) for e in case.finer), np.zeros(len(columns)))
        moved = explained_by_motion(case, columns)
        explained = None if moved is None else gain * moved
        if share:
            part = np.zeros(1) if explained is None else explained
            rest = ours + added - theirs - part
            if np.any(added):
                sources.append(Source("finer by PIV", "data", share * np.abs(added), OF_RUNS))
            if np.any(part):
                sources.append(Source("motion by PIV", "data", spread * np.abs(part), OF_MOTION))
            sources.append(Source("unlike flows", "data", share * np.abs(rest), OF_ERROR, share))
        quantity = ValidatedQuantity(
            name,
            label,
            unit,
            ours + added,
            direct + added,
            theirs,
            case.kinematics.tip_width if name == "centre" else float(abs(theirs[0])),
            sources,
            explained,
            _at_instant(sources, instant),
            added if case.finer else None,
        )
        out.append(quantity)
    return out


def gain_of_growth(
    measured: pd.DataFrame, direct: pd.DataFrame, rows: np.ndarray
) -> tuple[float, float]:
    """How much of a change of the circulation PIV shows, and its relative standard uncertainty.

    PIV takes more off a young vortex, so that the `measured` one grows faster than the `direct`
    one. A change that another motion makes is shown between one and that ratio of growths times,
    uniformly; beyond `GROWTH` once, as uncertain as at that limit.
    """
    of_piv, own = (_mean_rate(table, "circulation", rows) for table in (measured, direct))
    if not abs(own) / GROWTH <= of_piv * np.sign(own) <= abs(own) * GROWTH:
        return 1.0, (GROWTH - 1) / 12**0.5
    gain = 0.5 * (1 + of_piv / own)
    return gain, abs(of_piv / own - 1) / 12**0.5 / gain


def _vector_sources(
    case: Case, data: pd.Series, rows: np.ndarray, error: np.ndarray, own: dict[str, np.ndarray]
) -> tuple[list[Source], dict[str, np.ndarray]]:
    """Random sources of a mean over the instants `rows`, and each side's scatter at one instant.

    `own`: scatter of one instant by the vectors' uncertainty, (component,) by side; `data`: means,
    which say how fast particles leave a window; `error` (instant, component).
    """
    times = case.direct["time"].values[rows]
    swirl = SWIRL * abs(data["circulation"]) / (2 * np.pi * data["core_radius"])
    alike = independent_instants(times, swirl, case.window_m)
    sources = []
    larger = mean_factor(times, case.window)
    for side, std in own.items():
        name, whose = SIDES[side]
        count = float(times.size) if side == "virtual" and case.fresh_pairs else alike
        how = f"Monte Carlo over the vectors' uncertainty{whose}; {count:.1f} of {times.size}"
        how += " instants count as independent"
        sources.append(Source(name, "data", larger * std / np.sqrt(count), how))
    excess = excess_scatter(times, error, np.sum([std**2 for std in own.values()], axis=0))
    how = "scatter of E from instant to instant beyond the vectors' uncertainty"
    sources.append(Source("scatter", "data", larger * excess / np.sqrt(times.size), how))
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


def _at_instant(sources: list[Source], scatter: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Standard uncertainty of each side at one instant: `scatter`, and what is not random."""
    other = {side: np.zeros_like(std) for side, std in scatter.items()}
    for source in sources:
        if source.name not in RANDOM:
            other["data" if source.kind == "data" else "simulation"] += source.std**2
    return {side: np.sqrt(std**2 + other[side]) for side, std in scatter.items()}


def independent_instants(times: np.ndarray, speed: float, window_m: float) -> float:
    """How many of the instants (s) count as independent in a mean.

    Errors at two instants correlate by the share of a window (m) that a particle at `speed` (m/s)
    has not yet crossed.
    """
    apart = np.abs(times[:, None] - times[None, :])
    return float(times.size**2 / np.sum(np.clip(1 - speed * apart / window_m, 0.0, 1.0)))


def _mean_rate(table: pd.DataFrame, column: str, rows: np.ndarray) -> float:
    """Mean rate of change over the window, 1/s times the unit."""
    chosen = table.loc[rows]
    return float(np.polyfit(chosen["time"], chosen[column], 1)[0])


def _registration_sources(
    case: Case, name: str, value: np.ndarray, rate: np.ndarray
) -> list[Source]:
    """Effect of the uncertainty of pose and time on a quantity of the data."""
    registration = case.registration
    std = np.abs(rate) * registration.law.std("delay")
    time = Source("time", "data", std, "fit of the finger's motion")
    power = {"circulation": 2.0, "core_radius": 1.0, "jet_speed": 1.0}  # of the scale in each
    if name in power:
        std = np.abs(value) * power[name] * np.sqrt(registration.covariance[3, 3])
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


def run_sources(case: Case, columns: tuple[str, ...]) -> list[Source]:
    """Uncertainty of inputs and numerics by the runs beside the nominal one.

    Inputs of the motion count only where the recording does not show it. The FEA's band of the
    bend angle counts as the pressure that bends as much, scaled from the pressure's run.
    """
    seen = [part.effect.name for part in case.motion]
    effects = (e for e in case.effects if e.name not in seen)
    sources = [Source(e.name, e.kind, e.std(columns), e.how) for e in effects]
    effect = case.effect("pressure")
    if not case.geometry or effect is None or seen:
        return sources
    std = np.abs(effect.moves(columns)) * (case.bend_std / abs(effect.bend))
    how = "FEA's band, scaled from the run of the pressure"
    return [*sources, Source("geometry and material", "input", std, how)]


def motion_sources(case: Case, columns: tuple[str, ...], gain: float = 1.0) -> list[Source]:
    """Uncertainty of the recording's motion and of its linear effect; `gain`: as PIV shows it.

    Flow goes with 1/(1 + x) for a motion x slower: a line through the run's x₀ is off by
    x(x − x₀), the part x − x₀ of what the motion explains.
    """
    sources = []
    for part in case.motion:
        moves, name = gain * np.abs(part.effect.moves(columns)), part.effect.name
        sources.append(Source(f"{name} as recorded", "data", moves * part.std, POSTERIOR))
        std, how = moves * abs(part.share) * part.unlike, "effect of the motion taken for linear"
        sources.append(Source(f"{name}, linear", "input", std, how))
    return sources


def explained_by_motion(case: Case, columns: tuple[str, ...]) -> np.ndarray | None:
    """Part of S − D due to the difference of the motions; None where that is not known."""
    if not case.motion:
        return None
    return -np.sum([part.share * part.effect.moves(columns) for part in case.motion], axis=0)


def field_comparison(case: Case, rows: np.ndarray) -> FieldComparison:
    """E of every vector over the chosen instants, with its sources of uncertainty."""
    data, direct = (stacked(p)[rows].astype(float) for p in (case.data, case.direct))
    simulation = stacked(case.simulation)[rows].astype(float)
    none = np.zeros_like(simulation)
    finer = sum((e.field[rows] for e in case.finer), none)
    moved = sum((part.share * part.effect.field[rows] for part in case.motion), none)
    error = simulation - data + finer + moved
    error = np.where(np.isfinite(error).all(axis=1, keepdims=True), error, np.nan)
    modes: dict[str, tuple[str, np.ndarray]] = {}
    seen = [part.effect.name for part in case.motion]
    for effect in case.effects:
        if effect.name not in seen:
            modes[effect.name] = (effect.kind, effect.field[rows] * effect.per_std)
    for part in case.motion:
        name, change = part.effect.name, part.effect.field[rows]
        modes[f"{name} as recorded"] = "data", change * part.std
        modes[f"{name}, linear"] = "input", change * part.share * part.unlike
    pressure = case.effect("pressure")
    if case.geometry and pressure is not None and not seen:
        band = pressure.field[rows] * case.bend_std / abs(pressure.bend)
        modes["geometry and material"] = "input", band
    share = np.sqrt(np.nanmean((simulation - direct) ** 2) / np.nanmean(simulation**2))
    # changes of the flow itself: what PIV takes off them is not known
    parts = {"finer by PIV": finer, "motion by PIV": moved}
    modes |= {name: ("data", share * part) for name, part in parts.items() if np.any(part)}
    modes |= _registration_modes(case, rows, direct)
    noise2 = np.zeros_like(error)
    for plane in (case.data, case.virtual):
        if plane is not None:
            noise2 += stacked(plane, "_std")[rows].astype(float) ** 2
    return FieldComparison(error, modes, np.sqrt(noise2))


def _registration_modes(
    case: Case, rows: np.ndarray, direct: np.ndarray
) -> dict[str, tuple[str, np.ndarray]]:
    """Change of the field by one standard deviation of each error of pose and time."""
    registration = case.registration
    x, y, times = (case.direct[name].values.astype(float) for name in ("x", "y", "time"))
    along_y, along_x = np.gradient(direct, y, axis=2), np.gradient(direct, x, axis=3)
    rate = np.gradient(stacked(case.direct).astype(float), times, axis=0)[rows]
    gx, gy = np.meshgrid(x, y)
    anchor = registration.pose.to_camera(np.asarray(registration.pose.anchor))
    scale = registration.pose.pixel
    arm_x, arm_y = gx - anchor[0], gy - anchor[1]
    ux, uy = direct[:, 0], direct[:, 1]
    basis = [
        along_x * scale,
        along_y * scale,
        -arm_y * along_x + arm_x * along_y - np.stack([-uy, ux], axis=1),
        arm_x * along_x + arm_y * along_y - direct,
    ]
    size, vectors = np.linalg.eigh(registration.covariance)
    modes: dict[str, tuple[str, np.ndarray]] = {}
    for k in range(4):
        field_of = sum(vectors[i, k] * basis[i] for i in range(4)) * np.sqrt(max(size[k], 0.0))
        modes[f"pose {k + 1}"] = ("data", field_of)
    return modes | {"time": ("data", rate * registration.law.std("delay"))}
