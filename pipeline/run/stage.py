"""Stage run: the solver, interval by interval; it resumes, guards and writes tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from fileio.errors import StageError
from fileio.formats.mesh_intervals import read_intervals, read_planform
from fileio.formats.records import POWER, RUN
from fileio.formats.sweep import read_sweep
from fileio.lock import exclusive
from fileio.provenance import versions
from pipeline.cost import Spent
from pipeline.openfoam.displacement_files import Steps, remove_frames, steps_of
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.ranks import LEAST_CELLS, Ranks
from pipeline.run.checkpoint import last_checkpoint
from pipeline.run.energy import energy_from_nothing
from pipeline.run.guards import guard_of
from pipeline.run.power_terms import term_rows
from pipeline.run.prepare import case_state, prepare, prepared_for, prepared_ranks
from pipeline.run.results import collect_results, copies_of
from pipeline.run.solver import BAR, read_progress, solve
from pipeline.scene.scene import Scene


def _resumable_ranks(case: Path, moving: bool, ranks: Ranks, quiet: bool) -> Ranks:
    """The ranks of an interrupted run that can be resumed, else `ranks`.

    `case`: folder of the first interval, whose mesh is `moving` or not; the others follow it.
    """
    earlier = prepared_ranks(case)
    known = earlier != ranks and prepared_for(case) == case_state(case, earlier)
    if not known or last_checkpoint(case, earlier, moving) is None:
        return ranks
    if not quiet:
        print(
            f"run: resumes with {earlier}, not {ranks} (remove {case.parent} to start again from"
            " the beginning)"
        )
    return earlier


def resumes_rightly(version: str, kind: str, pinch: bool, moving: bool) -> bool:
    """Whether a resumed run ends as an undisturbed one.

    Versions after v1912 lose the checkpoint's mesh flux where a symmetry plane needs the geometry
    first (docs/openfoam_versions.md); in 2-D only a pinch has one.
    """
    return version == "v1912" or not moving or (kind == "2d" and not pinch)


def run(scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None,
        collated: bool = False) -> Spent:  # fmt: skip
    """Solve and write the tables of run/ and, last, run.json; returns the cost of interrupted runs.

    `collated`: the ranks share their files.
    """
    if ranks < 1:
        raise StageError(f"ranks = {ranks}: give 1 or more")
    if hosts is not None and not hosts.is_file():
        raise StageError(f"hosts = {hosts}: no such file; give an MPI host file, one host per line")
    hosts = hosts and hosts.resolve()  # the solver runs in another folder
    version = foam_version()
    earlier = Spent()
    out, end, step = scene.out, scene.motion.end_time, scene.numerics.time_step
    intervals = read_intervals(out)
    steps = [Steps.of(i.begin, i.end, step) for i in intervals]
    kind = scene.model.kind
    depth = scene.finger.width * (1.0 if kind in ("2d", "full") else 0.5)
    fluid = scene.fluid.density, scene.fluid.kinematic_viscosity
    limit = scene.numerics.max_courant
    try:
        guards = [
            guard_of(out, i, s, limit, depth, *fluid) for i, s in zip(intervals, steps, strict=True)
        ]
    except StageError:
        raise
    except ValueError as error:
        raise StageError(f"{scene.folder / 'scene.toml'}: {error}") from None
    cells = [read_sweep(out, interval.name).sizes["cell"] for interval in intervals]
    cases = [out / "case" / interval.name for interval in intervals]
    with exclusive(out / "solver"):
        useful = max(1, min(ranks, min(cells) // LEAST_CELLS))
        if useful < ranks and not quiet:
            print(f"run: {min(cells)} cells are too few for {ranks} ranks; {useful} used")
        layout = _resumable_ranks(
            cases[0], intervals[0].moving, Ranks(useful, collated and useful > 1), quiet
        )
        with tqdm(total=end, unit="s", disable=quiet or None, desc="solver", bar_format=BAR) as bar:
            for interval, case, guard, its in zip(intervals, cases, guards, steps, strict=True):
                prepare(out, intervals, interval, layout, its, quiet)
                before = read_progress(case)
                earlier += Spent(before["wall_time"], before["cpu_time"])
                rightly = resumes_rightly(version, kind, scene.pinch is not None, interval.moving)
                solve(case, interval, layout, hosts, bar, guard, rightly)
                for folder in layout.folders(case):
                    remove_frames(folder)
                bar.update(interval.end - bar.n)
        spent = [read_progress(case) for case in cases]
        record: dict[str, Any] = {
            "wall_time": round(sum(float(s["wall_time"]) for s in spent), 2),
            "resumed": [at for s in spent for at in s["resumed"]],
        }
        convection = scene.numerics.convection
        terms = np.vstack(
            [term_rows(out, interval, layout, *fluid, convection) for interval in intervals]
        )
        summary = collect_results(out, intervals, cells, *fluid, terms)
        power = POWER.read(out / "run" / "power.csv").to_numpy()
        copies = copies_of(read_planform(out, intervals[0].mesh))
        budgets = [guard.energy.budget for guard in guards if guard.energy]
        summary["power_balance"]["from_nothing_fraction"] = energy_from_nothing(
            power, budgets, copies
        )
    about = {
        "versions": {"OpenFOAM": version} | versions(),
        "scene": scene.name,
        "level": scene.level,
        "model": kind,
        "ranks": layout.count,
        "collated": layout.collated,
        "time_step": step,
        "end_time": end,
        "steps": steps_of(end, step),
    }
    RUN.write(out / "run" / "run.json", about | record | summary)
    if not quiet:
        rest = 100 * abs(summary["power_balance"]["unexplained_fraction"])
        print(
            f"run: {record['wall_time']:.0f} s of solver, {rest:.1f} % of the power balance"
            " unexplained"
        )
    return earlier
