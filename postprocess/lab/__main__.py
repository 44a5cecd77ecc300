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
from fileio.provenance import read_settings
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.inputs_toml import input_rows, read_inputs, virtual_row, write_scene
from postprocess.lab.data.plan import plan_text
from postprocess.lab.judgement.compare import run_comparison
from postprocess.lab.judgement.motion import motion_sentence
from postprocess.lab.registration.step import lab_files, run_registration

Say = Callable[[object], None]


def _runs(args: argparse.Namespace, say: Say) -> None:
    files = StageFiles(args.scene, args.level)
    rows = input_rows(scene_numbers(files), read_inputs(args.scene))
    for name, overrides in rows:
        write_scene(files, f"inputs/{name}", overrides)
    say(" ".join(name for name, _ in rows))


def _plan(args: argparse.Namespace, say: Say) -> None:
    files = StageFiles(args.scene, args.level)
    say(plan_text(files, read_inputs(args.scene), args.ranks, args.solver))


def _virtual(args: argparse.Namespace, say: Say) -> None:
    files = StageFiles(args.scene, args.level)
    numbers = read_settings(files.required("kinematics.h5", "kinematics"))
    name, overrides = virtual_row(numbers, args.pressure_kpa)
    say(write_scene(files, f"virtual/{name}", overrides))


def _register(args: argparse.Namespace, say: Say, files: LabFiles, dpiv: Dpiv) -> None:
    registration = run_registration(files, dpiv, args.seed, args.quick)
    say(f"register: {motion_sentence(registration)}")


def _compare(args: argparse.Namespace, say: Say, files: LabFiles, dpiv: Dpiv) -> None:
    result = run_comparison(files, dpiv, seed=args.seed, threads=args.threads, quiet=args.quiet)
    for q in result["quantities"]:
        ratio = f"|E|/u_val = {q['significance']:.2f}, mostly {q['dominant']}"
        say(f"{q['name']:16s} {q['verdict']:14s} {ratio}")
    say(f"verdict: {result['verdict']}")


def _report(args: argparse.Namespace, say: Say, files: LabFiles, dpiv: Dpiv) -> None:
    from postprocess.lab.report.report import make_report

    say(f"report: {make_report(files).resolve()}")


OPTIONS: dict[str, dict[str, Any]] = {
    "quick": {"action": "store_true", "help": "print the motion and write no registration"},
    "pressure-kpa": {"type": float, "required": True, "help": "of the last stroke"},
    "seed": {"type": int, "default": 1, "help": "of all random numbers (default 1)"},
    "ranks": {"type": int, "default": 1, "help": "that each run is solved on (default 1)"},
    "solver": {"type": float, "help": "s: predicted time of the nominal run's solver on one rank"},
    "threads": {"type": int, "default": 1, "help": "vector fields at a time (default 1)"},
}


@dataclass(frozen=True)
class _Step:
    """A command; `with_data`: it works on one laboratory's data, under their lock."""

    act: Callable[..., None]
    options: tuple[str, ...] = ()
    with_data: bool = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        add_scene(parser)
        if self.with_data:
            text = "folder of dpiv.toml, or the file"
            parser.add_argument("--dpiv", type=Path, required=True, help=text)
        for name in self.options:
            parser.add_argument(f"--{name}", **OPTIONS[name])

    def run(self, args: argparse.Namespace) -> None:
        say: Say = (lambda text: None) if args.quiet else print
        if not self.with_data:
            return self.act(args, say)
        files, dpiv = lab_files(args.scene, args.level, args.dpiv)
        if not files.stage.out.is_dir():  # the step says what is missing, and writes nothing
            return self.act(args, say, files, dpiv)
        files.folder.parent.mkdir(exist_ok=True)
        with exclusive(files.folder):
            return self.act(args, say, files, dpiv)


COMMANDS: Commands = {
    "runs": ("scenes of the runs beside the nominal one", _Step(_runs, (), False)),
    "plan": (
        "runs that a comparison needs, and their time",
        _Step(_plan, ("ranks", "solver"), False),
    ),
    "virtual": ("scene of a virtual laboratory", _Step(_virtual, ("pressure-kpa",), False)),
    "recording": (
        "what a virtual laboratory records",
        "postprocess.lab.virtual.virtual_laboratory",
    ),
    "register": ("find the finger in the data", _Step(_register, ("seed", "quick"))),
    "compare": ("judge every quantity", _Step(_compare, ("seed", "threads"))),
    "report": ("figures and page", _Step(_report)),
}


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    return command_line("python -m postprocess.lab", __doc__, COMMANDS, argv, prefix="lab ")


if __name__ == "__main__":
    sys.exit(main())
