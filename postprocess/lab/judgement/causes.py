"""What a recording's motion is due to, where the pressure in the chambers was measured: pressure, structure, flow.

The measured pressure drives a coupled run (docs/coupling.md), and that run's motion is what the recording is registered against and
held beside: where the two differ, the structure is wrong. (The scene's own motion would not do: the registration refuses a finger that
water bends otherwise.) The flow is judged with the recording's own motion (make compare-measured). The clock is the stated one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline, make_smoothing_spline

from fileio.atomic import write_text
from fileio.checksum import sha256
from fileio.errors import StageError
from fileio.formats.bending_states import read
from fileio.formats.elastic_motion import read_elastic_motion
from fileio.formats.finger_loads import read_loads
from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.recorded_motion import write_recorded_motion
from fileio.formats.records import LAB_COMPARISON
from fileio.key_reference import toml_value
from postprocess.evidence.stage_files import scene_title
from postprocess.lab.data.dpiv_toml import NAME, ChamberPressure, Dpiv, Start
from postprocess.lab.data.files import LabFiles, read_registration
from postprocess.lab.data.inputs_toml import read_inputs
from postprocess.lab.judgement.recorded_motion import write_moved_scene
from postprocess.lab.judgement.validation import AGREES, ERROR, LEVEL, UNCERTAIN, coverage_factor
from postprocess.lab.registration.step import fea_band

PRESSURE_STEP = 2e-3  # s, of the history that drives the coupled run
NOT_JUDGED = "not judged"
MODELLED = "modelled.h5"
BEND_STEP = np.radians(1.0)  # between two shapes of it, at least
MARGIN = 0.03  # of its range: shapes beyond the motion, where it swings back or its spline overshoots
SCENE = """# Written by postprocess.lab: the scene driven by the pressure that was measured with the recording {name}.
extends = "../../../../.."
title = {title}

[motion]
source = "fea"
strokes = []
start_pressure_kpa = 0.0
pressure_csv = "pressure.csv"
"""


def _measured(dpiv: Dpiv) -> tuple[ChamberPressure, Start]:
    """What dpiv.toml says of the pressure and of the clock. StageError where it says nothing, and of vectors."""
    if dpiv.kind != "pictures":
        raise StageError(
            f"{dpiv.folder / NAME}: vectors do not show the finger; make compare-coupled takes pictures"
        )
    if dpiv.pressure is None or not isinstance(dpiv.start, Start):
        raise StageError(
            f"{dpiv.folder / NAME}: says no pressure; give pressure = {{ csv = …, std_kpa = … }}"
        )
    return dpiv.pressure, dpiv.start


def write_scene(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write the scene `pressure/` with the measured history on the simulation's clock, without its noise; returns its folder."""
    pressure, start = _measured(dpiv)
    path = dpiv.folder / pressure.csv
    try:
        table = pd.read_csv(path, comment="#")[["t", "p"]].astype(float)
        smooth = make_smoothing_spline(table["t"] + start.at_s, table["p"])  # by generalised cross-validation
    except (OSError, KeyError, ValueError) as error:
        raise StageError(f"{path}: not a table of t,p in s and Pa: {error}") from None
    begin, end = float(table["t"].iloc[0] + start.at_s), float(table["t"].iloc[-1] + start.at_s)
    last = read_kinematics(files.stage.required("kinematics.h5", "kinematics")).time[1]
    if begin > 0 or end < last:
        raise StageError(
            f"{path}: its times must reach from {-start.at_s:g} s, where the motion begins on the recording's clock (start in"
            f" {NAME}), to {last - start.at_s:g} s, where it ends"
        )
    time = np.arange(begin, end, PRESSURE_STEP)
    folder = files.folder / "pressure"
    title = toml_value(
        f"{scene_title(files.stage.scene_folder)}, at the pressure of the recording {dpiv.name}"
    )
    history = pd.DataFrame({"t": time, "p": smooth(time)})
    write_text(folder / "pressure.csv", history.to_csv(index=False, float_format="%.9g"))
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


