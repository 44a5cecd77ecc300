"""The page of a comparison with a laboratory: its answers in words, its table, its figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.formats.kinematics import Kinematics
from piv.files.atomic import write_bytes, write_text
from piv.formats.plane_series import usable
from postprocess.draw.animation import write_picture
from postprocess.draw.flow import flow_figure, view_limits, vorticity_limit
from postprocess.draw.style import CFD, GREY, LAB, PIV, SHADED, new_figure, save
from postprocess.lab.causes import GREEN, ORANGE, outlined
from postprocess.lab.fit_outline import law_pressure
from postprocess.lab.flow import series
from postprocess.lab.motion import Comparison
from postprocess.lab.pose import Pose
from postprocess.lab.recorded import LabRecording
from postprocess.lab.register import Registration
from postprocess.lab.validation import (
    AGREES,
    DIFFERS,
    ERROR,
    LEVEL_ERROR,
    MOTION,
    TOO_UNCERTAIN,
    UNCERTAIN,
    detectable_factor,
    joint_level,
)
from postprocess.lab.virtual_experiment import Sides
from postprocess.report.page_template import data_uri, page_template
from postprocess.words import NBSP, pair, size

Quantity = dict[str, Any]
WORDS = {
    AGREES: "yes",
    ERROR: "no",
    UNCERTAIN: "undecided",
    DIFFERS: "no, but within what is known of the inputs",
    None: "not tested",
}
SIDES = {  # colour, line and name
    "data": (LAB, "-", "laboratory (DPIV)"),
    "virtual": (PIV, "-", "simulation, seen by the same PIV"),
    "corrected": (PIV, "-", "simulation S: seen by the same PIV, at the recorded motion"),
    "direct": (CFD, ":", "simulation, direct"),
}
K95, PER_CENT = 1.96, f"{NBSP}%"
TELLS = (
    "; whether water makes the difference, COUPLED=1 with the measured pressure"
    " (motion.pressure_csv) tells"
)
WORST = 20  # % of the fastest water: end of the scale of the differences


def make_report(path: Path, title: str, case: Comparison, result: dict[str, Any]) -> Path:
    """Write the page and its figures beside it; those of one recording, of repeats the first."""
    figures = _figures(path.parent / "figures", case, result)
    write_text(path, page(title, result, figures))
    return path


def page(title: str, result: dict[str, Any], pictures: dict[Path, str]) -> str:
    """The page of a comparison; `pictures`: alternative text by file."""
    return page_template("lab.html").render(
        title=title,
        result=result,
        answers=answers(result),
        pair=pair,
        size=size,
        relative=_relative,
        pictures={
            path.stem: (data_uri(path.suffix, path.read_bytes()), alt)
            for path, alt in pictures.items()
        },
        registration=result["registration"],
        too_uncertain=TOO_UNCERTAIN,
        pretty=lambda value: json.dumps(value, indent=1, sort_keys=True),
    )


def _figures(folder: Path, case: Comparison, result: dict[str, Any]) -> dict[Path, str]:
    """Draws all figures; their alternative texts."""
    kinematics, registration, dpiv = case.kinematics, case.registration, case.dpiv
    law, pose, out = registration.law, registration.pose, {}
    tight: dict[str, Any] = {"bbox_inches": "tight"}
    if case.flow is not None:
        circulation = next(q for q in result["quantities"] if q["name"] == "circulation")
        table = series(case)
        path = save(_series(table, circulation), folder / "series.svg", **tight)
        out[path] = "Circulation over time with 95 % bands"
        path = folder / "flow.webp"
        middle = float(np.mean(circulation["window"]))
        write_picture(_flow(case.flow, table, pose, middle), path, quality=85)
        out[path] = "Vectors of the recording beside the simulation's"
        path = save(_difference(case.flow), folder / "difference.png", **tight)
        out[path] = "Difference of the velocities at three instants"
    path = save(_motion(kinematics, registration), folder / "motion.svg", **tight)
    out[path] = "Bend angle over time, simulation and recording"
    if dpiv.kind == "pictures":
        with LabRecording(dpiv) as recording:
            middle_one = len(recording) // 2
            picture, time = recording.frame(middle_one), recording.times[middle_one]
        both = law_pressure(kinematics, time, law.values), kinematics.law(time - law.delay)
        fitted, simulated = (pose.to_px(kinematics.shape("outline", p)) for p in both)
        path = folder / "picture.png"
        write_bytes(path, outlined(picture, [(simulated, ORANGE), (fitted, GREEN)]))
        out[path] = "A picture of the recording with the outline as fitted and as simulated"
    return out


def _series(table: pd.DataFrame, circulation: Quantity) -> Figure:
    """Circulation over time with 95 % bands of each instant on both sides: D and S of the table."""
    figure, ax = new_figure(8.8, 4.4)
    instant, unit, time = circulation["instant"], 1e4, table["time"]
    half = {"data": instant["data"][0], "corrected": instant["simulation"][0], "direct": 0.0}
    for side, std in half.items():
        colour, line, name = SIDES[side]
        values = table[f"circulation_{side}"] * unit
        ax.plot(time, values, line, color=colour, label=name)
        off = K95 * std * unit
        ax.fill_between(time, values - off, values + off, color=colour, alpha=0.2, lw=0)
    ax.axvspan(*circulation["window"], color=SHADED, zorder=0)
    ax.set(xlabel="time of the simulation, s", ylabel="circulation, cm²/s")
    ax.set_title("Tip vortex (shaded: the instants compared); bands hold 95 % of each instant")
    ax.legend(loc="best")
    return figure


def _motion(kinematics: Kinematics, registration: Registration) -> Figure:
    """Bend angle over time: simulation, fitted law, and what single frames show."""
    figure, ax = new_figure(8.8, 3.8)
    law, times = registration.law, np.linspace(*kinematics.time, 200)
    recorded = law_pressure(kinematics, times + law.delay, law.values)
    for at, pressures, line, colour, name in (
        (times, kinematics.law(times), "-", CFD, "simulation"),
        (times, recorded, "-", LAB, "recording, fitted law"),
        (registration.times - law.delay, registration.pressures, ".", GREY, "single pictures"),
    ):
        if at.size:
            ax.plot(at, np.degrees(kinematics.bend(pressures)), line, color=colour, label=name)
    found = f"factor {law.values[0]:.3f}, duration × {law.values[2]:.3f}"
    ax.set(xlabel="time of the simulation, s", ylabel="bend angle, °")
    ax.set_title(f"Motion of the finger ({found})")
    ax.legend(loc="best")
    return figure


def _difference(sides: Sides) -> Figure:
    """|u_S − u_D| over the fastest water of the recording, at a quarter, half and the end."""
    figure, axes = new_figure(8.8, 3.3, 1, 3, sharey=True)
    data, ours, count = sides.data, sides.virtual, sides.data.sizes["time"]
    ok = usable(data).values & usable(ours).values
    apart = np.hypot(*(ours[n].values - data[n].values for n in ("u", "v")))
    x, y = (1e3 * data[n].values for n in ("x", "y"))
    for ax, k in zip(axes, (count // 4, count // 2, count - 1), strict=True):
        values = np.where(ok[k], 100 * apart[k] / _fastest(data), np.nan)
        shade = ax.pcolormesh(x, y, values, vmin=0, vmax=WORST, cmap="YlOrBr", rasterized=True)
        for plane, colour in ((data, LAB), (ours, PIV)):
            for outline in plane["outline"].values[k]:
                ax.plot(*(1e3 * np.vstack([outline, outline[:1]]).T), color=colour, lw=1)
        ax.set(title=f"{data['time'].values[k]:.3f} s", xlabel="x, mm", aspect="equal")
    axes[0].set_ylabel("y, mm")
    figure.colorbar(shade, ax=list(axes), shrink=0.85, label="% of the fastest water", extend="max")
    return figure


def _fastest(plane: Any) -> float:
    return float(np.nanquantile(np.hypot(plane["u"].values, plane["v"].values), 0.999))


def _flow(sides: Sides, table: pd.DataFrame, pose: Pose, time: float) -> np.ndarray:
    """Measured beside simulated vectors at the instant next to `time` (s), (row, column, RGB)."""
    planes, vortices = {}, {}
    for side, plane in (("data", sides.data), ("virtual", sides.virtual)):
        columns = ("circulation", "x", "y", "radius")
        track = table[[f"{name}_{side}" for name in columns]].set_axis(columns, axis=1)
        track = track.assign(time=table["time"], track=0).dropna()
        x, y = pose.to_camera(track[["x", "y"]].to_numpy()).T
        name = SIDES[side][2]
        planes[name], vortices[name] = plane, [track.assign(x=x, y=y)]
    limit, view = vorticity_limit(sides.data, np.array([time])), view_limits(planes, vortices)
    return flow_figure(planes, vortices, _fastest(sides.data), limit, view)(time)


def answer(result: dict[str, Any]) -> str:
    """The page's first sentences, in one line."""
    return " ".join(answers(result))


