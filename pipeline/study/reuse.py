"""Take over a stage's results from another run of a study that has the same settings up to that stage."""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

from fileio.atomic import checksum_file, checksums_of, unlink_folders, whole
from fileio.checksum import check_whole
from fileio.stages import BY_NAME, STAGES


def reuse(source: Path, target: Path, stage: str) -> None:
    """Take a stage's results from one level's folder to another's: copies of its files, the names of its folders.

    Snakemake dates what a rule has made anew: with a hard link the other run's file would seem new, and be made into its later
    stages again. Only the solver's case is a folder: Snakemake deletes what a rule will make, and would reach the other
    run's files through the name of a folder. The names of folders are taken away with the run alone: what was taken over of it stays
    when a later stage is taken over anew.
    """
    if stage == "run":
        unlink_folders(target)
    files = BY_NAME[stage].outputs[::-1]  # last the one that says that it is done
    for name in (f"costs/{stage}.json", *files):
        old, new = source / name, target / name
        if not old.exists():
            continue
        new.parent.mkdir(parents=True, exist_ok=True)
        if new.is_symlink() or new.is_file():
            new.unlink()
        elif new.is_dir():
            shutil.rmtree(new)
        if old.is_dir():
            new.symlink_to(os.path.relpath(old.resolve(), new.parent.resolve()))
        else:
            check_whole(old)
            with checksums_of([new] * checksum_file(old).exists()), whole(new, sync=False) as part:
                shutil.copy2(old, part)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `reuse`."""
    parser.add_argument(
        "source", type=Path, help="out/<level> of the run that has computed the stage"
    )
    parser.add_argument("target", type=Path, help="out/<level> of the run that takes it over")
    parser.add_argument("stage", choices=[stage.name for stage in STAGES if stage.shared])


def run(args: argparse.Namespace) -> None:
    """Command `reuse`."""
    reuse(args.source, args.target, args.stage)
