"""Files of one comparison, `cases/<scene>/out/<level>/lab/<name>/`, and its registration."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fileio.formats.records import REGISTRATION
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.pose import Pose


class LabFiles:
    """Paths of a scene's comparison with one laboratory's data; `stage`: the scene's files."""

    def __init__(self, stage: StageFiles, name: str) -> None:
        self.stage, self.folder = stage, stage.out / "lab" / name
        self.registration = self.folder / "registration.json"
        self.refused = self.folder / "registration_refused.png"  # where the outline does not fit
        self.comparison = self.folder / "comparison.json"

    def side(self, name: str) -> Path:
        """Plane series of one side: data, virtual or direct."""
        return self.folder / f"{name}.h5"


LAW = ("factor", "delay", "stretch")


@dataclass(frozen=True)
class Law:
    """The recording's motion relative to the simulation's.

    `values`: (factor, delay s, stretch), with their covariance; `misfit`: RMS residual (Pa).
    """

    values: np.ndarray
    covariance: np.ndarray
    misfit: float

    @property
    def delay(self) -> float:
        """Clock of the recording minus that of the simulation, s."""
        return float(self.values[1])

    def std(self, name: str) -> float:
        """Standard uncertainty of factor, delay or stretch."""
        return float(np.sqrt(self.covariance[LAW.index(name), LAW.index(name)]))


@dataclass(frozen=True)
class Registration:
    """Pose of the tank frame in the pictures, and the law of motion.

    `covariance`: of (x px, y px, angle, ln magnification). `growth` (px): of the outline, as it is
    seen. `pressures` and `pressures_std`
    (frame,) Pa: what each frame at `times` (s of the recording's clock) shows by itself. `view`:
    x0, x1, y0, y1 (m) of the tank around what is seen.
    """

    pose: Pose
    covariance: np.ndarray
    growth: float
    law: Law
    times: np.ndarray
    pressures: np.ndarray
    pressures_std: np.ndarray
    stated: Pose
    view: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def write_registration(registration: Registration, path: Path, **more: Any) -> None:
    """registration.json (docs/formats.md)."""
    REGISTRATION.write(path, asdict(registration) | more)


def read_registration(path: Path) -> Registration:
    """The registration of a file; FileNotFoundError or ValueError in one sentence."""
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing; run make compare first")
    whole = REGISTRATION.read(path)
    law = whole["law"]
    return Registration(
        _pose(whole["pose"]),
        np.array(whole["covariance"]),
        whole["growth"],
        Law(np.array(law["values"]), np.array(law["covariance"]), float(law["misfit"])),
        np.array(whole["times"]),
        np.array(whole["pressures"]),
        np.array(whole["pressures_std"]),
        _pose(whole["stated"]),
        tuple(whole["view"]),
    )


def _pose(values: dict[str, Any]) -> Pose:
    return Pose(**values | {name: tuple(values[name]) for name in ("anchor", "at_px")})
