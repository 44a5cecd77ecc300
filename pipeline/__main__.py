"""The stages of a scene, one at a time (make runs them in order), and the tools around them."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from fileio.atomic import checksums_of
from fileio.checksum import check_whole
from fileio.command import Commands, add_scene, command_line
from fileio.errors import StageError
from fileio.lock import exclusive
from fileio.stages import BY_NAME, STAGES, Stage, until
from pipeline.cost import NOTHING, Spent, record_cost

TOOLS: Commands = {
    "settings": (
        "write what each stage depends on to settings/, where it changed",
        "pipeline.stage_settings",
    ),
    "couple": (
        "the motion that pressure and water make together, by whole runs",
        "pipeline.study.couple",
    ),
    "openfoam": ("say which OpenFOAM is found", "pipeline.openfoam.environment"),
    "plan": ("write the scenes of a study and its plan.json", "pipeline.study.plan"),
    "reuse": ("take over a stage's results from another run of a study", "pipeline.study.reuse"),
    "outcome": (
        "run a scene's stages to their end, whatever it is, and note it",
        "pipeline.study.outcome",
    ),
    "view": ("a time series of a run for ParaView", "pipeline.view.command"),
    "predict": (
        "how long a run takes on n ranks, and how many ranks pay",
        "pipeline.study.predict",
    ),
    "choose": ("the cheapest setting measured to reach an accuracy", "pipeline.study.ask_accuracy"),
    "speed": ("how fast this machine is now", "pipeline.study.machine_speed"),
    "scene-reference": (
        "write docs/scene_reference.md: every key of a scene",
        "pipeline.scene_reference",
    ),
    "fea-studies": ("pages of the bending analysis' studies", "pipeline.fea.studies.studies"),
}


@dataclass(frozen=True)
class StageCommand:
    """A stage of the table as a subcommand.

    Its module has run(scene, quiet, **options), or in postprocess run(scene_folder, level, quiet), and add_arguments(parser)
    where it takes options; a stage of piv is one of piv's commands.
    """

    stage: Stage

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        add_scene(parser)
        if self.stage.threads:
            parser.add_argument("--threads", type=int, default=1, help="(default: %(default)s)")
        if not self.stage.piv and (
            add := getattr(import_module(self.stage.module), "add_arguments", None)
        ):
            add(parser)

    def run(self, args: argparse.Namespace) -> int:
        options = {
            k: v for k, v in vars(args).items() if k not in ("command", "scene", "level", "quiet")
        }
        begin = time.monotonic()
        out = args.scene / "out" / args.level
        for before in until(self.stage.name):
            for name in before.outputs if before != self.stage else ():
                check_whole(out / name)
        own = self.stage in STAGES and not options.get(
            "output"
        )  # not into another file than the stage's own
        with checksums_of(out / name for name in self.stage.outputs if own):
            earlier = _run(self.stage, args.scene, args.level, args.quiet, options) or NOTHING
        if isinstance(earlier, int):
            return earlier
        if not options.get("output"):
            path = out / "costs" / f"{self.stage.name}.json"
            record_cost(path, self.stage.name, time.monotonic() - begin, earlier)
        return 0


def _run(
    stage: Stage, folder: Path, level: str, quiet: bool, options: dict[str, Any]
) -> Spent | int | None:
    """Run a stage; returns what the runs that it resumed had spent, or the exit code of a command of piv."""
    out = folder / "out" / level
    if stage.piv:
        source, settings = (
            out / BY_NAME[stage.inputs[0]].done,
            out / "settings" / f"{stage.target}.json",
        )
        words = [stage.piv, str(source), "-o", str(out / stage.done), "--settings", str(settings)]
        words += [word for key, value in options.items() for word in (f"--{key}", str(value))]
        return import_module("piv.__main__").main(words + ["--quiet"] * quiet)
    run = import_module(stage.module).run
    if stage.module.startswith("pipeline."):
        from pipeline.scene.scene import load_scene

        scene = load_scene(folder, level)
        target = options.get("output") or out / stage.name
        target.parent.mkdir(parents=True, exist_ok=True)
        with exclusive(target):
            return run(scene, quiet, **options)
    if not out.is_dir():
        raise StageError(
            f"{out}: nothing was run at level {level}; make {folder.name} LEVEL={level} does"
        )
    try:
        with exclusive(out / stage.name):
            return run(folder, level, quiet, **options)
    except ValueError as error:  # postprocess says so what is wrong with a file
        raise StageError(str(error)) from error


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    stages: Commands = {name: (stage.about, StageCommand(stage)) for name, stage in BY_NAME.items()}
    return command_line("softfinger", __doc__, {**stages, **TOOLS}, argv, strict=True)


if __name__ == "__main__":
    sys.exit(main())
