"""Stage case: one OpenFOAM case for each mesh interval, and the columns of their meshes."""

import shutil
from dataclasses import replace

from pipeline.case.interval_case import build_mesh, write_interval
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import SWEEP, NodeMotion, read_intervals, read_planform
from pipeline.openfoam.base_case import template_files
from pipeline.scene.current import LEAD, lead_steps
from pipeline.scene.scene import Scene
from piv.files.lock import exclusive


def run(scene: Scene, quiet: bool = False) -> None:
    """Write the folders `case/interval_<k>` and `sweep.h5` (the columns of their meshes)."""
    folder = scene.out / "case"
    template_files()  # raises before the old case is deleted
    intervals = read_intervals(scene.out)
    planforms = {
        number: read_planform(scene.out, number)
        for number in {interval.mesh for interval in intervals}
    }
    law = read_kinematics(scene.out / "kinematics.h5").law
    meshes = {number: build_mesh(plan, scene.current) for number, plan in planforms.items()}
    # its case is deleted below
    (scene.out / "run" / "run.json").unlink(missing_ok=True)
    folder.mkdir(exist_ok=True)
    with exclusive(scene.out / "solver"):  # a running solver uses the case
        for old in folder.iterdir():
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        columns = {}
        for interval in intervals:
            planform, mesh = planforms[interval.mesh], meshes[interval.mesh]
            names = ("node", "level", "cell_column", "cell_layer")
            columns[interval.name] = {name: getattr(mesh, name) for name in names}
            if interval.index and scene.coupled:
                continue  # made in the run, in the shape that the finger then has
            nodes = NodeMotion.of(law, planform).nodes(interval.begin)
            write_interval(scene, intervals, interval, planform, mesh, nodes)
        if steps := lead_steps(scene):  # the finger is at rest
            lead = replace(intervals[0], end=steps * scene.numerics.time_step, moving=False)
            planform, mesh = planforms[lead.mesh], meshes[lead.mesh]
            nodes = NodeMotion.of(law, planform).nodes(0.0)
            write_interval(scene, [lead], lead, planform, mesh, nodes, LEAD)
    SWEEP.write(scene.out / "sweep.h5", {}, columns)
    if not quiet:
        cells = [len(columns[interval.name]["cell_column"]) for interval in intervals]
        print(f"case: {' + '.join(map(str, cells))} cells in {folder}")
