"""The tables and JSON records that stages leave behind (docs/formats.md): columns, formats and versions."""

from __future__ import annotations

from fileio.schema import JsonFormat, Table

AGAIN = "delete it and run make again"
RUN = JsonFormat("run", 4, AGAIN)
COMPARISON = JsonFormat("comparison", 1, AGAIN)
LAB_COMPARISON = JsonFormat("lab-comparison", 6, "run make compare again")
REGISTRATION = JsonFormat("registration", 3, "run python -m postprocess.lab register again")
STUDY_PLAN = JsonFormat("study-plan", 4, "run the study again")
OUTCOME = JsonFormat("outcome", 1, "delete it and run the study again")
COST = JsonFormat("cost", 1, "delete it: it is written when the stage is made again")
FIGURES = JsonFormat("figures", 1, "run the stage 'figures' again")
RECORDS = (RUN, COMPARISON, LAB_COMPARISON, REGISTRATION, STUDY_PLAN, OUTCOME, COST, FIGURES)

FORCES = Table(
    ("time", "fx", "fy", "fz", "fx_pressure", "fy_pressure", "fx_viscous", "fy_viscous"), AGAIN
)
POWER = Table(("time", "finger_power", "kinetic_energy", "dissipation"), AGAIN)
LOSSES = ("viscous", "convection", "coupling")  # what takes energy from the flow
REGIONS = ("wall", "edge", "wake")
POWER_TERMS = Table(
    ("time", *LOSSES, *(f"{loss}_{region}" for loss in LOSSES for region in REGIONS)), AGAIN
)
HISTORY = Table(
    ("time", "courant_mean", "courant_max", "continuity_local", "continuity_global", "pressure_iterations", "wall_time"),
    AGAIN,
)  # fmt: skip
MESH_QUALITY = Table(
    ("interval", "mesh", "time_share", "bend_deg", "shape_parameter", "max_non_orthogonality_deg",
     "mean_non_orthogonality_deg", "max_skewness", "min_area_ratio"),
    AGAIN, digits=6,
)  # fmt: skip
TABLES = {
    "forces.csv": FORCES,
    "power.csv": POWER,
    "power_terms.csv": POWER_TERMS,
    "history.csv": HISTORY,
    "mesh_quality.csv": MESH_QUALITY,
}
