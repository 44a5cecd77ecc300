"""Comparison of a scene with a laboratory's recording, and a virtual laboratory to try it on."""

from __future__ import annotations

import shutil
from pathlib import Path

from fileio.errors import StageError
from fileio.formats.plane_series import read_plane
from fileio.lock import exclusive
from fileio.provenance import digest
from fileio.record import changed_outputs, read_record, write_record
from pipeline.runs.make import Machine, make, make_sheet
from pipeline.runs.run import Run, open_run
from piv.synthetic.camera import Seeding
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.dpiv_toml import NAME, Dpiv, read_dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.inputs_toml import input_rows, read_inputs, virtual_row
from postprocess.lab.data.plan import plan_text
from postprocess.lab.judgement.compare import run_comparison
from postprocess.lab.judgement.motion import motion_sentence
from postprocess.lab.registration.check_motion import FEWEST
from postprocess.lab.registration.step import run_registration
from postprocess.lab.virtual.virtual_laboratory import (
    PAIRS_HZ,
    SetUp,
    camera_for,
    make_recording,
    write_dpiv,
)

_VIRTUAL_VIEW = -0.075, 0.12, 0.115, 0.275  # m: x0, x1, y0, y1; wider than the camera
PLANES = 42  # of a run that varies an input: its effect changes slowly


def compare_with(
    run: Run, folder: Path, machine: Machine, *, inputs: bool, quick: bool, quiet: bool
) -> Path | None:
    """Compare a run with the recording of a dpiv.toml's folder; returns the page.

    `inputs`: vary the uncertain inputs by runs of their own. `quick`: print the motion alone.
    Registration comes first: it reports missing keys of dpiv.toml before any solving.
    """
    dpiv = _read_dpiv(folder)
    files = LabFiles(StageFiles(run.scene), dpiv.name)
    make(run, "kinematics", machine, quiet)
    files.folder.mkdir(parents=True, exist_ok=True)
    with exclusive(files.folder):
        if quick:
            _print_registration(files, dpiv, quick=True, quiet=False)
            return None
        _register(run, files, dpiv, quiet)
        known = read_inputs(run.scene.folder)
        rows = input_rows(scene_numbers(files.stage), known) if inputs else []
        runs = {name: _variant(run, "inputs", name, values) for name, values in rows}
        if inputs:
            make(run, "case", machine, quiet)
            if not quiet:
                print(plan_text({"the nominal run": run} | runs, machine.ranks), flush=True)
        for one in (run, *runs.values()):
            make(one, "run", machine, quiet)
        view = tuple(float(v) for v in files.view.read_text(encoding="utf-8").split())
        make_sheet(run, view, files.sheet, quiet)
        if not inputs:
            shutil.rmtree(files.folder / "inputs", ignore_errors=True)
        for name, one in runs.items():
            make_sheet(one, view, files.run_sheet(name), quiet, PLANES)
        return _judge(files, dpiv, machine.jobs, quiet)


def virtual_laboratory(run: Run, pressure_kpa: float, machine: Machine, quiet: bool) -> Path:
    """Render a recording of a run at another pressure, with set-up errors; returns its folder."""
    name, values = virtual_row(scene_numbers(StageFiles(run.scene)), pressure_kpa)
    other = _variant(run, "virtual", name, values)
    make(other, "run", machine, quiet)
    sheet_file = other.out / "view.h5"
    make_sheet(other, _VIRTUAL_VIEW, sheet_file, quiet)
    x, y = other.scene.finger.root
    camera = camera_for((x, y))
    set_up = SetUp(camera, Seeding(density_ppp=0.05))
    folder = other.out / f"virtual_{name}"
    folder.mkdir(exist_ok=True)
    with read_plane(sheet_file) as sheet:
        make_recording(sheet.load(), set_up, (x, y), folder, PAIRS_HZ)
    write_dpiv(set_up, (x, y), folder, name, PAIRS_HZ)
    return folder


def _read_dpiv(folder: Path) -> Dpiv:
    if not (folder / NAME).is_file() and folder.name != NAME:
        raise StageError(f"DPIV={folder}: holds no {NAME}; docs/comparison.md shows one")
    return read_dpiv(folder)


def _variant(run: Run, kind: str, name: str, values: dict[str, object]) -> Run:
    """The run with further overrides, in its own folder."""
    scene = run.scene
    return open_run(scene.folder, scene.level, dict(run.overrides) | values, run.out / kind / name)


def _register(run: Run, files: LabFiles, dpiv: Dpiv, quiet: bool) -> None:
    """Register the finger in the data, unless done with the same motion and files."""
    data = [
        [path.relative_to(dpiv.folder).as_posix(), path.stat().st_size, path.stat().st_mtime_ns]
        for path in sorted(dpiv.folder.rglob("*"))
        if path.is_file()
    ]
    made_from = digest(["registration 2", run.digest("kinematics"), data])
    record = read_record(files.folder, "registration")
    if record and record["digest"] == made_from and not changed_outputs(files.folder, record):
        return
    _print_registration(files, dpiv, quick=False, quiet=quiet)
    outputs = [files.registration, files.view]
    write_record(files.folder, "registration", {"digest": made_from}, outputs)


def _print_registration(files: LabFiles, dpiv: Dpiv, quick: bool, quiet: bool) -> None:
    registration = run_registration(files, dpiv, quick=quick)
    if quiet:
        return
    print(f"register: {motion_sentence(registration)}")
    if 0 < registration.times.size < FEWEST:
        print(f"register: fewer than {FEWEST} pictures (or pairs) do not show dropped frames")


def _judge(files: LabFiles, dpiv: Dpiv, threads: int, quiet: bool) -> Path:
    from postprocess.lab.report.report import make_report

    result = run_comparison(files, dpiv, threads=threads, quiet=quiet)
    if not quiet:
        for q in result["quantities"]:
            ratio = f"|E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
            print(f"{q['name']:16s} {q['verdict']:14s} {ratio}")
        print(f"verdict: {result['verdict']}")
    return make_report(files, dpiv)
