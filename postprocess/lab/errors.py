"""Every quantity of a comparison with its sources of uncertainty: from runs, from vectors' errors, from the registration."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from piv.vortices import VortexSettings
from postprocess.lab.budget import FieldComparison, Quantity, Source
from postprocess.lab.family import Family
from postprocess.lab.inputs import Input, Inputs, Numerics
from postprocess.lab.measures import measure, scatter
from postprocess.lab.registration import Registration, fit_law

VORTEX = {  # quantity: columns, unit, label
    "circulation": (("circulation",), "m²/s", "circulation of the tip vortex"),
    "centre": (("x", "y"), "m", "centre of the tip vortex"),
    "core_radius": (("core_radius",), "m", "core radius of the tip vortex"),
    "jet_speed": (("jet_speed",), "m/s", "jet speed at the tip"),
}
PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes: means of `measures` over the window, the field (time, 2, y, x; of all
    instants), final bend (rad) and duration (s).

    `per_std`: its part that counts as one standard uncertainty (of the step for inputs, of the difference for numerics).
    """

    name: str
    kind: str
    how: str
    per_std: float
    change: pd.Series
    field: np.ndarray
    bend: float
    duration: float


@dataclass(frozen=True)
class Case:
    """All that the budgets are made of: series of the sides, the window (s), motions and the effects of the runs."""

    family: Family
    registration: Registration
    data: xr.Dataset
    virtual: xr.Dataset | None
    direct: xr.Dataset
    window: tuple[float, float]
    vortices: VortexSettings
    window_m: float
    geometry: bool  # whether the FEA's bands count
    bend_std: float  # rad, of the FEA at the end of the stroke
    effects: list[Effect] = field(default_factory=list)


def tables(case: Case) -> dict[str, pd.DataFrame]:
    """`measure` of every side."""
    pose = case.registration.pose
    sides = {"data": case.data, "virtual": case.virtual, "direct": case.direct}
    return {
        name: measure(p, pose, case.vortices, case.window, name) for name, p in sides.items() if p is not None
    }


def common_rows(found: dict[str, pd.DataFrame], window: tuple[float, float]) -> np.ndarray:
    """Instants of the window at which every side has its vortex (instant,) bool; ValueError where there are fewer than three."""
    first = next(iter(found.values()))
    ok = first["time"].between(*window).to_numpy()
    for table in found.values():
        ok = ok & np.isfinite(table["circulation"].to_numpy())
    if ok.sum() < 3:
        raise ValueError(
            f"the tip vortex exists on all sides at only {ok.sum()} instants between {window[0]:.3f} and {window[1]:.3f} s;"
            " three are needed"
        )
    return ok


def effect_of(
    one: Input | Numerics, plane: xr.Dataset, run: Family, case: Case, nominal: pd.DataFrame
) -> Effect:
    """The effect of a run: its `plane` against the nominal `case.direct` (measured: `nominal`), its motion against the family's."""
    table = measure(plane, case.registration.pose, case.vortices, case.window, one.name)
    rows = common_rows({"nominal": nominal, one.name: table}, case.window)
    if isinstance(one, Input):
        kind, per_std, how = "input", one.std / abs(one.step), f"run with {one.key} {one.step:+g}"
    else:
        kind, per_std = "numerical", one.per_difference
        how = f"run finer by {one.ratio:g}, grid-convergence index"
    change = means(table, rows) - means(nominal, rows)
    field = np.stack([plane[n].values - case.direct[n].values for n in ("u", "v")], axis=1).astype(float)
    return Effect(one.name, kind, how, float(per_std), change, field, *motion_of_run(case.family, run))


def means(table: pd.DataFrame, rows: np.ndarray) -> pd.Series:
    """Means over the chosen instants."""
    return table.loc[rows].drop(columns="time").mean()


def numerical_and_input(effects: list[Effect], columns: tuple[str, ...]) -> list[Source]:
    """Sources that runs beside the nominal one measured."""
    found = []
    for effect in effects:
        change = effect.change[list(columns)].to_numpy(float)
        found.append(Source(effect.name, effect.kind, np.abs(change) * effect.per_std, effect.how))
    return found


