"""Comparison of a scene with a laboratory's DPIV, step by step: runs, register, compare, report, motion (make compare does all)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fileio.errors import sentence
from fileio.lock import exclusive
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.inputs_toml import read_inputs, write_runs, write_virtual
from postprocess.lab.judgement.compare import run_comparison
from postprocess.lab.registration.step import lab_files, run_registration


def parser() -> argparse.ArgumentParser:
    """Arguments of the steps."""
    result = argparse.ArgumentParser(prog="python -m postprocess.lab", description=__doc__)
    steps = result.add_subparsers(dest="step", required=True, metavar="step")
    for name, text in (
        (
            "runs",
            "write the scenes of the runs beside the nominal one (reference/inputs.toml); prints their names",
        ),
        ("virtual", "write the scene of a virtual laboratory: the same finger under another pressure"),
        ("register", "find the finger in the data: pose, scale, time, motion"),
        ("compare", "evaluate both sides alike and judge every quantity"),
        ("report", "figures and page"),
        ("motion", "write the finger's motion as the recording shows it, and a scene that is driven by it"),
    ):
        step = steps.add_parser(name, help=text, description=text)
        step.add_argument("case", type=Path, help="folder of the scene, such as cases/single_finger")
        step.add_argument("--level", default="coarse")
        step.add_argument("--quiet", action="store_true", help="print nothing but errors")
        if name == "virtual":
            step.add_argument("--pressure-kpa", type=float, required=True, help="of the last stroke")
        elif name != "runs":
            step.add_argument(
                "--dpiv", type=Path, required=True, help="folder of dpiv.toml and the data, or the file"
            )
        if name in ("register", "compare"):
            step.add_argument("--seed", type=int, default=1, help="of all random numbers (default 1)")
        if name == "compare":
            step.add_argument("--threads", type=int, default=1, help="vector fields at a time (default 1)")
    return result


def run(args: argparse.Namespace) -> None:
    """Run one step."""
    if args.step == "runs":
        inputs = read_inputs(args.case / "reference" / "inputs.toml")
        folders = write_runs(StageFiles(args.case, args.level), inputs)
        if not args.quiet:
            print(" ".join(folder.name for folder in folders))
        return
    if args.step == "virtual":
        folder = write_virtual(StageFiles(args.case, args.level), args.pressure_kpa)
        if not args.quiet:
            print(folder)
        return
    files, dpiv = lab_files(args.case, args.level, args.dpiv)
    if not files.stage.out.is_dir():  # the step says what is missing, and writes nothing
        run_step(args, files, dpiv)
        return
    files.folder.parent.mkdir(exist_ok=True)
    with exclusive(files.folder):  # two makes at once
        run_step(args, files, dpiv)


def run_step(args: argparse.Namespace, files: LabFiles, dpiv: Dpiv) -> None:
    """Run one of the steps of a comparison with one laboratory's data."""
    if args.step == "register":
        registration = run_registration(files, dpiv, args.seed)
        if not args.quiet:
            law = registration.law
            print(
                f"register: delay {law.delay * 1e3:.1f} ± {law.std('delay') * 1e3:.1f} ms, factor {law.values[0]:.3f}"
            )
    elif args.step == "compare":
        result = run_comparison(files, dpiv, seed=args.seed, threads=args.threads, quiet=args.quiet)
        if not args.quiet:
            for q in result["quantities"]:
                print(
                    f"{q['name']:16s} {q['verdict']:14s} |E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
                )
            print(f"verdict: {result['verdict']}")
    elif args.step == "motion":
        from postprocess.lab.judgement.recorded_motion import run_motion

        folder = run_motion(files, dpiv)
        if not args.quiet:
            print(folder)
    else:
        from postprocess.lab.report.report import make_report

        path = make_report(files)
        if not args.quiet:
            print(f"report: {path.resolve()}")


def main(argv: list[str] | None = None) -> int:
    """Command line; returns 0 good, 2 bad input."""
    args = parser().parse_args(argv)
    try:
        run(args)
    except (ValueError, OSError) as error:
        print(f"lab {args.step}: {sentence(error)}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
