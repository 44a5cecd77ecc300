"""Comparison of a scene with a laboratory's recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.formats.kinematics import Kinematics, read_kinematics
from pipeline.formats.records import LAB_COMPARISON, RUN
from pipeline.runs.run import Run, open_run
from piv.files.atomic import sha256, write_bytes, write_text
from piv.files.errors import StageError
from piv.files.lock import exclusive
from piv.files.provenance import versions
from piv.formats.plane_series import read_plane
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.causes import check_fit, draw_fit
from postprocess.lab.dpiv_toml import NAME, Dpiv, read_dpiv
from postprocess.lab.flow import quantities, series, with_flow
from postprocess.lab.inputs import level_uncertainty, level_windows, read_inputs
from postprocess.lab.motion import (
    Comparison,
    Effect,
    check_rate,
    difference,
    onset,
    over_bend,
    stroke_duration,
    with_speeds,
)
from postprocess.lab.recorded import LabRecording, known_of, lab_vectors, recording_quality
from postprocess.lab.register import Registration, fit_pictures, register, stated_registration
from postprocess.lab.validation import joint_level, judged, repeated, verdicts
from postprocess.lab.virtual_experiment import both_sides
from postprocess.report.trust import level_error
from softfinger.make import Machine, make
from softfinger.sheets import make_sheet

PLANES = 84  # of a run that varies an input: its effect changes slowly
LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "opencv-python-headless", "numba")
SEED = 1  # of the registration's samples
MARGIN = 0.008  # m of the sheet beyond the picture
View = tuple[float, float, float, float]


def compare_with(
    run: Run, folders: list[Path], machine: Machine, *, inputs: bool, quick: bool, quiet: bool
) -> Path:
    """Compare a run with the recordings of dpiv.toml's folders; returns the page.

    Several are repeats: each is registered alone, and their mean is compared. `inputs`: vary the
    uncertain inputs by runs of their own. `quick`: compare the motion alone, for which nothing is
    solved. All files are read and the data registered before anything is solved.
    """
    from postprocess.lab.page import make_report

    dpivs = [read_dpiv(folder) for folder in folders]
    if quick and any(dpiv.kind == "vectors" for dpiv in dpivs):
        raise StageError("--quick compares the motion, which vectors do not show; leave it out")
    if quick and run.scene.coupled:
        raise StageError("--quick solves nothing, and COUPLED=1 needs a run; leave one of them out")
    scene, labs = run.scene, run.out / "lab"
    beside = read_inputs(scene.folder)
    names = [dpiv.folder.resolve().name for dpiv in dpivs]
    if len(set(names)) < len(names):
        raise StageError(f"DPIV: two folders have one name ({', '.join(names)}); rename one")
    lab = labs / "+".join(names)
    lab.mkdir(parents=True, exist_ok=True)
    with exclusive(lab):
        make(run, run.motion, machine, quiet)
        kinematics, asked = _motion(run), beside if inputs else ()
        numbers, runs, effects = scene_numbers(StageFiles(scene)), {}, []
        for of in asked:
            # where water moves the finger as well, a longer stroke has no similar flow
            longer = None if scene.coupled else of.stretch(numbers)
            if longer:
                effects.append(Effect(of, 0.0, (longer - 1) * stroke_duration(kinematics)))
                continue
            values, out = dict(run.overrides) | of.overrides(numbers), run.out / "inputs" / of.name
            runs[of.name] = one = open_run(scene.folder, scene.level, values, out)
            make(one, one.motion, machine, quiet=True)
            effects.append(Effect(of, *difference(kinematics, _motion(one))))
        parents = [scene.folder, *scene.parents]
        cases, levels = [], level_windows(parents, scene.level, scene.model.kind == "2d")
        for dpiv, name in zip(dpivs, names, strict=True):
            bend_std = _fea_band(dpiv, kinematics, scene.motion_folder / "kinematics.h5")
            (labs / name).mkdir(exist_ok=True)
            seen = registered(dpiv, kinematics, labs / name / "registration_refused.png")
            known = dpiv, kinematics, seen[0], bend_std
            cases.append((Comparison(*known, None, effects, levels, scene.level), seen[1]))
        compared = [
            case if quick else _with_flow(case, run, runs, labs / name, view, machine, quiet)
            for name, (case, view) in zip(names, cases, strict=True)
        ]
        result = summary(compared) | {
            "not_varied": sorted(
                {"pressure", "duration", *(o.name for o in beside)} - {o.name for o in asked}
            ),
            "scene": scene.name,
            "level": scene.level,
            "plane": scene.model.kind == "2d",
            "coupled": scene.coupled,
            "numerics": level_error(parents, scene.level).sentence,
        }
        if not quick:
            solver = RUN.read(run.out / "run" / "run.json").get("versions", {})
            result["provenance"]["versions"] |= solver
            LAB_COMPARISON.write(lab / "comparison.json", result)
            for case, name in zip(compared, names, strict=True):
                write_text(labs / name / "series.csv", series(case).to_csv(index=False))
        if not quiet:
            for q in result["quantities"]:
                ratio = f"|E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
                print(f"{q['name']:16s} {q['verdict']:14s} {ratio}")
            print(f"verdict: {result['verdict']}")
        page = lab / ("quick.html" if quick else "report.html")
        return make_report(page, scene.title, compared[0], result)


def _motion(run: Run) -> Kinematics:
    """The motion of a run, a coupled one over its bend."""
    kinematics = read_kinematics(run.scene.motion_folder / "kinematics.h5")
    return over_bend(kinematics) if run.scene.coupled else kinematics


def summary(cases: list[Comparison]) -> dict[str, Any]:
    """comparison.json of one recording or of repeats, as far as they decide it."""
    by_name = [{q.name: q for q in quantities(case)} for case in cases]
    shared = [name for name in by_name[0] if all(name in one for one in by_name)]
    means = [repeated([one[name] for one in by_name]) for name in shared]
    rows, first = [judged(q, joint_level(len(means))) for q in means], cases[0]
    during = next((q.window for q in means if q.window), (0.0, 0.0))
    return {
        "quantities": rows,
        "levels": {
            level: level_uncertainty(first.levels, level, during)
            for level in first.levels["run"].unique()
        },
        **verdicts(rows),
        "all_water": first.all_water,
        "water_speed": first.water_speed,
        "data": ", ".join(case.dpiv.title for case in cases),
        "registration": first.registration.summary(),
        "quality": recording_quality(
            first.dpiv, first.registration, first.flow.data if first.flow else None
        ),
        "repeats": [
            {
                "title": case.dpiv.title,
                "registration": case.registration.summary(),
                "errors": {name: of[name].error for name in shared},
            }
            for case, of in zip(cases, by_name, strict=True)
        ],
        "provenance": {
            "dpiv_sha256": [sha256(case.dpiv.folder / NAME) for case in cases],
            "settings": {
                case.dpiv.title: case.dpiv.model_dump(mode="json", exclude={"folder"})
                for case in cases
            },
            "versions": versions(*LIBRARIES),
            "seed": SEED,
        },
    }


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
    path = dpiv.folder / NAME
    with LabRecording(dpiv) as recording:
        known = known_of(dpiv, recording, kinematics)
        try:
            fit = fit_pictures(recording, recording.times, kinematics, known, SEED)
        except StageError as error:
            raise StageError(f"{path}: {error}") from error
        rows, columns = recording.shape
    check = check_fit(fit, kinematics, known)
    refused.unlink(missing_ok=True)
    if check.refusals:
        write_bytes(refused, draw_fit(check))
        text = f"the registration is refused: {'; also, '.join(check.refusals)}"
        key = "green: as fitted, red: what does not fit, orange: as stated"
        raise StageError(f"{path}: {text}; see {refused} ({key})")
    registration = register(fit, kinematics, known)
    return registration, registration.pose.view(np.array([[0.0, 0.0], [columns, rows]]), MARGIN)


def _fea_band(dpiv: Dpiv, kinematics: Kinematics, path: Path) -> float:
    """Standard uncertainty (rad) of the final bend by the bands of the FEA; 0: they do not count.

    StageError where they count and are not known, and where one bend belongs to several shapes.
    """
    change = np.diff(kinematics.data["shape_bend"].values)
    if not (np.all(change > 0) or np.all(change < 0)):
        raise StageError(
            f"{path}: shape_bend neither rises nor falls from shape to shape, as of a rigid body,"
            " so a recording's bend does not tell the shape; compare a scene whose motion.source is"
            " 'fea' or 'paper_equations', or COUPLED=1"
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
    case: Comparison,
    run: Run,
    runs: dict[str, Run],
    folder: Path,
    view: View,
    machine: Machine,
    quiet: bool,
) -> Comparison:
    """The case with the flows of both sides, and with how the other runs change the simulated one.

    A clock that the water contradicts is refused before the runs beside the nominal one.
    """
    make(run, "solve", machine, quiet)
    name = f"lab_{'_'.join(f'{1e3 * v:.0f}' for v in view)}.h5"  # recordings of one set-up share it
    make_sheet(run, view, run.out / name, quiet)
    with read_plane(run.out / name) as opened:
        sheet = opened.load()
    if case.dpiv.start == "from flow":
        seen = onset(case.registration, lab_vectors(case.dpiv), sheet)
        case = replace(case, registration=seen)
    vortices = run.scene.vortices.model_dump(mode="json")
    known = case.dpiv, case.kinematics, case.registration, sheet, vortices
    sides = both_sides(folder, *known, threads=machine.jobs, quiet=quiet)
    case = with_speeds(case, sides)
    check_rate(case)
    for one in runs.values():
        make(one, "solve", machine, quiet)
        make_sheet(one, view, one.out / name, quiet, PLANES)
    sheets = {of: one.out / name for of, one in runs.items()}
    return with_flow(case, sides, sheets)
