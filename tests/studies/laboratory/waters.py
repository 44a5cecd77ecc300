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
from postprocess.lab.judgement.inputs_of_budget import Case
from postprocess.lab.judgement.measures import measure
from postprocess.lab.judgement.motion import final_bend, stroke_duration
from postprocess.lab.judgement.uncertainty_sources import VORTEX, means
from postprocess.lab.judgement.validation import AGREES, DIFFERS, ERROR, FieldComparison
from postprocess.lab.registration.register import fit_law
from postprocess.lab.virtual.virtual_laboratory import SetUp, camera_for
from tests.lab_renderer import Rendered
from tests.studies.laboratory.faults import drawn_faults

PAIRS_HZ, INTERVAL = 50.0, 0.002
COLUMNS, SCALE_MM_PER_PX, SCALE_STD = 640, 0.25, 0.003
WATERS = Path(__file__).with_name("waters.toml")
MOVED = ("higher", "lower", "slower", "faster")  # waters whose finger moves otherwise
SAME_MODEL = ("none", "finer", *MOVED)  # waters of the simulation's own equations and fluid
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
        self.settings = VortexSettings(
            **json.loads((out / "settings" / "vortices.json").read_text())
        )
        self.two_dimensional = scene_numbers(StageFiles(case, level))["model"]["kind"] == "2d"
        self._out, self._folder = out, out / "virtual" / "study"
        self.sheet = read_plane(self._folder / "nominal.h5").load()
        self.camera = camera_for(
            self.kinematics.root, COLUMNS, SCALE_MM_PER_PX * 1e-3, 1 / INTERVAL
        )
        self.stated = SetUp(self.camera).pose(self.kinematics.root)
        times = self.sheet["time"].values
        bend = self.sheet["bend"].values[:, 0]
        self.window = stroke_window(times, bend, (0.25, 0.75))
        self.runs = [(one, *self._of(one.name)) for one in self.inputs.all]

    def _of(self, name: str) -> tuple[xr.Dataset, Kinematics]:
        """Flow and motion of a run by the name of its sheet."""
        of_run = Path(name) / "out" / self._out.name / "kinematics.h5"
        places = (self._out / "inputs" / of_run, self._out / "virtual" / of_run)
        moved = next((read_kinematics(path) for path in places if path.exists()), self.kinematics)
        return read_plane(self._folder / f"{name}.h5").load(), moved

    def water(self, kind: str) -> tuple[xr.Dataset, Kinematics]:
        """A water's flow and its finger's motion."""
        return self._of(SHEETS.get(kind, kind))


def recorded(
    lab: Laboratory, kind: str, seed: int, rng: np.random.Generator
) -> tuple[Rendered, Pose, float, list[str]]:
    """A water's recording in pairs, its true pose, the water's time (s) at the first picture, and the recording's faults."""
    root, stated, start = (
        lab.kinematics.root,
        lab.camera.scale_m_per_px,
        float(rng.uniform(0.002, 0.010)),
    )
    faults = [fault for fault in FAULTS if rng.random() < CHANCE]
    scale = (
        stated * (1 + SCALE_STD * rng.standard_normal()) / (TOO_LONG if kind == "larger" else 1.0)
    )
    at = np.asarray(lab.stated.at_px) + rng.uniform(-1e-3, 1e-3, 2) / stated
    true = Pose(scale, float(np.radians(rng.uniform(-2, 2))), root, (float(at[0]), float(at[1])))
    sheet, motion = lab.water(kind)
    end = float(sheet["time"][-1])
    begin = start + np.arange(int((end - start - INTERVAL) * PAIRS_HZ + 1e-6) + 1) / PAIRS_HZ
    times = np.column_stack([begin, begin + INTERVAL]).ravel()
    field = PlaneField(sheet)

    def flow(points: np.ndarray, time: float) -> np.ndarray:
        return (
            np.asarray(field.sample(field.at(time), points[:, 0], points[:, 1]))
            .reshape(4, -1)[:2]
            .T
        )

    shape = lab.camera.height_px, lab.camera.width_px
    drawn = drawn_faults(faults, rng)
    pictures = Rendered(
        motion, true, motion.law(times), shape, drawn, flow=flow, times=times, seed=seed
    )
    return pictures, true, start, faults


