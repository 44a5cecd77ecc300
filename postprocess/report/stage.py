"""One static page that answers whether the simulation agrees with PIV: report.html, everything inside it.

Command: python -m postprocess.report.stage cases/single_finger --level coarse
"""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.formats.plane_series import read_plane
from postprocess.draw.solver import costs as draw_costs
from postprocess.draw.style import save
from postprocess.evidence.stage_command import run_stage
from postprocess.evidence.stage_files import StageFiles, read_json, scene_numbers, scene_title
from postprocess.report import wording
from postprocess.report.assumptions import statements
from postprocess.report.page_template import page_template
from postprocess.report.pinch_wording import pinch_table

MIME = {".png": "image/png", ".svg": "image/svg+xml", ".webp": "image/webp", ".mp4": "video/mp4"}
MAX_BYTES = 15_000_000
ORDER = (
    "kinematics",
    "mesh",
    "case",
    "run",
    "sheet",
    "sheets",
    "images",
    "piv",
    "vortices",
    "compare",
    "figures",
)


def data_uri(path: Path) -> str:
    """A file as a data: address; FileNotFoundError in one sentence where it is missing."""
    if not path.exists():
        raise FileNotFoundError(
            f"{path} is listed in figures.json and missing; run the stage 'figures' again"
        )
    return f"data:{MIME[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def pictures(files: StageFiles) -> dict[str, list[dict[str, Any]]]:
    """The index of figures by section, each picture with its `data`; the slider's with its frames."""
    index = files.required("figures/figures.json", "figures")
    sections: dict[str, list[dict[str, Any]]] = {}
    for entry in read_json(index, list):
        path = files.figures / entry["file"]
        if entry["section"] == "slider":
            frames = [data_uri(path / f"frame_{n:03d}.webp") for n in range(len(entry["times"]))]
            entry = entry | {"frames": frames}
        else:
            entry = entry | {"data": data_uri(path)}
        sections.setdefault(entry["section"], []).append(entry)
    return sections


def read_costs(files: StageFiles, solver_time: float) -> list[dict[str, Any]]:
    """costs/*.json in the order of the stages; unknown stages last. The report's own cost is not known yet.

    A run that was resumed records its last leg alone, so its time is at least `solver_time` (s), that of all legs.
    """
    found = {p.stem: read_json(p) for p in sorted((files.out / "costs").glob("*.json")) if p.stem != "report"}
    if "run" in found:
        found["run"]["wall_time"] = max(found["run"]["wall_time"], solver_time)
    names = [n for n in ORDER if n in found] + [n for n in found if n not in ORDER]
    return [found[n] for n in names]


def absences(files: StageFiles, sections: dict[str, Any], comparison: dict[str, Any]) -> list[str]:
    """One sentence for every optional part that is not on the page."""
    notes = []
    if files.optional("piv.h5") is None:
        notes.append(
            f"PIV was not run at level {files.level}: every picture shows the CFD alone and no agreement is judged."
        )
    elif "piv" not in comparison["summary"]:
        notes.append(
            "PIV shows no vortex near the tip in the middle of the stroke, so the two vortices are not compared."
        )
    if "cfd" not in comparison["summary"]:
        notes.append(
            "The CFD shows no vortex near the tip in the middle of the stroke, so its series is not drawn."
        )
    if "camera" not in sections:
        notes.append("No recording (images.h5) is kept for this level, so no camera picture is shown.")
    if files.optional("uncertainty.json") is None:
        notes.append(
            "The uncertainty of the finger's shape and pressure (FEA band) was not propagated: bands show the measurement alone."
        )
    return notes


def tip_top(files: StageFiles) -> float:
    """Highest position of the finger's tip, m above the bottom."""
    with read_plane(files.required("sheet.h5", "sheet")) as plane:
        return float(plane["tip"].values[..., 1].max())


def render(files: StageFiles) -> str:
    """The page as text; FileNotFoundError or ValueError in one sentence where a required input is missing."""
    comparison = read_json(files.required("comparison.json", "compare"))
    run = read_json(files.required("run/run.json", "run"))
    sections = pictures(files)
    stages = read_costs(files, run["wall_time"])
    if stages:
        save(draw_costs(stages), files.figures / "costs.svg")
    scene = scene_numbers(files)
    slider = sections.get("slider", [None])[0]
    pinch = comparison["summary"].get("pinch")
    pinch_columns, pinch_rows = pinch_table(pinch) if pinch else ([], [])
    return page_template("report.html").render(
        title=scene_title(files.case),
        scene=files.scene,
        level=files.level,
        agrees=comparison["verdict"]["agrees"],
        answer=wording.answer(comparison),
        tiles=wording.tiles(comparison),
        rows=wording.rows(comparison),
        middle=comparison["middle_of_stroke_s"],
        sections=sections,
        pinch=pinch,
        pinch_columns=pinch_columns,
        pinch_rows=pinch_rows,
        slider=slider,
        slider_data=json.dumps({"times": slider["times"], "frames": slider["frames"]}) if slider else "",
        notes=absences(files, sections, comparison),
        modelled=statements(scene, comparison["scale"]["value"], tip_top(files)),
        numbers=scene,
        run=run,
        costs=stages,
        costs_picture=data_uri(files.figures / "costs.svg") if stages else "",
        total_time=sum(s["wall_time"] for s in stages),
        peak_memory=max((s["peak_memory"] for s in stages), default=0),
        provenance=comparison["provenance"],
        pretty=lambda value: json.dumps(value, indent=1, sort_keys=True, default=str),
    )


def make_report(files: StageFiles) -> Path:
    """Write report.html; ValueError where it grows beyond what a browser opens with ease."""
    page = render(files)
    if len(page.encode()) > MAX_BYTES:
        raise ValueError(
            f"{files.out / 'report.html'} would have {len(page.encode()) / 1e6:.0f} MB, more than {MAX_BYTES / 1e6:.0f}; lower FRAMES in postprocess/report/figures.py"
        )
    path = files.out / "report.html"
    write_text(path, page)
    return path


def _tell(files: StageFiles, path: Path) -> None:
    print(path)


def main(argv: list[str] | None = None) -> int:
    """Command line; returns 0 good, 2 bad input."""
    return run_stage("report", __doc__, make_report, _tell, argv)


if __name__ == "__main__":
    sys.exit(main())
