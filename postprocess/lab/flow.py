"""Circulation and centre of the tip vortex, at the instants that tell most of each.

While the vortex is smaller than an interrogation window, PIV takes a large share off it, and a
level's own error grows with time. The comparison is made where both together cost least.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from piv.files.errors import StageError
from piv.formats.plane_series import read_plane, usable
from piv.vortices.table import tabulate_vortices
from postprocess.evidence import tip_vortex as tracks
from postprocess.lab.inputs import level_uncertainty
from postprocess.lab.motion import Comparison, motion_quantities, recorded_bend, stroke_duration
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.validation import LEVEL_ERROR, POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.virtual_experiment import Sides, at_duration

COLUMNS = ("circulation", "x", "y")


# columns of a table, unit, label, and the power of the scale with which values go (0: a place)
QUANTITIES = {
    "circulation": (["circulation"], "m²/s", "circulation of the tip vortex", 2),
    "centre": (["x", "y"], "m", "centre of the tip vortex", 0),
}
FEWEST, PART = 3, 1 / 3  # instants, and the share of all that have a vortex on all sides
MOST = 42  # instants of a run that varies an input: its effect changes slowly
# what PIV changes of a flow is known from the simulation's; of one that differs by up to a third,
# it may differ by as much
UNLIKE = 1 / 3
LINEAR = 0.15  # of what the recording's bend and duration change: how well that is known


def measure(
    sides: Sides, pose: Pose, plane: xr.Dataset, name: str, seen: np.ndarray
) -> pd.DataFrame:
    """Circulation, centre (tank frame) and radius of the tip vortex of a camera-frame series.

    With their random standard uncertainties, over time; NaN where there is no vortex.
    Vectors that are not `seen` do not count. StageError where no vortex is near the finger's tip.
    """
    counted = plane.drop_vars("flag", errors="ignore").assign(valid=usable(plane) & seen)
    table = tracks.of_disc(tabulate_vortices(counted, sides.vortices))
    table, times = table[table["bridged"] == 0], plane["time"].values
    try:
        track = tracks.dominant_track(table, 0, (times[0], times[-1]), name).set_index("time")
    except ValueError as error:
        raise StageError(
            f"{error}: no tip vortex is seen; check the vectors in {name}.h5 (piv view), piv.window"
            " and the seeding of the recording (docs/lab_protocol.md)"
        ) from None
    wanted = [*COLUMNS, "radius", *(f"{column}_random_std" for column in COLUMNS)]
    out = track[wanted].astype(float).reindex(pd.Index(times, name="time"))
    places = pose.from_camera(out[["x", "y"]].to_numpy())
    return out.assign(x=places[:, 0], y=places[:, 1]).reset_index()


def with_flow(case: Comparison, sides: Sides, sheets: dict[str, Path]) -> Comparison:
    """The case with both sides measured, and with what each input changes of the simulation's flow.

    `sheets`: those of the inputs' runs, by name; an input without is a stroke's duration.
    """
    named = {"data": sides.data, "virtual": sides.virtual, "direct": sides.direct}
    pose, seen = case.registration.pose, np.ones(sides.data["u"].shape, bool)
    if case.registration.times.size == 0:
        # without pictures the vectors of all sides, since programs mask the body differently
        seen = np.logical_and.reduce([usable(plane).values for plane in named.values()])
    measured = {name: measure(sides, pose, plane, name, seen) for name, plane in named.items()}
    step = -(-len(measured["direct"]) // MOST)
    ours = measured["direct"][::step].reset_index(drop=True)
    x, y, times = (sides.direct[n].values for n in ("x", "y", "time"))
    effects, at = [], ours["time"].to_numpy()
    for effect in case.effects:
        if effect.of.name not in sheets:
            longer = 1 + effect.duration / stroke_duration(case.kinematics)
            effects.append(replace(effect, table=of_stretch(measured["direct"], longer)))
            continue
        with read_plane(sheets[effect.of.name]) as opened:
            sheet = at_duration(opened.load(), case.registration.law.values[2])
        # of a run that ends earlier, its end
        plane = camera_series(sheet, pose, x, y, np.clip(at, *sheet["time"].values[[0, -1]]))
        run = measure(sides, pose, plane.assign_coords(time=at), effect.of.name, seen[::step])
        change = (run - ours)[[*COLUMNS]]
        known = change["circulation"].notna()
        table = {
            n: np.interp(times, at[known], v[known], np.nan, np.nan) for n, v in change.items()
        }
        effects.append(replace(effect, table=pd.DataFrame(table)))
    return replace(case, flow=sides, measured=measured, effects=effects)


def of_stretch(direct: pd.DataFrame, stretch: float) -> pd.DataFrame:
    """What a stroke `stretch` times as long changes of `COLUMNS`: NaN at phases not known."""
    known = direct[direct["circulation"].notna()]
    phase = direct["time"] / stretch
    there = {n: np.interp(phase, known["time"], known[n], np.nan, np.nan) for n in COLUMNS}
    there["circulation"] /= stretch
    return pd.DataFrame(there) - direct[[*COLUMNS]]


def of_recorded_motion(case: Comparison) -> list[pd.DataFrame]:
    """What the recording's own bend and duration change of `COLUMNS`; none: unknown.

    The bend by the run of the pressure. Both sides have the recording's duration already.
    """
    bend = recorded_bend(case)
    if bend is None or bend[0].table is None:
        return []
    back = of_stretch(case.measured["direct"], 1 / case.registration.law.values[2])
    return [bend[1] * bend[0].table[[*COLUMNS]], -back]


def corrected(case: Comparison) -> pd.DataFrame:
    """The simulation seen by PIV, at the recording's own motion where it is known."""
    out = case.measured["virtual"].copy()
    for change in of_recorded_motion(case)[:1]:
        out[[*COLUMNS]] += change.to_numpy()
    return out