def true_errors(
    lab: Laboratory,
    kind: str,
    case: Case,
    field: FieldComparison,
    rows: np.ndarray,
    true: Pose,
    start: float,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """S − D of every quantity (SI, as of `compare`) and the model's part of it, without any measurement; the motion's law.

    The water itself at the true instants through the true camera, and the simulation at the same; `rows`: the instants compared;
    `start`: the water's time (s) at the first picture. Where the finger moves otherwise, or the water has finer cells, none
    of it is the flow model's. The finer runs' change is in S − D, and no part of the model's.
    """
    (sheet, motion), kinematics = lab.water(kind), lab.kinematics
    along = np.linspace(*kinematics.time, 201)
    law, _, _ = fit_law(kinematics, along, motion.law(along), np.array([1.0, 0.0, 1.0]))
    of_data = case.data["time"].values + case.registration.law.delay + start
    values, planes = {}, {}
    for name, of, at in (("water", sheet, of_data), ("right", lab.sheet, of_data - law[1])):
        plane = camera_series(of, true, case.data["x"].values, case.data["y"].values, at)
        window = float(at[0]) - 1e-6, float(at[-1]) + 1e-6
        table = measure(plane, true, lab.settings, window, name, case.seen())
        values[name] = means(table, np.isin(np.arange(at.size), rows), window)
        planes[name] = np.stack([plane[n].values for n in ("u", "v")], axis=1)[rows]
    apart = np.where(np.isfinite(field.error), planes["right"] - planes["water"], np.nan)
    model = {
        name: (values["right"] - values["water"])[list(columns)].to_numpy(float)
        for name, (columns, _, _) in VORTEX.items()
    }
    difference = {
        name: v + sum(e.moves(VORTEX[name][0]) for e in case.finer) for name, v in model.items()
    }
    model["velocity_field"] = np.array([np.sqrt(np.nanmean(np.sum(apart**2, axis=1)))])
    of_model = {name: np.zeros_like(v) if kind in SAME_MODEL else v for name, v in model.items()}
    moves = {
        "final_bend": np.array(
            [final_bend(kinematics, 1.0) - final_bend(kinematics, float(law[0]))]
        ),
        "duration": np.array([stroke_duration(kinematics) * (1 - float(law[2]))]),
    }
    return difference | moves, of_model | moves, law


def missed(result: dict[str, Any], of_model: dict[str, np.ndarray]) -> list[str]:
    """Quantities that are said to agree though the model's true error is larger than what the page says it would have shown."""
    return [
        q["name"]
        for q in result["quantities"]
        if q["joint_verdict"] == AGREES and np.linalg.norm(of_model[q["name"]]) > q["detectable"]
    ]


def rightly_refused(kind: str, faults: list[str], refused: str) -> bool:
    """Whether a recording had a reason to be refused: a fault, whichever the sentence names, or a finger of another length, named."""
    return bool(faults) or (kind == "larger" and "the finger's length" in refused)


def rightly_judged(kind: str, result: dict[str, Any], told: str, missed: list[str]) -> bool:
    """Whether an accepted recording's answers are right: the motion differs where it does and nowhere else, the flow model is blamed
    only where it differs, and nothing is `missed`. That nothing can be said of the flow is not wrong."""
    if missed or kind == "larger":
        return False
    moves, flow = result["motion"] in (ERROR, DIFFERS), result["flow"]
    if kind in SAME_MODEL:
        return moves == (kind in MOVED) and flow != ERROR
    return not moves and (flow != ERROR or "the flow model is to blame" in told)
