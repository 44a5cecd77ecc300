"""What a recording's motion is due to, where the pressure in the chambers was measured: pressure, structure, flow.

The measured pressure drives a coupled run (docs/coupling.md): where the pressure is as in the scene and that run bends otherwise than
the recording's finger, the structure is wrong. The flow is judged with the recording's own motion (make compare-measured).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import read_loads
from fileio.formats.kinematics import read_kinematics
from fileio.formats.recorded_motion import read_recorded_motion
from fileio.formats.records import LAB_COMPARISON
from postprocess.evidence.stage_files import scene_title
from postprocess.lab.data.dpiv_toml import NAME, Dpiv
from postprocess.lab.data.files import LabFiles, read_registration
from postprocess.lab.data.inputs_toml import read_inputs
from postprocess.lab.judgement.validation import AGREES, ERROR, LEVEL, UNCERTAIN, coverage_factor
from postprocess.lab.registration.step import fea_band

SCENE = """# Written by postprocess.lab: the scene driven by the pressure that was measured with the recording {name}.
extends = "../../../../.."
title = "{title}"

[motion]
source = "fea"
strokes = []
start_pressure_kpa = 0.0
pressure_csv = "pressure.csv"
"""


def write_scene(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write the scene `pressure/` with the measured history on the simulation's clock; returns its folder."""
    if dpiv.pressure is None:
        raise StageError(
            f"{dpiv.folder / NAME}: says no pressure; give pressure = {{ csv = …, std_kpa = … }}"
        )
    path = dpiv.folder / dpiv.pressure.csv
    try:
        table = pd.read_csv(path, comment="#")[["t", "p"]].astype(float)
    except (OSError, KeyError, ValueError) as error:
        raise StageError(f"{path}: not a table of t,p in s and Pa: {error}") from None
    table["t"] -= read_registration(files.registration).law.delay
    end = read_kinematics(files.stage.required("kinematics.h5", "kinematics")).time[1]
    if len(table) < 3 or table["t"].iloc[0] > 0 or table["t"].iloc[-1] < end:
        raise StageError(
            f"{path}: its times must reach from the motion's begin to its end, {end:g} s later; on the recording's clock the motion"
            " begins where registration.json has its delay"
        )
    folder = files.folder / "pressure"
    title = f"{scene_title(files.stage.scene_folder)}, at the pressure of the recording {dpiv.name}"
    write_text(folder / "pressure.csv", table.to_csv(index=False))
    write_text(folder / "scene.toml", SCENE.format(name=dpiv.name, title=title))
    return folder


def coupled_run(files: LabFiles) -> Path:
    """Output folder of the last coupled run at the level. StageError where there is none."""
    home = files.folder / "pressure" / "out" / "coupled"
    level = files.stage.level
    runs = [path.parent for path in home.glob(f"{level}_*/out/{level}/loads.h5")]
    if not runs:
        raise StageError(f"{home}: holds no coupled run of level {level}; make compare-coupled solves it")
    return max(runs, key=lambda out: int(out.parts[-3].rpartition("_")[2]))


def _row(cause: str, differs: str, value: float, std: float, limit: float) -> dict[str, str | float]:
    """`differs`: the word where `value` is beyond what `std` explains; `limit`: what must not stay hidden."""
    band = coverage_factor(1, LEVEL) * std
    word = differs if value > band else UNCERTAIN if band > limit else AGREES
    return {"cause": cause, "verdict": word, "difference": value, "band": band}


def causes(files: LabFiles, dpiv: Dpiv) -> pd.DataFrame:
    """Pressure (Pa), structure (rad) and flow, each with a verdict; also written as causes.csv.

    Differences are RMS over the recording. The structure's band holds the silhouette's scatter and turn, the pressure's
    uncertainty, the FEA's band, and the last change of the coupled motion.
    """
    if dpiv.pressure is None:
        raise StageError(
            f"{dpiv.folder / NAME}: says no pressure; give pressure = {{ csv = …, std_kpa = … }}"
        )
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    registration, recorded = read_registration(files.registration), read_recorded_motion(files.motion)
    part = read_inputs(files.stage.scene_folder / "reference" / "inputs.toml").too_uncertain
    table = pd.read_csv(files.folder / "pressure" / "pressure.csv")
    time = np.linspace(*kinematics.time, 401)
    nominal, measured = kinematics.law(time), np.interp(time, table["t"], table["p"])
    std, change = 1e3 * dpiv.pressure.std_kpa, float(np.ptp(nominal))
    rows = [_row("pressure", "differs", _rms(measured - nominal), std, part * change)]

    out = coupled_run(files)
    loads = read_loads(out / "loads.h5")
    seen = recorded["seen"].values
    shown = (seen >= 0) & (seen <= kinematics.time[1])
    at, bend = seen[shown], recorded["seen_bend"].values[shown]
    modelled = np.interp(at, loads["step"], loads["bend"])
    stroke = float(np.ptp(kinematics.bend(nominal)))
    last = float(read_elastic_motion(out.parents[1] / "elastic_motion.h5").attrs["bend_change"])
    sources = [
        _rms(bend - np.interp(at, recorded["time"], recorded["bend"])),
        float(np.sqrt(registration.covariance[2, 2])),
        stroke / change * std,
        fea_band(files, dpiv)[1] if dpiv.finger_geometry == "nominal" else 0.0,
        last if np.isfinite(last) else 0.0,
    ]
    rows.append(
        _row("structure", ERROR, _rms(modelled - bend), float(np.hypot.reduce(sources)), part * stroke)
    )

    judged = files.folder / "measured" / "out" / files.stage.level / "lab" / dpiv.name / "comparison.json"
    flow = LAB_COMPARISON.read(judged)["flow"] if judged.exists() else "not judged"
    rows.append({"cause": "flow", "verdict": flow, "difference": np.nan, "band": np.nan})
    result = pd.DataFrame(rows)
    write_text(files.folder / "causes.csv", result.to_csv(index=False))
    return result


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def sentences(table: pd.DataFrame) -> list[str]:
    """The three verdicts in words."""
    rows = table.set_index("cause")
    pressure, structure, flow = (rows.loc[name] for name in ("pressure", "structure", "flow"))
    kpa, deg = 1e-3, float(np.degrees(1.0))
    words = {
        AGREES: "as in the scene",
        "differs": "otherwise than in the scene",
        UNCERTAIN: "too uncertain to tell",
    }
    moves = {
        AGREES: "moves as the recording's",
        ERROR: "moves otherwise than the recording's",
        UNCERTAIN: "cannot be told from the recording's",
    }
    return [
        f"pressure: {words[pressure.verdict]}: {kpa * pressure.difference:.2f} kPa apart (RMS), known to ± {kpa * pressure.band:.2f}",
        f"structure: at the measured pressure the coupled finger {moves[structure.verdict]}: {deg * structure.difference:.1f}° apart"
        f" (RMS), known to ± {deg * structure.band:.1f}",
        f"flow: {flow.verdict}"
        + (
            " (make compare-measured judges it)"
            if flow.verdict == "not judged"
            else ", with the recording's own motion"
        ),
    ]
