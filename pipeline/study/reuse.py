"""Take over a stage's results from another run of a study that has the same settings up to that stage.

Command: python -m pipeline.study.reuse cases/…/out/coarse cases/…/other/out/coarse mesh
"""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

from fileio.atomic import unlink_folders, whole
from fileio.command import guarded

# What each stage leaves behind, besides its costs; a run's case folder goes with it.
FILES = {
    "kinematics": ("kinematics.h5",),
    "mesh": ("planform.h5", "mesh_quality.csv"),
    "case": ("sweep.h5",),
    "run": ("case", "run/forces.csv", "run/power.csv", "run/history.csv", "run/run.json"),
    "sheet": ("sheet.h5",),
    "images": ("images.h5", "images_truth.h5"),
    "piv": ("piv.h5",),
    "vortices_cfd": ("vortices_cfd.csv",),
    "vortices_piv": ("vortices_piv.csv",),
}
MODULES = {"sheet": "sheets"}  # stages whose module, and so their cost, goes by another name


def link(source: Path, target: Path, stage: str) -> None:
    """Take a stage's results from one level's folder to another's: copies of its files, the names of its folders.

    Snakemake dates what a rule has made anew: with a hard link the other run's file would seem new, and be made into its later
    stages again. Only the solver's case is a folder: Snakemake deletes what a rule will make, and would reach the other
    run's files through the name of a folder. The names of folders are taken away with the run alone: what was taken over of it stays
    when a later stage is taken over anew.
    """
    if stage == "run":
        unlink_folders(target)
    for name in (*FILES[stage], f"costs/{MODULES.get(stage, stage)}.json"):
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
            with whole(new, sync=False) as part:
                shutil.copy2(old, part)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.study.reuse", description=__doc__)
    parser.add_argument("source", type=Path, help="out/<level> of the run that has computed the stage")
    parser.add_argument("target", type=Path, help="out/<level> of the run that takes it over")
    parser.add_argument("stage", choices=FILES)
    args = parser.parse_args()
    guarded("link", lambda: link(args.source, args.target, args.stage))


if __name__ == "__main__":
    main()