def flow_quantities(case: Case, found: dict[str, pd.DataFrame], rows: np.ndarray) -> list[Quantity]:
    """Circulation, centre, core radius and jet speed with all their sources."""
    base = {name: means(table, rows) for name, table in found.items()}
    simulation = base.get("virtual", base["direct"])
    count = int(rows.sum())
    pose = case.registration.pose
    own = {
        name: scatter(
            getattr(case, name), found[name], np.flatnonzero(rows), pose, case.vortices, case.window_m
        )
        for name in ("data", "virtual")
        if name in found
    }
    rates = {c: _mean_rate(found["direct"], c, rows) for col in VORTEX.values() for c in col[0]}
    out = []
    for name, (columns, unit, label) in VORTEX.items():
        take = lambda s, columns=columns: np.array([float(s[c]) for c in columns])  # noqa: E731
        sources = numerical_and_input(case.effects, columns)
        sources += geometry_sources(case, columns)
        for side, std in own.items():
            part = take(std) / np.sqrt(count)
            told = "Monte Carlo over the vectors' uncertainty" + (
                "" if side == "data" else " of the virtual experiment"
            )
            sources.append(Source("vectors" if side == "data" else "virtual vectors", "data", part, told))
        sources += registration_sources(case, name, take(base["data"]), np.array([rates[c] for c in columns]))
        scale = _scale(name, base["data"], case.family)
        explained = explained_by_motion(case, columns)
        out.append(
            Quantity(
                name,
                label,
                unit,
                take(simulation),
                take(base["direct"]),
                take(base["data"]),
                scale,
                sources,
                explained,
            )
        )
    return out


def _scale(name: str, data: pd.Series, family: Family) -> float:
    return family.tip_width if name == "centre" else float(abs(data[VORTEX[name][0][0]]))


def _mean_rate(table: pd.DataFrame, column: str, rows: np.ndarray) -> float:
    """Mean rate of change over the window, 1/s times the unit."""
    chosen = table.loc[rows]
    return float(np.polyfit(chosen["time"], chosen[column], 1)[0])


def registration_sources(case: Case, name: str, value: np.ndarray, rate: np.ndarray) -> list[Source]:
    """What pose and time, each as uncertain as it was found, do to a quantity of the data."""
    registration = case.registration
    std = np.sqrt(np.diag(registration.covariance))
    px_per_m = registration.pose.px_per_m
    power = {"circulation": 2.0, "core_radius": 1.0, "jet_speed": 1.0, "centre": 0.0}[name]
    sources = [Source("scale", "data", np.abs(value) * power * std[3], "posterior of the registration")]
    sources.append(
        Source("time", "data", np.abs(rate) * registration.law.std("delay"), "fit of the finger's motion")
    )
    if name == "centre":
        arm = value - np.asarray(registration.pose.anchor)
        # x_tank = R⁻¹ (px − at)/k + anchor: shift, turn and scale of the pose, each with its covariance
        jacobian = np.array([[1 / px_per_m, 0, arm[1], -arm[0]], [0, 1 / px_per_m, -arm[0], -arm[1]]])
        spread = np.sqrt(np.diag(jacobian @ registration.covariance @ jacobian.T))
        sources.append(Source("pose", "data", spread, "posterior of the registration"))
    return sources


def geometry_sources(case: Case, columns: tuple[str, ...]) -> list[Source]:
    """The FEA's band of the bend angle as the pressure that would bend as much (scaled from the pressure's run)."""
    effect = _effect(case, "pressure")
    if not case.geometry or effect is None:
        return []
    change = effect.change[list(columns)].to_numpy(float)
    per_bend = case.bend_std / abs(effect.bend)
    return [
        Source(
            "geometry and material",
            "input",
            np.abs(change) * per_bend,
            "FEA's band, scaled from the run of the pressure",
        )
    ]


def _effect(case: Case, name: str) -> Effect | None:
    return next((e for e in case.effects if e.name == name), None)


def explained_by_motion(case: Case, columns: tuple[str, ...]) -> np.ndarray | None:
    """Part of E that follows from the recording's finger moving otherwise: its bend and duration times the runs' effects."""
    pressure, duration = _effect(case, "pressure"), _effect(case, "duration")
    if pressure is None or duration is None:
        return None
    bend, length = motion_values(case)
    total = np.zeros(len(columns))
    for effect, (simulated, seen), own in (
        (pressure, bend, pressure.bend),
        (duration, length, duration.duration),
    ):
        change = effect.change[list(columns)].to_numpy(float)
        total += change * (simulated - seen) / own if abs(own) > 1e-12 else 0.0
    return total


def motion_values(case: Case) -> tuple[tuple[float, float], tuple[float, float]]:
    """(simulation, recording) of the final bend angle (rad) and of the stroke's duration (s)."""
    factor, _, stretch = case.registration.law.values
    length = stroke_duration(case.family)
    return (final_bend(case.family, 1.0), final_bend(case.family, factor)), (length, length * float(stretch))


def final_bend(family: Family, factor: float) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(family.law(t)) for t in family.time)
    return float(family.shape("bend", start + factor * (end - start)))


def motion_of_run(nominal: Family, run: Family) -> tuple[float, float]:
    """Final bend (rad) and duration (s) by which a run's motion differs from the nominal one, in terms of its law."""
    times = np.linspace(*nominal.time, 201)
    values, _, _ = fit_law(nominal, times, run.law(times), np.array([1.0, 0.0, 1.0]))
    return (
        final_bend(nominal, float(values[0])) - final_bend(nominal, 1.0),
        stroke_duration(nominal) * (float(values[2]) - 1),
    )


