"""The velocity field's difference and its sources of uncertainty."""

from __future__ import annotations

import numpy as np

from postprocess.lab.judgement.inputs_of_budget import Case, stacked
from postprocess.lab.judgement.validation import FieldComparison


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
    scale = registration.pose.scale_m_per_px
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
