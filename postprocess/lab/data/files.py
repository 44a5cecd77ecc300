"""Files of one comparison, `cases/<scene>/out/<level>/lab/<name>/`: paths, and the registration on disk."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fileio.formats.records import REGISTRATION
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.pose import Pose


class LabFiles:
    """Paths of a scene's comparison with one laboratory's data: `stage`, the scene's files; all else in `folder`."""

    def __init__(self, stage: StageFiles, name: str) -> None:
        self.stage, self.folder = stage, stage.out / "lab" / name
        self.registration = self.folder / "registration.json"
        self.refused = (
            self.folder / "registration_refused.png"
        )  # what did not fit, where it was refused
        self.view = self.folder / "view.txt"  # four numbers: what part of the tank the camera sees
        self.sheet = self.folder / "sheet.h5"  # the simulation's over the camera's view
        self.comparison = self.folder / "comparison.json"
        self.motion = self.folder / "motion.h5"  # the recording's, for motion.source = "recording"

    def of_scene(self, name: str) -> LabFiles:
        """Of the same data's comparison with the scene `name` that lies in `folder`."""
        return LabFiles(StageFiles(self.folder / name, self.stage.level), self.folder.name)

    def run_sheet(self, name: str) -> Path:
        """The sheet of a run beside the nominal one."""
        return self.folder / "inputs" / f"{name}.h5"

    def side(self, name: str) -> Path:
        """Plane series of one side: data, virtual or direct."""
        return self.folder / f"{name}.h5"


def write_registration(registration: Registration, path: Path, **more: Any) -> None:
    """registration.json (docs/formats.md)."""
    REGISTRATION.write(path, asdict(registration) | more)


def read_registration(path: Path) -> Registration:
    """The registration of a file; FileNotFoundError or ValueError in one sentence."""
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing; run python -m postprocess.lab register first")
    whole = REGISTRATION.read(path)
    law = whole["law"]
    return Registration(
        _pose(whole["pose"]),
        np.array(whole["covariance"]),
        Nuisance(np.array(whole["nuisance"]["values"]), np.array(whole["nuisance"]["std"])),
        Law(np.array(law["values"]), np.array(law["covariance"]), float(law["misfit"])),
        np.array(whole["times"]),
        np.array(whole["pressures"]),
        np.array(whole["pressures_std"]),
        _pose(whole["stated"]) if whole["stated"] else None,
    )


def _pose(values: dict[str, Any]) -> Pose:
    return Pose(
        float(values["scale_m_per_px"]),
        float(values["angle"]),
        tuple(values["anchor"]),
        tuple(values["at_px"]),
    )


LAW = ("factor", "delay", "stretch")
NUISANCE = ("edge_px", "lateral_px", "perspective_x", "perspective_y")


@dataclass(frozen=True)
class Nuisance:
    """What the fit takes up beside pose and law, with standard uncertainties, (4,): growth of the outline on all sides and its shift
    to the dorsal side (px), relative change of the magnification along x and y of the tank frame (1/m)."""

    values: np.ndarray
    std: np.ndarray


NO_NUISANCE = Nuisance(np.zeros(len(NUISANCE)), np.zeros(len(NUISANCE)))


@dataclass(frozen=True)
class Law:
    """The recording's motion in terms of the simulation's: (factor, delay s, stretch), covariance, rms misfit (Pa)."""

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
    """Pose of the tank frame in the pictures with the covariance of (x px, y px, angle, ln magnification), and the motion's law.

    `times` (frame,) s of the recording's clock, `pressures` and `pressures_std` (Pa): what each frame shows nearly by itself.
    """

    pose: Pose
    covariance: np.ndarray
    nuisance: Nuisance
    law: Law
    times: np.ndarray
    pressures: np.ndarray
    pressures_std: np.ndarray
    stated: Pose | None