def answers(result: dict[str, Any]) -> list[str]:
    """The verdicts on motion and flow, their evidence, and what is to blame."""
    motion = [q for q in result["quantities"] if q["name"] in MOTION]
    flow = [q for q in result["quantities"] if q["name"] not in MOTION]
    moves, wrong = result["motion"], [q for q in flow if q["verdict"] == ERROR]
    parts = [f"Motion: {WORDS[moves]}. Flow: {WORDS[result['flow']]}."]
    if moves is None:
        parts.append("Vectors do not show the finger: whether it moved as simulated is not tested.")
    parts += [_evidence(motion, flow), _level(result, flow)]
    if moves in (ERROR, DIFFERS):
        parts.append(_cause_of_motion(moves, result["registration"], result["coupled"]))
    if wrong:
        parts.append(_cause_of_flow(moves, wrong, result["all_water"]))
    lacks = [f"the input {name}" for name in result["not_varied"]]
    if result["level"] not in result["levels"]:
        lacks.append(f"the numerical error of level {result['level']} (softfinger tradeoff)")
    if flow and lacks:
        parts.append(
            f"Not in u_val, because not varied or measured: {', '.join(lacks)}; differences are"
            " judged too strictly, and larger errors than those named could hide."
        )
    return [part for part in parts if part]


