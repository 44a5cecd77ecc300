"""Comparison of a scene with a laboratory's recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from fileio.atomic import sha256, write_text
from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics, read_kinematics
from fileio.formats.plane_series import read_plane
from fileio.formats.records import LAB_COMPARISON, RUN
from fileio.lock import exclusive
from fileio.provenance import digest, versions
from fileio.record import changed_outputs, read_record, write_record
from pipeline.runs.estimate import duration, estimate
from pipeline.runs.make import Machine, make, make_sheet
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.dpiv_toml import NAME, Dpiv, read_dpiv
from postprocess.lab.data.files import LAW, LabFiles, Registration, read_registration
from postprocess.lab.data.inputs_toml import input_rows, read_inputs
from postprocess.lab.judgement.case import Case
from postprocess.lab.judgement.clock import check_clock
from postprocess.lab.judgement.compare import compare
from postprocess.lab.judgement.flow import flow_effects
from postprocess.lab.judgement.motion import effect_of
from postprocess.lab.registration.step import fea_band, registration_summary, run_registration
from postprocess.lab.virtual.common_grid import on_common_grid
from postprocess.report.trust import level_error

PLANES = 42  # of a run that varies an input: its effect changes slowly
TO_SOLVE = ("kinematics", "mesh", "case", "run")
LIBRARIES = ("numpy", "scipy", "xarray", "h5py", "opencv-python-headless", "numba")
SEED = 1  # of the registration's samples


def compare_with(
    run: Run, folder: Path, machine: Machine, *, inputs: bool, quick: bool, quiet: bool
) -> Path:
    """Compare a run with the recording of a dpiv.toml's folder; returns the page.

    `inputs`: vary the uncertain inputs by runs of their own. `quick`: compare the motion alone, for
    which nothing is solved. All files are read and the data registered before anything is solved.
    """
    from postprocess.lab.report.report import make_report

    if not (folder / NAME).is_file() and folder.name != NAME:
        raise StageError(f"DPIV={folder}: holds no {NAME}; docs/comparison.md shows one")
    dpiv = read_dpiv(folder)
    if quick and dpiv.kind == "vectors":
        raise StageError("QUICK=1 compares the motion, which vectors do not show; leave it out")
    files, scene = LabFiles(StageFiles(run.scene), dpiv.name), run.scene
    make(run, "kinematics", machine, quiet)
    files.folder.mkdir(parents=True, exist_ok=True)
    with exclusive(files.folder):
        kinematics, known = read_kinematics(run.path("kinematics")), read_inputs(scene.folder)
        bend_std = fea_band(files, dpiv, kinematics)
        registration = _register(run, files, dpiv, kinematics, quiet)
        case = Case(kinematics, registration, bend_std)
        rows = input_rows(scene_numbers(files.stage), known) if inputs else []
        runs = {
            name: open_run(
                scene.folder, scene.level, dict(run.overrides) | values, run.out / "inputs" / name
            )
            for name, values in rows
        }
        for of in (known.input if quick else known.all) if inputs else ():
            make(runs[of.name], "kinematics", machine, quiet=True)
            changed = read_kinematics(runs[of.name].path("kinematics"))
            case.effects.append(effect_of(of, kinematics, changed))
        if not quick:
            case = _with_flow(case, run, runs, files, dpiv, machine, quiet)
        result, series = compare(case, known)
        result |= {
            "scene": files.stage.scene,
            "level": scene.level,
            "data": dpiv.title,
            "numerics": level_error([scene.folder, *scene.parents], scene.level)[0],
            "registration": registration_summary(registration),
            "provenance": {
                "versions": versions(*LIBRARIES),
                "dpiv_sha256": sha256(dpiv.folder / NAME),
                "seed": SEED,
                "settings": {"dpiv": dpiv.model_dump(mode="json", exclude={"folder"})},
            },
        }
        if series is not None:
            solver = RUN.read(files.stage.required("run/run.json", "run")).get("versions", {})
            result["provenance"]["versions"] |= solver
            LAB_COMPARISON.write(files.comparison, result)
            write_text(files.folder / "series.csv", series.to_csv(index=False))
        if not quiet:
            for q in result["quantities"]:
                ratio = f"|E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
                print(f"{q['name']:16s} {q['verdict']:14s} {ratio}")
            print(f"verdict: {result['verdict']}")
        return make_report(files, dpiv, case, result, series)


def _with_flow(
    case: Case,
    run: Run,
    runs: dict[str, Run],
    files: LabFiles,
    dpiv: Dpiv,
    machine: Machine,
    quiet: bool,
) -> Case:
    """The case with both sides' flows and what the runs change of it; solves what is missing.

    A clock that the water contradicts is refused before the runs beside the nominal one.
    """
    make(run, "case", machine, quiet)
    if not quiet:
        print(_plan({"the nominal run": run} | runs, machine.ranks), flush=True)
    make(run, "run", machine, quiet)
    view = case.registration.view
    name = f"lab_{'_'.join(f'{1e3 * v:.0f}' for v in view)}.h5"  # recordings of one set-up share it
    make_sheet(run, view, run.out / name, quiet)
    with read_plane(run.out / name) as opened:
        sheet = opened.load()
    known = files, dpiv, case.kinematics, case.registration, sheet
    sides = on_common_grid(*known, threads=machine.jobs, quiet=quiet)
    check_clock(case.kinematics, case.registration, sides, dpiv.folder / NAME)
    for one in runs.values():
        make(one, "run", machine, quiet)
        make_sheet(one, view, one.out / name, quiet, PLANES)
    sheets = {of: one.out / name for of, one in runs.items()}
    return replace(case, flow=sides, effects=flow_effects(case, sides, sheet, sheets))


def _plan(runs: dict[str, Run], ranks: int) -> str:
    """The runs that are to be solved, by name, and how long that takes."""
    missing = [name for name, one in runs.items() if one.why_stale("run") is not None]
    if not missing:
        return "plan: nothing is left to solve"
    time = sum(
        estimate(runs[name], stage)[0] / (ranks if BY_NAME[stage].ranks else 1)
        for name in missing
        for stage in TO_SOLVE
    )
    return f"plan: to solve {', '.join(missing)}, about {duration(time)} on {ranks} idle cores"


def _register(
    run: Run, files: LabFiles, dpiv: Dpiv, kinematics: Kinematics, quiet: bool
) -> Registration:
    """Register the finger in the data, unless done with the same motion and files."""
    data: list[Any] = [
        [path.relative_to(dpiv.folder).as_posix(), path.stat().st_size, path.stat().st_mtime_ns]
        for path in sorted(dpiv.folder.rglob("*"))
        if path.is_file()
    ]
    made_from = digest(["registration 3", run.digest("kinematics"), data])
    record = read_record(files.folder, "registration")
    if record and record["digest"] == made_from and not changed_outputs(files.folder, record):
        return read_registration(files.registration)
    registration = run_registration(files, dpiv, kinematics, SEED)
    write_record(files.folder, "registration", {"digest": made_from}, [files.registration])
    if not quiet and registration.times.size:
        found = zip(LAW, registration.law.values, strict=True)
        text = (f"{name} {v:.4f} ± {1.96 * registration.law.std(name):.4f}" for name, v in found)
        print(f"register: recording against simulation (95 %): {', '.join(text)} (delay in s)")
    return registration
