"""Comparison of a scene with a laboratory's DPIV, step by step (make compare does all)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fileio.command import Commands, add_scene, command_line
from fileio.lock import exclusive
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.inputs_toml import read_inputs, write_runs, write_virtual
from postprocess.lab.data.plan import coupled_plan_text, plan_text
from postprocess.lab.judgement.compare import run_comparison
from postprocess.lab.judgement.motion import motion_sentence
from postprocess.lab.registration.check_motion import FEWEST
from postprocess.lab.registration.step import lab_files, run_registration


def runs(args: argparse.Namespace, say: Callable[[object], None]) -> None:
    inputs = read_inputs(args.scene / "reference" / "inputs.toml")
    folders = write_runs(StageFiles(args.scene, args.level), inputs)
    say(" ".join(folder.name for folder in folders))


def plan(args: argparse.Namespace, say: Callable[[object], None]) -> None:
    files = StageFiles(args.scene, args.level)
    inputs = read_inputs(args.scene / "reference" / "inputs.toml")
    say(plan_text(files, inputs, args.ranks, args.solver))


def virtual(args: argparse.Namespace, say: Callable[[object], None]) -> None:
    say(write_virtual(StageFiles(args.scene, args.level), args.pressure_kpa))


def register(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    registration = run_registration(files, dpiv, args.seed, args.quick)
    say(f"register: {motion_sentence(registration)}")
    if 0 < registration.times.size < FEWEST:
        say(
            f"register: dropped frames are not looked for in fewer than {FEWEST} pictures (or pairs)"
        )


def compare(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    result = run_comparison(files, dpiv, seed=args.seed, threads=args.threads, quiet=args.quiet)
    for q in result["quantities"]:
        say(
            f"{q['name']:16s} {q['verdict']:14s} |E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
        )
    say(f"verdict: {result['verdict']}")


def motion(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    from postprocess.lab.judgement.recorded_motion import run_motion

    say(run_motion(files, dpiv))


def pressure(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    from postprocess.lab.judgement.causes import coupled_home, write_scene

    say(write_scene(files, dpiv))
    say(coupled_plan_text(files.stage, coupled_home(files), args.ranks))


def modelled(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    from postprocess.lab.judgement.causes import write_modelled

    say(write_modelled(files, dpiv))


def causes(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    from postprocess.lab.judgement.causes import causes, sentences

    for sentence in sentences(causes(files, dpiv), files, dpiv):
        say(sentence)


def report(
    args: argparse.Namespace, say: Callable[[object], None], files: LabFiles, dpiv: Dpiv
) -> None:
    from postprocess.lab.report.report import make_report

    say(f"report: {make_report(files).resolve()}")


OPTIONS: dict[str, dict[str, Any]] = {
    "quick": {
        "action": "store_true",
        "help": "say what the pictures show of the motion, and write no registration",
    },
    "pressure-kpa": {"type": float, "required": True, "help": "of the last stroke"},
    "seed": {"type": int, "default": 1, "help": "of all random numbers (default 1)"},
    "ranks": {"type": int, "default": 1, "help": "that each run is solved on (default 1)"},
    "solver": {
        "type": float,
        "help": "s: what the nominal run's solver is predicted to take on one rank (make predict)",
    },
    "threads": {"type": int, "default": 1, "help": "vector fields at a time (default 1)"},
}


@dataclass(frozen=True)
class Step:
    """A step of the comparison; `with_data`: with one laboratory's data, one command at a time."""

    act: Callable[..., None]
    options: tuple[str, ...] = ()
    with_data: bool = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        add_scene(parser)
        if self.with_data:
            parser.add_argument(
                "--dpiv", type=Path, required=True, help="folder of dpiv.toml, or the file"
            )
        for name in self.options:
            parser.add_argument(f"--{name}", **OPTIONS[name])

    def run(self, args: argparse.Namespace) -> None:
        say: Callable[[object], None] = (lambda text: None) if args.quiet else print
        if not self.with_data:
            return self.act(args, say)
        files, dpiv = lab_files(args.scene, args.level, args.dpiv)
        if not files.stage.out.is_dir():  # the step says what is missing, and writes nothing
            return self.act(args, say, files, dpiv)
        files.folder.parent.mkdir(exist_ok=True)
        with exclusive(files.folder):
            return self.act(args, say, files, dpiv)


COMMANDS: Commands = {
    "runs": (
        "scenes of the runs beside the nominal one (reference/inputs.toml)",
        Step(runs, (), False),
    ),
    "plan": (
        "runs that a comparison needs, and how long they will take",
        Step(plan, ("ranks", "solver"), False),
    ),
    "virtual": (
        "scene of a virtual laboratory: another pressure",
        Step(virtual, ("pressure-kpa",), False),
    ),
    "recording": (
        "what a virtual laboratory records",
        "postprocess.lab.virtual.virtual_laboratory",
    ),
    "register": (
        "find the finger in the data: pose, scale, time, motion",
        Step(register, ("seed", "quick")),
    ),
    "compare": ("judge every quantity", Step(compare, ("seed", "threads"))),
    "report": ("figures and page", Step(report)),
    "pressure": (
        "a scene that is driven by the pressure measured with the recording",
        Step(pressure, ("ranks",)),
    ),
    "modelled": (
        "a scene that is driven by the motion of the coupled run at that pressure",
        Step(modelled),
    ),
    "causes": ("whether pressure, structure or flow differ from the recording's", Step(causes)),
    "motion": ("the finger's motion as recorded, and a scene that is driven by it", Step(motion)),
}


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    return command_line("python -m postprocess.lab", __doc__, COMMANDS, argv, prefix="lab ")


if __name__ == "__main__":
    sys.exit(main())