def _evidence(*groups: list[Quantity]) -> str:
    """What differs, and by how much, what is undecided, and which errors would have been found."""
    out, found = [], []
    for group in groups:
        wide = [q for q in group if q["verdict"] == UNCERTAIN]
        if differs := [q for q in group if q["verdict"] in (ERROR, DIFFERS)]:
            text = "; ".join(f"{q['label']}: {_off(q)}" for q in differs)
            out.append(f"{text[:1].upper()}{text[1:]}.")
        elif wide:
            text = ", ".join(
                f"{q['label']} (found above {_relative(q)}; the largest uncertainty is"
                f" {q['dominant']})"
                for q in wide
            )
            out.append(f"An error of {100 * TOO_UNCERTAIN:.0f}{PER_CENT} could hide in: {text}.")
        else:
            found += [f"{q['label']} {_relative(q)}" for q in group]
    if found:
        out.append(f"Errors above these would have been found: {', '.join(found)}.")
    return " ".join(out)


def _off(q: Quantity) -> str:
    """How a quantity differs, in words, and how well each side is known."""
    part = f"{100 * np.linalg.norm(q['error']) / abs(q['scale']):.0f}{PER_CENT}"
    if np.size(q["error"]) == 1:  # the sign of a circulation is that of its direction
        part += f" {'more' if q['error'][0] * q['data'][0] > 0 else 'less'} in the simulation"
    off = f"{size(np.abs(q['error']), q['unit'])} ({part})"
    band, seen, inputs = (
        f"±{NBSP}{size(q['k'] * np.asarray(q[u]), q['unit'])}" for u in ("u_val", "u_D", "u_input")
    )
    if q["verdict"] == DIFFERS:
        return (
            f"differs by {off}; the recording knows it to {seen}, and the simulation's inputs allow"
            f" {inputs}"
        )
    what = "the motion differs by" if q["name"] in MOTION else "model error of"
    return f"{what} about {off}, known to {band} (recording {seen}, inputs {inputs})"


def _level(result: dict[str, Any], flow: list[Quantity]) -> str:
    """Which level would decide, where the error of this one hides what is sought."""
    hidden = [q for q in flow if q["verdict"] == UNCERTAIN and q["dominant"] == LEVEL_ERROR]
    if not hidden:
        return ""
    why = "is a plane flow" if result["plane"] else "is too coarse"
    text = f"Level {result['level']} {why}, and its own numerical error hides what is sought"
    factor = detectable_factor(1, joint_level(len(result["quantities"])))
    for level, known in result["levels"].items():
        least = factor * max(known.get(q["name"], np.inf) for q in hidden)
        if least <= TOO_UNCERTAIN and level != result["level"]:
            found = f"errors above {100 * least:.0f}{PER_CENT} would be found"
            return f"{text}: compare at LEVEL={level} or finer ({found})."
    return f"{text}; no level whose error was measured decides it at these instants."


def _cause_of_motion(moves: str, registration: dict[str, Any], coupled: bool) -> str:
    """How the recording's finger moves, and what to correct."""
    factor, stretch = (
        f"{registration[name]:.3f} ±{NBSP}{K95 * registration[f'{name}_std']:.3f}"
        for name in ("pressure_factor", "stretch")
    )
    blame = "The motion is to blame: the" if moves == ERROR else "The"
    another = abs(registration["stretch"] - 1) > K95 * registration["stretch_std"]
    rate = ", or frame_rate_hz of dpiv.toml" if another else ""
    return (
        f"{blame} recording's finger bends as at {factor} times the pressure and takes {stretch}"
        f" times as long. Correct motion.strokes of the scene{rate}{'' if coupled else TELLS}."
    )


def _cause_of_flow(moves: str | None, wrong: list[Quantity], all_water: float | None) -> str:
    """The cause of a flow that differs in the quantities `wrong`."""
    text = (
        "Whether motion or flow model is to blame is not known: what the motion changes needs the"
        " input pressure (inputs.toml, without --no-inputs)."
    )
    if moves is None:
        text = "The flow model is to blame, or a motion other than the simulated one."
    elif moves == AGREES or any(q["moved"] is not None for q in wrong):
        text = "The flow differs at the recording's own motion: the flow model is to blame."
    if all_water is None:
        return text
    return (
        f"All water moves {all_water:.2f} times as fast as the simulation's at every instant: check"
        f" piv.interval_s first. If it is right, {text[:1].lower()}{text[1:]}"
    )


def _relative(q: Quantity) -> str:
    """The smallest error that is found with 95 %, in per cent of the quantity; a place's in mm."""
    if np.size(q["error"]) > 1 or not q["scale"]:
        return size(q["detectable"], q["unit"])
    return f"{100 * q['detectable'] / abs(q['scale']):.0f}{PER_CENT}"
