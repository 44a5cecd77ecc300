"""Comparison of a scene with a laboratory's recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.formats.kinematics import Kinematics, read_kinematics
from pipeline.formats.records import LAB_COMPARISON, RUN
from pipeline.runs.estimate import duration, estimate
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME
from piv.files.atomic import sha256, write_bytes, write_text
from piv.files.errors import StageError
from piv.files.lock import exclusive
from piv.files.provenance import versions
from piv.formats.plane_series import read_plane
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.check_fit import check_fit, draw_fit
from postprocess.lab.dpiv_toml import NAME, Dpiv, Start, read_dpiv
from postprocess.lab.flow import flow_effects, flow_quantities, tables
from postprocess.lab.inputs_toml import NUMERICS, Finer, Input, read_inputs
from postprocess.lab.load import with_load
from postprocess.lab.motion import (
    Case,
    Effect,
    along_bend,
    at_recorded_motion,
    check_clock,
    difference,
    motion_quantities,
)
from postprocess.lab.recorded import LabRecording, lab_vectors, stated_pose
from postprocess.lab.register import (
    Known,
    Registration,
    register,
    stated_registration,
)
from postprocess.lab.validation import (
    AGREES,
    ValidatedQuantity,
    joint_level,
    judged,
    verdicts,
)
from postprocess.lab.virtual_experiment import both_sides
from postprocess.report.trust import level_error
from softfinger.make import Machine, make, make_sheet

PLANES = 42  # of a run that varies an input: its effect changes slowly
TO_SOLVE = ("kinematics", "mesh", "case", "solve")
LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "opencv-python-headless", "numba")
SEED = 1  # of the registration's samples
SMOOTHING = 0.01  # s, of a measured pressure: less than the scene's, which makes ramps soft
MARGIN = 0.008  # m of the sheet beyond the picture
View = tuple[float, float, float, float]


def compare_with(
    run: Run, folder: Path, machine: Machine, *, inputs: bool, quick: bool, quiet: bool
) -> Path:
    """Compare a run with the recording of a dpiv.toml's folder; returns the page.

    `inputs`: vary the uncertain inputs by runs of their own. `quick`: compare the motion alone, for
    which nothing is solved. All files are read and the data registered before anything is solved.
    """
    from postprocess.lab.page import make_report

    dpiv = read_dpiv(folder)
    if quick and dpiv.kind == "vectors":
        raise StageError("--quick compares the motion, which vectors do not show; leave it out")
    if quick and run.scene.coupled:
        raise StageError("--quick solves nothing, and COUPLED=1 needs a run; leave one of them out")
    pressure = dpiv.folder / dpiv.pressure_csv if dpiv.pressure_csv else None
    if pressure is not None and not pressure.is_file():
        raise StageError(f"{dpiv.folder / NAME}: pressure_csv = {dpiv.pressure_csv}: no such file")
    scene, lab = run.scene, run.out / "lab" / dpiv.folder.resolve().name
    beside: list[Input | Finer] = [*read_inputs(scene.folder), *NUMERICS]
    lab.mkdir(parents=True, exist_ok=True)
    with exclusive(lab):
        make(run, run.motion, machine, quiet)
        motion = scene.motion_folder / "kinematics.h5"
        kinematics = read_kinematics(motion)
        kinematics = along_bend(kinematics) if scene.coupled else kinematics
        bend_std = _fea_band(dpiv, kinematics, motion)
        registration, view = registered(dpiv, kinematics, lab / "registration_refused.png")
        case = Case(kinematics, registration, bend_std)
        runs = {}
        for of in beside if inputs else ():
            values = of.overrides(scene_numbers(StageFiles(scene)))
            out = run.out / "inputs" / of.name
            runs[of.name] = one = open_run(
                scene.folder, scene.level, dict(run.overrides) | values, out
            )
            make(one, one.motion, machine, quiet=True)
            changed = read_kinematics(one.scene.motion_folder / "kinematics.h5")
            case.effects.append(Effect(of, *difference(kinematics, changed)))
        if not quick:
            agrees = verdicts(_judged(motion_quantities(case)))["motion"] == AGREES
            # the water of a plane flow is too heavy
            if pressure is not None and scene.model.kind != "2d" and not agrees:
                moved = motion_at(pressure, run, lab / "at_pressure", machine, quiet)
                case = replace(case, at_pressure=difference(kinematics, moved))
            case = _with_flow(case, run, runs, lab, dpiv, view, machine, quiet)
        result, series = compare(case)
        missing = {"pressure", "duration", *(of.name for of in beside)} - set(runs)
        result |= {
            "missing_runs": sorted(missing),
            "pressure_unused": pressure is not None and case.at_pressure is None,
            "scene": scene.name,
            "level": scene.level,
            "data": dpiv.title,
            "numerics": level_error([scene.folder, *scene.parents], scene.level).sentence,
            "registration": registration.summary(),
            "provenance": {
                "versions": versions(*LIBRARIES),
                "dpiv_sha256": sha256(dpiv.folder / NAME),
                "seed": SEED,
                "settings": {"dpiv": dpiv.model_dump(mode="json", exclude={"folder"})},
            },
        }
        if not quick:
            solver = RUN.read(run.out / "run" / "run.json").get("versions", {})
            result["provenance"]["versions"] |= solver
            LAB_COMPARISON.write(lab / "comparison.json", result)
        if series is not None:
            write_text(lab / "series.csv", series.to_csv(index=False))
        if not quiet:
            for q in result["quantities"]:
                ratio = f"|E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
                print(f"{q['name']:16s} {q['verdict']:14s} {ratio}")
            print(f"verdict: {result['verdict']}")
        page = lab / ("quick.html" if quick else "report.html")
        return make_report(page, scene.title, dpiv, case, result, series)


def compare(case: Case) -> tuple[dict[str, Any], pd.DataFrame | None]:
    """Verdicts, and the flow's series over time (None: only the motion is compared).

    The flow is judged at the recording's own motion, where its effect is known.
    """
    case = at_recorded_motion(case)
    quantities, series = motion_quantities(case), None
    if case.flow is not None:
        measured = tables(case, case.flow)
        quantities += flow_quantities(case, case.flow, measured)
        series = pd.concat(
            [t.set_index("time").add_suffix(f"_{name}") for name, t in measured.items()], axis=1
        ).reset_index()
    rows, at_pressure = _judged(quantities), None
    if case.at_pressure is not None:
        at_pressure = _judged(motion_quantities(replace(case, effects=[]), case.at_pressure))
    no_load = case.flow.no_load if case.flow else ""
    about = {"at_pressure": at_pressure, "no_load": no_load, "no_flow": case.no_flow}
    return {"quantities": rows, **verdicts(rows), **about}, series


def _judged(quantities: list[ValidatedQuantity]) -> list[dict[str, Any]]:
    return [judged(q, joint_level(len(quantities))) for q in quantities]


def motion_at(path: Path, run: Run, out: Path, machine: Machine, quiet: bool) -> Kinematics:
    """The motion that the measured pressure of a CSV and the water make, by a coupled run."""
    values = dict(run.overrides) | {"motion.source": "structure", "motion.strokes": []}
    values |= {"motion.pressure_csv": str(path.resolve()), "motion.smoothing": SMOOTHING}
    one = open_run(run.scene.folder, run.scene.level, values, out)
    make(one, "solve", machine, quiet)
    return read_kinematics(one.scene.motion_folder / "kinematics.h5")


def registered(dpiv: Dpiv, kinematics: Kinematics, refused: Path) -> tuple[Registration, View]:
    """Register the data; the tank's part around what they show.

    StageError where the fit does not explain the pictures, which `refused` then shows.
    """
    if dpiv.kind == "vectors":
        registration, plane = stated_registration(dpiv, kinematics), lab_vectors(dpiv)
        places = np.stack([plane[n].values[[0, -1]] for n in ("x", "y")], axis=1)
        step = float(plane["x"][1] - plane["x"][0])
        corners = places + np.array([[-step], [step]])
        return registration, registration.pose.view(corners, MARGIN)
    path, light = dpiv.folder / NAME, dpiv.light_from_deg
    with LabRecording(dpiv) as recording:
        known = Known(
            stated_pose(dpiv, recording, kinematics.root),
            dpiv.scale.std_percent / 100,
            turn_std=float(np.radians(dpiv.axes.turn_std_deg)),
            delay=(-dpiv.start.at_s, dpiv.start.std_s) if isinstance(dpiv.start, Start) else None,
            paired=dpiv.piv.pairing == "1-2,3-4",
            hidden=dpiv.root_hidden_mm * 1e-3,
            light_from=None if light is None else float(np.radians(light)),
            length_std=(dpiv.finger_length_std_mm or 0.0) * 1e-3 / kinematics.length,
        )
        try:
            registration = register(recording, recording.times, kinematics, known, SEED)
        except StageError as error:
            raise StageError(f"{path}: {error}") from error
        check = check_fit(recording, registration, kinematics, known)
        rows, columns = recording.shape
    refused.unlink(missing_ok=True)
    if check.refusals:
        write_bytes(refused, draw_fit(check))
        text = f"the registration is refused: {'; also, '.join(check.refusals)}"
        raise StageError(f"{path}: {text}; see {refused}")
    corners = np.array([[0.0, 0.0], [columns, rows]])
    return registration, registration.pose.view(corners, MARGIN)


def _fea_band(dpiv: Dpiv, kinematics: Kinematics, path: Path) -> float:
    """Standard uncertainty (rad) of the final bend by the bands of the FEA; 0: they do not count.

    StageError where they count and are not known, and where one bend belongs to several shapes.
    """
    change = np.diff(kinematics.data["shape_bend"].values)
    if not (np.all(change > 0) or np.all(change < 0)):
        raise StageError(
            f"{path}: shape_bend neither rises nor falls from shape to shape, as of a coupled"
            " motion or a rigid body, so a recording's bend does not tell the shape; compare a"
            " scene whose motion.source is 'fea' or 'paper_equations'"
        )
    if dpiv.finger_geometry == "measured":
        return 0.0
    bend_std = kinematics.bend_std(float(kinematics.law(kinematics.time[1]))) or 0.0
    if bend_std == 0:
        raise StageError(
            f"{path}: carries no state_bend_std, so the bands of the FEA are not known; run make"
            f' fea, or state finger_geometry = "measured" in {dpiv.folder / NAME}'
        )
    return bend_std


def _with_flow(
    case: Case,
    run: Run,
    runs: dict[str, Run],
    lab: Path,
    dpiv: Dpiv,
    view: View,
    machine: Machine,
    quiet: bool,
) -> Case:
    """The case with both sides' flows and what the runs change of it; solves what is missing.

    A clock that the water contradicts is refused before the runs beside the nominal one, or the
    flow is not compared where the motion differs and a run at the measured pressure tells why.
    """
    make(run, "case", machine, quiet)
    if not quiet:
        print(_plan({"the nominal run": run} | runs, machine.ranks), flush=True)
    make(run, "solve", machine, quiet)
    name = f"lab_{'_'.join(f'{1e3 * v:.0f}' for v in view)}.h5"  # recordings of one set-up share it
    make_sheet(run, view, run.out / name, quiet)
    with read_plane(run.out / name) as opened:
        sheet = opened.load()
    vortices = run.scene.vortices.model_dump(mode="json")
    known = case.kinematics, case.registration, sheet, vortices
    sides = both_sides(lab, dpiv, *known, threads=machine.jobs, quiet=quiet)
    case = check_clock(case, sides, dpiv.folder / NAME)
    if case.no_flow:
        return case
    fluid = run.scene.fluid
    sides = with_load(sides, case, sheet, fluid.density, fluid.kinematic_viscosity)
    for one in runs.values():
        make(one, "solve", machine, quiet)
        make_sheet(one, view, one.out / name, quiet, PLANES)
    sheets = {of: one.out / name for of, one in runs.items()}
    return replace(
        case, flow=sides, effects=flow_effects(case, sides, sheet, sheets, fluid.density)
    )


def _plan(runs: dict[str, Run], ranks: int) -> str:
    """The runs that are to be solved, by name, and how long that takes."""
    missing = [name for name, one in runs.items() if one.why_stale("solve") is not None]
    if not missing:
        return "plan: nothing is left to solve"
    time = sum(
        estimate(runs[name], stage)[0] / (ranks if BY_NAME[stage].ranks else 1)
        for name in missing
        for stage in TO_SOLVE
    )
    return f"plan: to solve {', '.join(missing)}, about {duration(time)} on {ranks} idle cores"