def write_modelled(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write the motion of the coupled run as that of a recording, modelled.h5, and the scene `modelled/`; returns its folder.

    Its shapes are those of the way to the largest bend, one for each bend angle; pressures are those at which the scene's own finger
    bends as much, and stand for the bend alone.
    """
    pressure, _ = _measured(dpiv)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    out = coupled_run(files)
    loads, shapes = read_loads(out / "loads.h5"), read_elastic_motion(out.parents[1] / "elastic_motion.h5")
    time, bend = loads["step"].values, loads["bend"].values
    at_knot = np.interp(shapes["knot"], time, bend)
    way = np.abs(at_knot - at_knot[0])
    chosen = [0]
    for k in range(1, int(np.argmax(way)) + 1):
        if way[k] - way[chosen[-1]] > BEND_STEP:
            chosen.append(k)
    chosen.sort(key=lambda k: at_knot[k])
    parameter = kinematics.pressure_of_bend(at_knot[chosen])
    margin = MARGIN * (parameter[-1] - parameter[0])
    wide = np.concatenate([[parameter[0] - margin], parameter[1:-1], [parameter[-1] + margin]])
    profiles = {
        name: make_interp_spline(parameter, shapes[name].values[chosen], k=1)(wide)
        for name in ("profile_x", "profile_y", "thickness")
    }
    still = {"seen": time, "seen_bend": bend, "seen_radius": np.inf + time, "seen_residual": 0 * time}
    law = {"time": time, "pressure": kinematics.pressure_of_bend(bend), "bend": bend, "state_pressure": wide}
    about = {
        "recording": f"coupled run at the pressure of {dpiv.title}",
        "dpiv_sha256": "",
        "registration": "{}",
    }
    write_recorded_motion(files.folder / MODELLED, law | profiles | still | about)
    factor_std = 1e3 * pressure.std_kpa / float(np.ptp(kinematics.law(np.array(kinematics.time))))
    words = f"moved as a coupled run at the pressure of the recording {dpiv.name}"
    reason = "Uncertainty of the pressure in the chambers"
    return write_moved_scene(files, dpiv, "modelled", words, MODELLED, factor_std, reason)


def _row(cause: str, differs: str, value: float, std: float, limit: float) -> dict[str, str | float]:
    """`differs`: the word where `value` is beyond what `std` explains; `limit`: what must not stay hidden."""
    band = coverage_factor(1, LEVEL) * std
    word = differs if value > band else UNCERTAIN if band > limit else AGREES
    return {"cause": cause, "verdict": word, "difference": value, "band": band}


def causes(files: LabFiles, dpiv: Dpiv) -> pd.DataFrame:
    """Pressure (Pa), structure (rad) and flow, each with a verdict; also written as causes.csv.

    Differences are RMS over the recording. The pressure's band holds its own uncertainty and that of the clock; the structure's the
    silhouette's scatter and turn, the pressure's uncertainty, the FEA's bands, and the last change of the coupled motion.
    """
    pressure, start = _measured(dpiv)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    part = read_inputs(files.stage.scene_folder / "reference" / "inputs.toml").too_uncertain
    table = pd.read_csv(files.folder / "pressure" / "pressure.csv")
    time = np.linspace(*kinematics.time, 401)
    nominal, measured = kinematics.law(time), np.interp(time, table["t"], table["p"])
    std, change = 1e3 * pressure.std_kpa, float(np.ptp(nominal))
    clock = start.std_s * _rms(np.gradient(measured, time))
    rows = [_row("pressure", "differs", _rms(measured - nominal), float(np.hypot(std, clock)), part * change)]

    out, modelled = coupled_run(files), files.of_scene("modelled")
    loads, registration = read_loads(out / "loads.h5"), read_registration(modelled.registration)
    shapes = read_kinematics(modelled.stage.required("kinematics.h5", "kinematics"))
    seen = registration.times + start.at_s
    shown = (seen >= 0) & (seen <= kinematics.time[1])
    pressures, scatter = registration.pressures[shown], registration.pressures_std[shown]
    bend = shapes.bend(pressures)
    computed = np.interp(seen[shown], loads["step"], loads["bend"])
    stroke = float(np.ptp(kinematics.bend(nominal)))
    last = float(read_elastic_motion(out.parents[1] / "elastic_motion.h5").attrs["bend_change"])
    sources = [
        _rms(0.5 * (shapes.bend(pressures + scatter) - shapes.bend(pressures - scatter))),
        float(np.sqrt(registration.covariance[2, 2])),
        stroke / change * std,
        last if np.isfinite(last) else 0.0,
    ]
    if dpiv.finger_geometry == "nominal":
        turned = _rms(loads["bend"].values - loads["bend_unloaded"].values)
        sources += [fea_band(files, dpiv)[1], turned * _stiffness_band(files, kinematics)]
    rows.append(
        _row("structure", ERROR, _rms(computed - bend), float(np.hypot.reduce(sources)), part * stroke)
    )
    judged = (_flow(of, dpiv) for of in (modelled, files))
    flow = next((word for word in judged if word != NOT_JUDGED), NOT_JUDGED)
    rows.append({"cause": "flow", "verdict": flow, "difference": np.nan, "band": np.nan})
    result = pd.DataFrame(rows)
    write_text(files.folder / "causes.csv", result.to_csv(index=False))
    return result


def _stiffness_band(files: LabFiles, kinematics: Kinematics) -> float:
    """Standard uncertainty of the bending stiffness over its value, at the scene's pressures. StageError where it is not known."""
    path = files.stage.scene_folder / str(kinematics.settings["motion"]["states"])
    states = read(path)
    law = states.law
    if law is None or law.stiffness_std is None:
        raise StageError(
            f"{path}: carries no bending_stiffness_std, so the band of the stiffness is not known; run make fea, or state"
            f' finger_geometry = "measured" in {NAME}'
        )
    pressure = kinematics.data["pressure"].values
    return _rms(np.asarray(np.interp(pressure, states.pressure, law.stiffness_std / law.stiffness)))


def _flow(files: LabFiles, dpiv: Dpiv) -> str:
    """The verdict of compare-measured where it is of this motion.h5 and of this dpiv.toml."""
    measured = files.of_scene("measured")
    moved, compared = measured.stage.out / "kinematics.h5", measured.comparison
    if not (compared.exists() and files.motion.exists()) or compared.stat().st_mtime < moved.stat().st_mtime:
        return NOT_JUDGED
    driven_by = read_kinematics(moved).settings["files"].values()
    made = LAB_COMPARISON.read(compared)
    same = made["provenance"]["dpiv_sha256"] == sha256(dpiv.folder / NAME)
    return str(made["flow"]) if same and sha256(files.motion)[:16] in driven_by else NOT_JUDGED


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
            if flow.verdict == NOT_JUDGED
            else ", with the recording's own motion"
        ),
    ]
