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
from postprocess.lab.judgement.validation import (
    AGREES,
    ERROR,
    UNCERTAIN,
    Source,
    ValidatedQuantity,
    coverage_factor,
)
from postprocess.lab.registration.step import fea_band

PRESSURE_STEP = 2e-3  # s, of the history that drives the coupled run
NOT_JUDGED = "not judged"
MODELLED = "modelled.h5"
AFTER = "after.h5"  # of pipeline couple: the motion that the last run's loads make
BEND_STEP = np.radians(1.0)  # between two shapes of it, at least
MARGIN = (
    0.03  # of its range: shapes beyond the motion, where it swings back or its spline overshoots
)
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


def coupled_home(files: LabFiles) -> Path:
    """Folder of the coupled runs at the measured pressure."""
    return files.folder / "pressure" / "out" / "coupled"


def write_scene(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write the scene `pressure/` with the measured history on the simulation's clock, without its noise; returns its folder.

    What the last step needs is asked for here, before anything is solved.
    """
    pressure, start = _measured(dpiv)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    _scene_knows(files, dpiv, kinematics)
    path = dpiv.folder / pressure.csv
    try:
        table = pd.read_csv(path, comment="#")[["t", "p"]].astype(float)
        smooth = make_smoothing_spline(
            table["t"] + start.at_s, table["p"]
        )  # by generalised cross-validation
    except (OSError, KeyError, ValueError) as error:
        raise StageError(f"{path}: not a table of t,p in s and Pa: {error}") from None
    begin, end = float(table["t"].iloc[0] + start.at_s), float(table["t"].iloc[-1] + start.at_s)
    last = kinematics.time[1]
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
    home, level = coupled_home(files), files.stage.level
    runs = [path.parent for path in home.glob(f"{level}_*/out/{level}/loads.h5")]
    if not runs:
        raise StageError(
            f"{home}: holds no coupled run of level {level}; make compare-coupled solves it"
        )
    return max(runs, key=lambda out: int(out.parts[-3].rpartition("_")[2]))


def left_to_change(out: Path, times: np.ndarray) -> np.ndarray:
    """Bend angle (instant,) rad by which the loads of a coupled run still change its motion, at times (s). StageError."""
    folder = out.parents[1]
    if not (folder / AFTER).exists():
        raise StageError(
            f"{folder}: holds no {AFTER}, so what another run would change is not known; make compare-coupled again"
        )
    own, after = (read_elastic_motion(folder / name) for name in ("elastic_motion.h5", AFTER))
    change = after["delta"].values[:, -1] - own["delta"].values[:, -1]
    return np.asarray(np.interp(times, own["time"].values, change))


def write_modelled(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write the motion of the coupled run as that of a recording, modelled.h5, and the scene `modelled/`; returns its folder.

    Its shapes are those of the way to the largest bend, one for each bend angle; pressures are those at which the scene's own finger
    bends as much, and stand for the bend alone.
    """
    pressure, _ = _measured(dpiv)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    out = coupled_run(files)
    loads, shapes = (
        read_loads(out / "loads.h5"),
        read_elastic_motion(out.parents[1] / "elastic_motion.h5"),
    )
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
    still = {
        "seen": time,
        "seen_bend": bend,
        "seen_radius": np.inf + time,
        "seen_residual": 0 * time,
    }
    law = {
        "time": time,
        "pressure": kinematics.pressure_of_bend(bend),
        "bend": bend,
        "state_pressure": wide,
    }
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


def _row(
    cause: str, differs: str, value: float, sources: dict[str, float], scale: float, part: float
) -> dict[str, str | float]:
    """The verdict on a difference (RMS) by its sources of uncertainty; `differs`: the word where it is beyond them.

    An error of a `part` of the `scale` must not stay hidden.
    """
    one = lambda v: np.array([v])  # noqa: E731
    known = [Source(name, "data", one(std), "") for name, std in sources.items()]
    judged = ValidatedQuantity(cause, cause, "", one(value), one(value), one(0.0), scale, known)
    word = judged.verdict(part)
    return {
        "cause": cause,
        "verdict": differs if word == ERROR else word,
        "difference": value,
        "band": coverage_factor(1) * float(judged.u_val[0]),
        "detectable": judged.detectable(),
        "dominant": judged.dominant.name,
    }


def causes(files: LabFiles, dpiv: Dpiv) -> pd.DataFrame:
    """Pressure (Pa), structure (rad) and flow, each with a verdict; also written as causes.csv.

    Differences are RMS over the recording. The pressure's band holds its own uncertainty and that of the clock; the structure's the
    silhouette's scatter and turn, the pressure's uncertainty, the FEA's bands, and what another coupled run would change.
    """
    pressure, start = _measured(dpiv)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    part, bands = _scene_knows(files, dpiv, kinematics)
    table = pd.read_csv(files.folder / "pressure" / "pressure.csv")
    time = np.linspace(*kinematics.time, 401)
    nominal, measured = kinematics.law(time), np.interp(time, table["t"], table["p"])
    std, change = 1e3 * pressure.std_kpa, float(np.ptp(nominal))
    clock = start.std_s * _rms(np.gradient(measured, time))
    known = {"pressure": std, "clock": clock}
    rows = [_row("pressure", "differs", _rms(measured - nominal), known, change, part)]

    out, modelled = coupled_run(files), files.of_scene("modelled")
    loads, registration = read_loads(out / "loads.h5"), read_registration(modelled.registration)
    shapes = read_kinematics(modelled.stage.required("kinematics.h5", "kinematics"))
    seen = registration.times + start.at_s
    shown = (seen >= 0) & (seen <= kinematics.time[1])
    pressures, scatter = registration.pressures[shown], registration.pressures_std[shown]
    bend = shapes.bend(pressures)
    computed = np.interp(seen[shown], loads["step"], loads["bend"])
    stroke = float(np.ptp(kinematics.bend(nominal)))
    sources = {
        "silhouette": _rms(
            0.5 * (shapes.bend(pressures + scatter) - shapes.bend(pressures - scatter))
        ),
        "turn": float(np.sqrt(registration.covariance[2, 2])),
        "pressure": stroke / change * std,
        "coupling": _rms(left_to_change(out, seen[shown])),
    }
    if bands is not None:
        turned = _rms(loads["bend"].values - loads["bend_unloaded"].values)
        sources |= {"shape": bands[0], "stiffness": turned * bands[1]}
    rows.append(_row("structure", ERROR, _rms(computed - bend), sources, stroke, part))
    judged = (_flow(of, dpiv) for of in (modelled, files))
    flow = next((word for word in judged if word != NOT_JUDGED), NOT_JUDGED)
    rows.append({"cause": "flow", "verdict": flow})
    result = pd.DataFrame(rows)
    write_text(files.folder / "causes.csv", result.to_csv(index=False))
    return result


def _scene_knows(
    files: LabFiles, dpiv: Dpiv, kinematics: Kinematics
) -> tuple[float, tuple[float, float] | None]:
    """What of a quantity must not stay hidden, and where the geometry is nominal the FEA's bands of bend (rad) and stiffness (1).

    FileNotFoundError or StageError where the scene does not say it.
    """
    part = read_inputs(files.stage.scene_folder / "reference" / "inputs.toml").too_uncertain
    if dpiv.finger_geometry != "nominal":
        return part, None
    return part, (fea_band(files, dpiv)[1], _stiffness_band(files, kinematics))


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
    if (
        not (compared.exists() and files.motion.exists())
        or compared.stat().st_mtime < moved.stat().st_mtime
    ):
        return NOT_JUDGED
    driven_by = read_kinematics(moved).settings["files"].values()
    made = LAB_COMPARISON.read(compared)
    same = made["provenance"]["dpiv_sha256"] == sha256(dpiv.folder / NAME)
    return str(made["flow"]) if same and sha256(files.motion)[:16] in driven_by else NOT_JUDGED


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def sentences(table: pd.DataFrame, files: LabFiles, dpiv: Dpiv) -> list[str]:
    """The three verdicts in words, and what judges the flow where nothing has."""
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
        f"pressure: {words[pressure.verdict]}: {kpa * pressure.difference:.2f} kPa apart (RMS), known to ± {kpa * pressure.band:.2f};"
        f" an error above {kpa * pressure.detectable:.2f} would be found",
        f"structure: at the measured pressure the coupled finger {moves[structure.verdict]}: {deg * structure.difference:.1f}° apart"
        f" (RMS), known to ± {deg * structure.band:.1f}, mostly by the {structure.dominant}; an error above"
        f" {deg * structure.detectable:.1f} would be found",
        f"flow: {flow.verdict}"
        + (
            f"; to judge it: {judged_by(files, dpiv)}"
            if flow.verdict == NOT_JUDGED
            else ", with the recording's own motion"
        ),
    ]


def judged_by(files: LabFiles, dpiv: Dpiv) -> str:
    """The command that judges the flow at the recording's own motion, whose registration is that against the coupled run's."""
    home = files.stage.scene_folder.parent
    scene = files.of_scene("modelled").stage.scene_folder.relative_to(home)
    cases = "" if home == Path("cases") else f"CASES={home} "
    return (
        f"make compare-measured {cases}SCENE={scene} LEVEL={files.stage.level} DPIV={dpiv.folder}"
    )
