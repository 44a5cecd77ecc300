"""Waters with known differences from the simulation, their recordings by the tests' own renderer, and what is right to say of each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.plane_series import read_plane
from piv.synthetic.plane_spline import PlaneField
from piv.vortices.find import VortexSettings
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.evidence.strokes import stroke_window
from postprocess.lab.data.inputs_toml import Inputs, read_inputs
from postprocess.lab.data.pose import Pose, camera_series
from postprocess.lab.judgement.inputs_of_budget import Case, Effect
from postprocess.lab.judgement.measures import measure
from postprocess.lab.judgement.uncertainty_sources import effect_of
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for
from tests.lab_renderer import Rendered
from tests.studies.laboratory.faults import drawn_faults

PAIRS_HZ, INTERVAL = 50.0, 0.002
COLUMNS, SCALE_MM_PER_PX, SCALE_STD = 640, 0.25, 0.003
WATERS = Path(__file__).with_name("waters.toml")
MOVED = ("higher", "lower", "slower", "faster")  # waters whose finger moves otherwise
# runs whose sheets they are taken from; else of the water's own name
SHEETS = {"none": "nominal", "larger": "nominal", "slower": "duration", "finer": "grid"}
SETS = ("none", *MOVED, "viscous", "finer", "larger")
FAULTS, CHANCE = ("shadow", "reflection", "holder", "perspective"), 0.1
TOO_LONG = 1.03


class Laboratory:
    """What all seeds share: the simulation, the waters, and the effects of the runs beside the nominal one."""

    def __init__(self, case: Path, level: str) -> None:
        out = case / "out" / level
        self.kinematics: Kinematics = read_kinematics(out / "kinematics.h5")
        self.inputs: Inputs = read_inputs(case / "reference" / "inputs.toml")
        self.settings = VortexSettings(**json.loads((out / "settings" / "vortices.json").read_text()))
        self.two_dimensional = scene_numbers(StageFiles(case, level))["model"]["kind"] == "2d"
        self._out, self._folder = out, out / "virtual" / "study"
        self.sheet = read_plane(self._folder / "nominal.h5").load()
        self.camera = camera_for(self.kinematics.root, COLUMNS, SCALE_MM_PER_PX * 1e-3, 1 / INTERVAL)
        self.stated = SetUp(self.camera).pose(self.kinematics.root)
        times = self.sheet["time"].values
        bend = self.sheet["bend"].values[:, 0]
        self.window = stroke_window(times, bend, (0.25, 0.75))
        self._effects: list[Effect] = []
        self._runs = [
            (
                one,
                read_plane(self._folder / f"{one.name}.h5").load(),
                self.motion_of(one.name),
            )
            for one in self.inputs.all
        ]

    def motion_of(self, name: str) -> Kinematics:
        """The motion of a run by the name of its sheet."""
        of_run = Path(name) / "out" / self._out.name / "kinematics.h5"
        places = (self._out / "inputs" / of_run, self._out / "virtual" / of_run)
        return next((read_kinematics(path) for path in places if path.exists()), self.kinematics)

    def water(self, kind: str) -> tuple[xr.Dataset, Kinematics]:
        """A water's flow and its finger's motion."""
        name = SHEETS.get(kind, kind)
        return read_plane(self._folder / f"{name}.h5").load(), self.motion_of(name)

    def effects(self, case: Case) -> list[Effect]:
        """Effects of the runs, found at the first trial's pose and instants and used for all: they are differences."""
        if not self._effects:
            direct, pose = case.direct, case.registration.pose
            nominal = measure(direct, pose, self.settings, case.window, "direct", case.seen())
            for one, sheet, kinematics in self._runs:
                plane = camera_series(
                    sheet, pose, direct["x"].values, direct["y"].values, direct["time"].values
                )
                self._effects.append(effect_of(one, plane, kinematics, case, nominal))
        return self._effects


def recorded(
    lab: Laboratory, kind: str, seed: int, rng: np.random.Generator
) -> tuple[Rendered, Pose, float, list[str]]:
    """A water's recording in pairs, its true pose, the water's time (s) at the first picture, and the recording's faults."""
    root, stated, start = lab.kinematics.root, lab.camera.scale_m_per_px, float(rng.uniform(0.002, 0.010))
    faults = [fault for fault in FAULTS if rng.random() < CHANCE]
    scale = stated * (1 + SCALE_STD * rng.standard_normal()) / (TOO_LONG if kind == "larger" else 1.0)
    at = np.asarray(lab.stated.at_px) + rng.uniform(-1e-3, 1e-3, 2) / stated
    true = Pose(scale, float(np.radians(rng.uniform(-2, 2))), root, (float(at[0]), float(at[1])))
    sheet, motion = lab.water(kind)
    end = float(sheet["time"][-1])
    begin = start + np.arange(int((end - start - INTERVAL) * PAIRS_HZ + 1e-6) + 1) / PAIRS_HZ
    times = np.column_stack([begin, begin + INTERVAL]).ravel()
    field = PlaneField(sheet)

    def flow(points: np.ndarray, time: float) -> np.ndarray:
        return np.asarray(field.sample(field.at(time), points[:, 0], points[:, 1])).reshape(4, -1)[:2].T

    shape = lab.camera.height_px, lab.camera.width_px
    drawn = drawn_faults(faults, rng)
    pictures = Rendered(motion, true, motion.law(times), shape, drawn, flow=flow, times=times, seed=seed)
    return pictures, true, start, faults


def rightly_judged(kind: str, result: dict[str, Any], told: str, hidden: bool) -> bool:
    """Whether motion and flow got the right answers and the right one is blamed; `hidden`: no true difference of a quantity that is
    said to agree is larger than what the page says it would have shown."""
    moved = result["motion"] in ("model error", "differs within the inputs")
    if kind in MOVED:
        return moved and "the flow model is to blame" not in told
    if moved or kind == "larger":
        return False
    if kind == "none":
        return result["flow"] != "model error"
    return hidden and (result["flow"] != "model error" or "the flow model is to blame" in told)