def known_instants(case: Comparison) -> np.ndarray:
    """Instants (n,) at which every side and run knows the vortex; StageError of too few."""
    every = [*case.measured.values(), *(e.table for e in case.effects if e.table is not None)]
    every += of_recorded_motion(case)
    seen = np.flatnonzero(np.all([np.isfinite(t["circulation"].to_numpy()) for t in every], axis=0))
    if seen.size < FEWEST:
        raise StageError(
            f"the tip vortex exists on all sides at only {seen.size} instants; three are needed:"
            " take pictures of the whole stroke, or of more particles"
        )
    return seen


def level_std(case: Comparison, name: str, times: np.ndarray, scale: float) -> float:
    """Standard uncertainty of a quantity of a `scale` by the level's own error; 0: not known."""
    during = float(times[0]), float(times[-1])
    return scale * level_uncertainty(case.levels, case.level, during).get(name, 0.0)


def independent_instants(times: np.ndarray, window_s: float) -> float:
    """How many of the instants (s) count as independent in a mean.

    Errors at two instants correlate by the share of a window that particles, which cross it in
    `window_s`, have not yet crossed.
    """
    apart = np.abs(times[:, None] - times[None, :])
    return float(times.size**2 / np.sum(np.clip(1 - apart / window_s, 0.0, 1.0)))


def quantities(case: Comparison) -> list[ValidatedQuantity]:
    """The quantities of a recording with all their sources; the flow's over a part of the instants.

    S is the simulation seen by PIV, with what the recording's own motion changes.
    """
    out, tip = motion_quantities(case), case.kinematics.tip_width
    if case.flow is None:
        return out
    at = known_instants(case)
    data = case.measured["data"].loc[at]
    speed = (data["circulation"] / (2 * np.pi * data["radius"])).abs().mean()
    for name in QUANTITIES:
        rows = compared_instants(case, at, name, data["circulation"].abs().mean())
        scale = tip if name == "centre" else abs(float(data.loc[rows, "circulation"].mean()))
        out.append(_quantity(case, at, rows, name, scale, case.flow.window_m / float(speed)))
    return out


def series(case: Comparison) -> pd.DataFrame:
    """The flow's quantities of each side over time, and S of the table."""
    shown = case.measured | {"corrected": corrected(case)}
    tables = [t.set_index("time").add_suffix(f"_{name}") for name, t in shown.items()]
    return pd.concat(tables, axis=1).reset_index()


def compared_instants(
    case: Comparison, at: np.ndarray, name: str, circulation: float
) -> np.ndarray:
    """The third of the instants `at` at which PIV and the level change a quantity least."""
    columns, size = QUANTITIES[name][0], max(FEWEST, int(PART * at.size))
    scale = case.kinematics.tip_width if name == "centre" else circulation
    times = case.measured["data"]["time"].to_numpy()
    changed = (case.measured["virtual"] - case.measured["direct"])[columns].to_numpy(float)

    def predicted(rows: np.ndarray) -> float:
        seen = UNLIKE * np.linalg.norm(np.mean(np.abs(changed[rows]), axis=0))
        return float(np.hypot(seen, level_std(case, name, times[rows], scale)))

    return min((at[k : k + size] for k in range(at.size - size + 1)), key=predicted)


