"""The tables and JSON records that stages leave behind (docs/formats.md)."""

from piv.files.schema import JsonFormat, Table

RUN = JsonFormat("run")
COMPARISON = JsonFormat("comparison")
LAB_COMPARISON = JsonFormat("lab-comparison", "run make compare again")
STUDY_PLAN = JsonFormat("study-plan", "run the study again")
FIGURES = JsonFormat("figures", "run the stage 'figures' again")
RECORDS = (RUN, COMPARISON, LAB_COMPARISON, STUDY_PLAN, FIGURES)

FORCES = Table("time, fx, fy, fz, fx_pressure, fy_pressure, fx_viscous, fy_viscous")
POWER = Table("time, finger_power, kinetic_energy, dissipation")
LOSSES = ("viscous", "convection", "coupling")  # terms that take energy from the flow
POWER_TERMS = Table(", ".join(("time", *LOSSES)))
# Of a current (pipeline/openfoam/through_flow.py): volume by time through both ends, power and
# force along x that act on the water through them, momentum of the water, force on the walls
THROUGH_FLOW = Table("time, inflow, outflow, power, end_force, momentum, wall_force")
HISTORY = Table(
    "time, courant_mean, courant_max, continuity_local, continuity_global, pressure_iterations,"
    " wall_time",
)
MESH_QUALITY = Table(
    "interval, mesh, time_share, bend_deg, shape_parameter, max_non_orthogonality_deg,"
    " mean_non_orthogonality_deg, max_skewness, min_area_ratio",
    digits=6,
)
