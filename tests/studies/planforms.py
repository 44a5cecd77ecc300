"""How many planforms motions need, how good and how large they are: cases/pinch/studies/planforms.csv, into docs/mesh.md.

python -m tests.studies.planforms   (make planforms): of the meshes that are there
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pandas as pd

from fileio.command import guarded
from fileio.errors import StageError
from fileio.formats.mesh_intervals import read_intervals, read_planform
from fileio.formats.records import MESH_QUALITY
from pipeline.case import build_mesh
from pipeline.scene.scene import load_scene
from postprocess.studies.state import files_of, missing_runs
from postprocess.studies.table import read_plan, stage_costs
from tests.studies.pages import libraries, write_between

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "mesh.md"
PLAN = ROOT / "cases" / "pinch" / "out" / "studies" / "planforms" / "plan.json"


def row_of(run: dict[str, Any]) -> str:
    """Markdown: planforms, the largest non-orthogonality of each, the time above its scene's usual limit, cells, CPU time."""
    files = files_of(run)
    quality: pd.DataFrame = MESH_QUALITY.read(files.out / "mesh_quality.csv")
    meshes = sorted({interval.mesh for interval in read_intervals(files.out)})
    worst = quality.groupby("mesh")["max_non_orthogonality_deg"].max()
    usual = load_scene(files.scene_folder, files.level).mesh.usual_non_orthogonality_deg
    above = quality.loc[quality["max_non_orthogonality_deg"] > usual, "time_share"].sum()
    cells = [len(build_mesh(read_planform(files.out, mesh)).cell_layer) for mesh in meshes]
    span = f"{min(cells)}" if min(cells) == max(cells) else f"{min(cells)}–{max(cells)}"
    cpu = stage_costs(files, ["mesh"])[0]["cpu_mesh_s"]
    name, level = run["run"].replace("_", " "), run["level"]
    return (
        f"| {name if name == level else f'{name}, {level}'} | {len(meshes)} | {', '.join(f'{worst[k]:.0f}' for k in meshes)}"
        f" | {f'{100 * above:.1f} % of the time' if worst.max() > usual else 'never'} | {span} | {cpu:.0f} |"
    )


def main() -> None:
    """Command line."""

    def action() -> None:
        plan = read_plan(PLAN)
        missing = missing_runs(plan)
        if missing:
            raise StageError(
                f"planforms: not there: {', '.join(missing)}; make planforms makes them"
            )
        lines = [
            "| run, level | planforms | non-orthogonality | above the scene's usual limit, 70° by default | cells | CPU s |",
            "|---|---|---|---|---|---|",
            *(row_of(run) for run in plan["runs"]),
        ]
        write_between(PAGE, "planforms", "\n".join([*lines, "", f"{libraries()}."]))

    sys.exit(guarded("planforms", action))


if __name__ == "__main__":
    main()
