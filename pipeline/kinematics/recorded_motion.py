"""The motion of a finger in a recording (motion.h5, docs/formats.md), as a pressure law."""

from pathlib import Path

import numpy as np

from pipeline.formats.recorded_motion import SCHEMA, read_recorded_motion
from pipeline.kinematics.pressure_law import PressureLaw, history_law
from piv.files.errors import StageError


def recorded_law(path: Path, factor: float) -> PressureLaw:
    """Pressure (Pa) of the recorded bend, its change times `factor`; StageError."""
    file = read_recorded_motion(path)
    time, pressure = file["time"].values, file["pressure"].values
    if time.size < 3:
        raise StageError(f"{path}: needs at least three instants; {SCHEMA.remedy}")
    if not np.all(np.diff(time) > 0):
        raise StageError(f"{path}: times must increase; {SCHEMA.remedy}")
    return history_law(time, pressure[0] + factor * (pressure - pressure[0]))
