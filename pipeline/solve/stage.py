"""Stage solve: the solver, interval by interval; it resumes, guards and writes tables."""

from pathlib import Path

from tqdm import tqdm

from pipeline.case import write_numbers
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import PER_FINGER, read_meshes
from pipeline.formats.records import RUN
from pipeline.openfoam.displacement_files import Steps, remove_frames, steps_of
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.ranks import LEAST_CELLS, Ranks
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import prepared_for, resumable_ranks
from pipeline.solve.coupled import Coupled, Follower
from pipeline.solve.guards import guard_of, power_warning
from pipeline.solve.prepare import prepare
from pipeline.solve.results import collect_results
from pipeline.solve.solver import BAR, resumes_rightly, solve
from piv.files.errors import StageError
from piv.files.lock import exclusive
from piv.files.provenance import versions


def run(scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None
        ) -> dict[str, float]:  # fmt: skip
    """Solve and write the tables of run/; returns the cost of interrupted runs."""
    if hosts is not None and scene.coupled:
        raise StageError(f"hosts = {hosts}: a coupled run takes this machine alone; leave it out")
    hosts = hosts and hosts.resolve()  # the solver runs in another folder
    version = foam_version()
    end, step = scene.motion.end_time, scene.numerics.time_step
    kind = scene.model.kind
    coupled = Coupled(scene) if scene.coupled else None
    meshes = read_meshes(scene.out, read_kinematics(scene.out / "kinematics.h5").law)
    guesses = list(meshes)
    intervals = [mesh.interval for mesh in meshes]
    cases = [scene.out / "case" / interval.name for interval in intervals]
    steps = [Steps.of(interval.begin, interval.end, step) for interval in intervals]
    limit, depth = scene.numerics.max_courant, scene.finger.width / PER_FINGER[kind]
    try:
        guards = [
            guard_of(case, mesh, its, limit, depth, scene.fluid)
            for case, mesh, its in zip(cases, meshes, steps, strict=True)
        ]
    except ValueError as error:
        raise StageError(f"{scene.folder / 'scene.toml'}: {error}") from None
    with exclusive(scene.out / "solver"):
        least = min(mesh.cells for mesh in meshes)
        useful = max(1, min(ranks, least // LEAST_CELLS))
        if useful < ranks and not quiet:
            print(f"run: {least} cells are too few for {ranks} ranks; {useful} used")
        moving = meshes[0].interval.moving
        layout = resumable_ranks(cases[0], moving, Ranks(useful), quiet)
        spent, quality = [], []
        with tqdm(total=end, unit="s", disable=quiet or None, desc="solver",
                  bar_format=BAR) as bar:  # fmt: skip
            for k, (case, guard) in enumerate(zip(cases, guards, strict=True)):
                interval, follower = meshes[k].interval, None
                if coupled:
                    follower = Follower(coupled, case, guesses[k], layout)
                    meshes[k] = follower.mesh()
                    if k and not prepared_for(case):
                        follower.write_case(intervals)
                # what was edited by hand, and the start of an earlier solver
                write_numbers(scene, intervals, interval, meshes[k].planform)
                lay = follower.lay_frames if follower else None
                prepare(cases, meshes, k, layout, steps[k], quiet, lay)
                rightly = resumes_rightly(version, kind, scene.pinch is not None, interval.moving)
                spent.append(solve(case, interval, layout, hosts, bar, guard, rightly, follower))
                remove_frames(case, layout)
                if follower:
                    follower.catch_up(steps_of(interval.end, step))
                    meshes[k] = follower.mesh()
                    quality += follower.quality
                bar.update(interval.end - bar.n)
        if coupled:
            coupled.write(meshes, quality)
        budgets = [guard.energy.budget for guard in guards if guard.energy]
        convection = scene.numerics.convection
        summary = collect_results(
            scene.out, cases, meshes, layout, scene.fluid, convection, budgets,
            coupled.contact if coupled else None,
        )  # fmt: skip
    balance = summary["power_balance"]
    balance["warning"] = power_warning(balance["unexplained_share"], budgets, step)
    wall_time = round(sum(float(now["wall_time"]) for _, now in spent), 2)
    about = {
        "versions": {"OpenFOAM": version} | versions(),
        "scene": scene.name,
        "level": scene.level,
        "model": kind,
        "ranks": layout.count,
        "time_step": step,
        "end_time": end,
        "steps": steps_of(end, step),
        "wall_time": wall_time,
        "resumed": [at for _, now in spent for at in now["resumed"]],
    }
    RUN.write(scene.out / "run" / "run.json", about | summary)
    if not quiet:
        rest = 100 * abs(balance["unexplained_fraction"])
        times = ", ".join(f"{at:g} s" for _, now in spent for at in now["resumed"])
        more = f", resumed at {times}" if times else ""
        print(f"solve: {wall_time:.0f} s of solver{more}, {rest:.1f} % of the power unexplained")
        if balance["warning"]:
            print(f"solve: warning: {balance['warning']}")
    return {name: sum(before[name] for before, _ in spent) for name in ("wall_time", "cpu_time")}