def _quantity(
    case: Comparison, at: np.ndarray, rows: np.ndarray, name: str, scale: float, window_s: float
) -> ValidatedQuantity:
    """One quantity over the instants `rows` of those `at` which all sides know.

    `scale`: its size; `window_s`: in which particles cross a window.
    """
    registration, measured = case.registration, case.measured
    columns, unit, label, power = QUANTITIES[name]
    times = measured["data"].loc[rows, "time"].to_numpy()
    ours, direct, theirs = (
        measured[side].loc[rows, columns].to_numpy(float) for side in ("virtual", "direct", "data")
    )
    # what grid and masks hide is alike on both sides, which are seen through the same windows
    random = [f"{column}_random_std" for column in columns]
    ours_std, theirs_std = (
        np.sqrt((measured[side].loc[at, random] ** 2).mean().to_numpy(float))
        for side in ("virtual", "data")
    )
    variance, alike = ours_std**2 + theirs_std**2, independent_instants(times, window_s)
    excess = excess_scatter(times, ours - theirs, variance)
    value, rate = theirs.mean(axis=0), np.gradient(direct, times, axis=0).mean(axis=0)
    if power:
        seat = power * np.abs(value) * np.sqrt(registration.covariance[3, 3])
    else:
        turn = place_jacobian(registration.pose, value)
        seat = np.sqrt(np.diag(turn @ registration.covariance @ turn.T))
    how = f"{alike:.1f} of {times.size} instants count as independent"
    of_piv = "a third of what PIV changes of the simulation: the other flow may be unlike"
    sources = [
        *run_sources(case, columns, rows),
        Source("vectors", "data", np.sqrt(variance / alike), how),
        Source("scatter", "data", excess / np.sqrt(alike), "of E beyond that of the vectors"),
        Source("pose", "data", seat, POSTERIOR),
        Source("time", "data", np.abs(rate) * registration.law.std("delay"), POSTERIOR),
        Source("PIV", "data", UNLIKE * np.abs((ours - direct).mean(axis=0)), of_piv),
    ]
    changes, moved, bent = of_recorded_motion(case), None, np.zeros(len(columns))
    if changes:
        parts = [change.loc[rows, columns].to_numpy(float) for change in changes]
        means, alone = [part.mean(axis=0) for part in parts], np.zeros(len(columns))
        # a vortex of single instants scatters, and each change has that of two
        noise = [excess_scatter(times, part, alone) / np.sqrt(times.size) for part in parts]
        moved, bent = np.sum(means, axis=0), means[0]
        std = np.linalg.norm([*(LINEAR * mean for mean in means), *noise], axis=0)
        sources.append(Source("correction", "input", std, "of what bend and duration change"))
    if (level := level_std(case, name, times, scale)) > 0:
        std = np.full(len(columns), level / np.sqrt(len(columns)))
        sources.append(Source(LEVEL_ERROR, "numerical", std, "its measured error, uniform"))
    both = ours.mean(axis=0) + bent, value
    quantity = ValidatedQuantity(name, label, unit, *both, scale, sources, moved)
    known = ours_std, quantity.u_kind("numerical"), quantity.u_kind("input")
    instant = {"simulation": np.linalg.norm(known, axis=0)}
    known = theirs_std, excess, quantity.u_kind("data")
    instant["data"] = np.linalg.norm(known, axis=0)
    return replace(quantity, window=(float(times[0]), float(times[-1])), instant=instant)


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


def run_sources(case: Comparison, columns: list[str], rows: np.ndarray) -> list[Source]:
    """Uncertainty of the inputs by the runs beside the nominal one.

    Where the recording shows the motion, how well it is known takes the place of the inputs of the
    motion. Else the FEA's band of the bend counts as the pressure that bends as much.
    """
    seen = recorded_bend(case)
    own = () if seen is None else ("pressure", "duration")
    sources = [
        # by the change's RMS, since its sign may change
        Source(e.of.name, "input", e.of.per_change * e.changes(columns, rows)[0], e.of.how)
        for e in case.effects
        if e.of.name not in own
    ]
    if seen is None:
        for e in case.effects if case.bend_std else ():
            if e.of.name == "pressure":
                std = np.abs(e.changes(columns, rows)[1]) * case.bend_std / abs(e.bend)
                how = "FEA's band, by the pressure's run"
                sources.append(Source("geometry and material", "input", std, how))
        return sources
    run, _, share_std = seen
    std = np.abs(run.changes(columns, rows)[1]) * share_std
    sources.append(Source("pressure as recorded", "data", std, POSTERIOR))
    law, direct = case.registration.law, case.measured["direct"]
    around = 1 + law.std("stretch") / law.values[2] * np.array([-1.0, 1.0])
    one, other = (of_stretch(direct, lasts).loc[rows, columns] for lasts in around)
    std = np.abs((other - one).mean().to_numpy(float)) / 2
    return [*sources, Source("duration as recorded", "data", std, POSTERIOR)]