def stroke_duration(family: Family) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*family.time, 801)
    bend = family.bend(family.law(times))
    done = np.maximum.accumulate(np.abs(bend - bend[0])) / np.abs(bend - bend[0]).max()
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def motion_quantities(case: Case, inputs: Inputs) -> list[Quantity]:
    """Final bend angle and duration of the stroke: does the simulation's finger move as the recording's?"""
    registration, family = case.registration, case.family
    bend, length = motion_values(case)
    law = registration.law
    slope = (final_bend(family, law.values[0] + 0.01) - bend[1]) / 0.01
    seen = abs(slope) * law.std("factor")
    sources = {
        "final_bend": [Source("silhouette", "data", np.array([seen]), "posterior of the registration")],
        "duration": [
            Source(
                "silhouette",
                "data",
                np.array([length[0] * law.std("stretch")]),
                "posterior of the registration",
            )
        ],
    }
    for effect in (e for e in case.effects if e.kind == "input"):
        for key, change in (("final_bend", effect.bend), ("duration", effect.duration)):
            sources[key].append(
                Source(effect.name, "input", np.array([abs(change) * effect.per_std]), effect.how)
            )
    if case.geometry:
        sources["final_bend"].append(
            Source("geometry and material", "input", np.array([case.bend_std]), "FEA's band")
        )
    one = lambda v: np.array([v])  # noqa: E731
    return [
        Quantity("final_bend", "bend angle at the end", "rad", one(bend[0]), one(bend[0]), one(bend[1]), abs(bend[1]), sources["final_bend"]),
        Quantity("duration", "duration of the stroke", "s", one(length[0]), one(length[0]), one(length[1]), length[1], sources["duration"]),
    ]  # fmt: skip


def field_comparison(case: Case, rows: np.ndarray) -> FieldComparison:
    """The velocity field over the chosen instants: E of every vector and what moves it."""
    velocity = {
        name: np.stack([p["u"].values, p["v"].values], axis=1)[rows].astype(float)
        for name, p in (("data", case.data), ("virtual", case.virtual), ("direct", case.direct))
        if p is not None
    }
    simulation = velocity.get("virtual", velocity["direct"])
    error = simulation - velocity["data"]
    error = np.where(np.isfinite(error).all(axis=1, keepdims=True), error, np.nan)
    direct = velocity["direct"]
    modes: dict[str, tuple[str, np.ndarray]] = {}
    for effect in case.effects:
        modes[effect.name] = (effect.kind, effect.field[rows] * effect.per_std)
    pressure = _effect(case, "pressure")
    if case.geometry and pressure is not None:
        modes["geometry and material"] = (
            "input",
            pressure.field[rows] * case.bend_std / abs(pressure.bend),
        )
    modes |= registration_modes(case, rows, direct)
    noise2 = np.zeros_like(error)
    for plane in (case.data, case.virtual):
        if plane is not None:
            noise2 += (
                np.stack([plane["u_std"].values, plane["v_std"].values], axis=1)[rows].astype(float) ** 2
            )
    return FieldComparison(error, modes, np.sqrt(noise2))


def registration_modes(case: Case, rows: np.ndarray, direct: np.ndarray) -> dict[str, tuple[str, np.ndarray]]:
    """What one standard deviation of each independent error of pose and time does to the field (time, 2, y, x)."""
    registration = case.registration
    x, y, times = (case.direct[name].values.astype(float) for name in ("x", "y", "time"))
    whole = np.stack([case.direct["u"].values, case.direct["v"].values], axis=1).astype(float)
    along_y, along_x = np.gradient(direct, y, axis=2), np.gradient(direct, x, axis=3)
    rate = np.gradient(whole, times, axis=0)[rows]
    gx, gy = np.meshgrid(x, y)
    anchor = registration.pose.to_camera(np.asarray(registration.pose.anchor))
    px = registration.pose.px_per_m
    arm_x, arm_y = gx - anchor[0], gy - anchor[1]
    ux, uy = direct[:, 0], direct[:, 1]
    basis = [
        along_x / px,
        along_y / px,
        -arm_y * along_x + arm_x * along_y - np.stack([-uy, ux], axis=1),
        arm_x * along_x + arm_y * along_y - direct,
    ]
    size, vectors = np.linalg.eigh(registration.covariance)
    modes: dict[str, tuple[str, np.ndarray]] = {}
    for k in range(4):
        field_of = sum(vectors[i, k] * basis[i] for i in range(4)) * np.sqrt(max(size[k], 0.0))
        modes[f"pose {k + 1}"] = ("data", field_of)
    return modes | {"time": ("data", rate * registration.law.std("delay"))}
