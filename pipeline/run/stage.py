"""Stage run: the solver, interval by interval, through MPI where asked; resumes, guards, and writes its results as tables."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from fileio.atomic import write_text
from fileio.cost import Spent
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_intervals, read_planform
from fileio.formats.sweep import read_sweep
from fileio.lock import only_one
from fileio.provenance import versions
from pipeline.openfoam.displacement_files import remove_frames, steps_of
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.ranks import LEAST_CELLS, Ranks
from pipeline.run.checkpoint import last_checkpoint
from pipeline.run.checks import energy_from_nothing, guards_of
from pipeline.run.prepare import case_state, prepare, prepared_for
from pipeline.run.results import collect_results, copies_of
from pipeline.run.solver import BAR, read_progress, solve
from pipeline.scene.scene import Scene


def useful_ranks(scene: Scene, intervals: tuple[Interval, ...], ranks: int, quiet: bool) -> int:
    """`ranks`, or fewer where a mesh is too small for them."""
    sizes = [read_sweep(scene.out, interval.name).sizes["cell"] for interval in intervals]
    useful = max(1, min(ranks, min(sizes) // LEAST_CELLS))
    if useful < ranks and not quiet:
        print(f"run: {min(sizes)} cells are too few for {ranks} ranks; {useful} used")
    return useful


def begun_ranks(case: Path, moving: bool, ranks: Ranks, quiet: bool) -> Ranks:
    """`ranks`, or those of an interrupted run that can be gone on with: its fields lie in its ranks' files.

    `case` is the folder of the first interval, whose mesh is `moving` or not: the others follow it.
    """
    began = prepared_for(case)
    earlier = Ranks(began.get("ranks", 0), bool(began.get("collated", False)))
    if began != case_state(case, earlier) or earlier == ranks:
        return ranks
    if last_checkpoint(case, earlier, moving) is None:
        return ranks
    if not quiet:
        print(
            f"run: goes on with the {_words(earlier)} it began with, not {_words(ranks)} (remove {case.parent} to begin anew)"
        )
    return earlier


def _words(ranks: Ranks) -> str:
    return f"{ranks.count} ranks" + (", collated," if ranks.collated else "")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the stage."""
    parser.add_argument("--ranks", type=int, default=1, help="MPI ranks (default: %(default)s)")
    parser.add_argument("--hosts", type=Path, help="MPI host file")
    parser.add_argument("--collated", action="store_true", help="one file for all ranks, not one for each")


def run(scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None,
        collated: bool = False) -> Spent:  # fmt: skip
    """Solve and write run/forces.csv, power.csv, history.csv and, last, run.json; returns what earlier runs spent.

    `collated`: the ranks share their files.
    """
    if ranks < 1:
        raise StageError(f"--ranks {ranks}: give 1 or more")
    if hosts is not None and not hosts.is_file():
        raise StageError(f"--hosts {hosts}: no such file; give an MPI host file, one host per line")
    hosts = hosts and hosts.resolve()  # the solver runs in another folder
    version = foam_version()
    earlier = Spent()
    case, end, step = scene.out / "case", scene.motion.end_time, scene.numerics.time_step
    intervals = read_intervals(scene.out)
    guards = guards_of(scene, intervals)
    with only_one(case):
        useful = useful_ranks(scene, intervals, ranks, quiet)
        layout = begun_ranks(
            case / intervals[0].name, intervals[0].moving, Ranks(useful, collated and useful > 1), quiet
        )
        with tqdm(total=end, unit="s", disable=quiet or None, desc="solver", bar_format=BAR) as bar:
            handovers = [*(interval.begin(step) for interval in intervals[1:]), end]
            for interval, handover, guard in zip(intervals, handovers, guards, strict=True):
                folder = case / interval.name
                prepare(scene, intervals, interval, layout, quiet)
                before = read_progress(folder)
                earlier += Spent(before["wall_time"], before["cpu_time"])
                solve(folder, interval, handover, scene.numerics, layout, hosts, bar, guard)
                for place in layout.folders(folder):
                    remove_frames(place)
                bar.update(interval.end - bar.n)
        spent = [read_progress(case / interval.name) for interval in intervals]
        record: dict[str, Any] = {
            "wall_time": round(sum(float(s["wall_time"]) for s in spent), 2),
            "resumed": [at for s in spent for at in s["resumed"]],
        }
        summary = collect_results(scene, intervals, scene.out / "run")
        power = np.loadtxt(scene.out / "run" / "power.csv", delimiter=",", skiprows=1, ndmin=2)
        copies = copies_of(read_planform(scene.out, intervals[0].mesh))
        summary["power_balance"]["from_nothing_fraction"] = energy_from_nothing(power, guards, copies)
    write_text(
        scene.out / "run" / "run.json",
        json.dumps(
            {
                "format": "run",
                "format_version": 3,
                "versions": {"OpenFOAM": version} | versions(),
                "scene_hash": scene.digest(),
                "scene": scene.name,
                "level": scene.level,
                "model": scene.model.kind,
                "ranks": layout.count,
                "collated": layout.collated,
                "time_step": step,
                "end_time": end,
                "steps": steps_of(end, step),
            }
            | record
            | summary,
            indent=1,
        )
        + "\n",
    )
    if not quiet:
        balance = summary["power_balance"]
        print(
            f"run: {record['wall_time']:.0f} s of solver, power balance closes to {balance['closure_fraction']:.1%}"
        )
    return earlier
