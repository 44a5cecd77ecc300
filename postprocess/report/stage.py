"""One static page that answers whether the simulation agrees with PIV: report.html, everything inside it."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.formats.finger_loads import deflection_sentence, read_loads
from fileio.formats.plane_series import read_plane
from fileio.formats.records import COMPARISON, FIGURES, RUN
from fileio.record import read_record
from pipeline.runs.stages import STAGES
from pipeline.scene.scene import Scene
from postprocess.draw.solver import costs as draw_costs
from postprocess.draw.style import save
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.report import trust, wording
from postprocess.report.assumptions import statements
from postprocess.report.page_template import page_template
from postprocess.report.pinch_wording import pinch_table

MIME = {".png": "image/png", ".svg": "image/svg+xml", ".webp": "image/webp", ".mp4": "video/mp4"}
MAX_BYTES = 15_000_000


def data_uri(path: Path) -> str:
    """A file as a data: address; FileNotFoundError in one sentence where it is missing."""
    if not path.exists():
        raise FileNotFoundError(
            f"{path} is listed in figures.json and missing; run the stage 'figures' again"
        )
    return f"data:{MIME[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def pictures(index: Path) -> dict[str, list[dict[str, Any]]]:
    """figures.json by section, each picture with its `data`; the slider's with its frames."""
    sections: dict[str, list[dict[str, Any]]] = {}
    for entry in FIGURES.read(index)["entries"]:
        path = index.parent / entry["file"]
        if entry["section"] == "slider":
            frames = [data_uri(path / f"frame_{n:03d}.webp") for n in range(len(entry["times"]))]
            entry = entry | {"frames": frames}
        else:
            entry = entry | {"data": data_uri(path)}
        sections.setdefault(entry["section"], []).append(entry)
    return sections


def read_costs(out: Path, solver_time: float) -> list[dict[str, Any]]:
    """What each stage has cost, but for the report itself.

    A run that was resumed records its last part alone: its time is at least `solver_time` (s).
    """
    records = (read_record(out, stage.name) for stage in STAGES if stage.name != "report")
    costs = [dict(record) for record in records if record]
    for cost in costs:
        if cost["stage"] == "run":
            cost["wall_time"] = max(cost["wall_time"], solver_time)
    return costs


def absences(comparison: dict[str, Any], sections: dict[str, Any], finger: bool) -> list[str]:
    """One sentence for every optional part that is not on the page; `finger`: of a finger, not of a rigid body."""
    seen, has_piv = comparison["summary"], "piv" in comparison["sources"]
    notes = {
        "The scene has no findings (reference/findings.toml): agreement of PIV with the CFD is judged and nothing else.":
            comparison["provenance"]["findings_sha256"] is None,
        f"PIV was not run at level {comparison['level']}: every picture shows the CFD alone and no agreement is judged.":
            not has_piv,
        "PIV shows no vortex near the tip in the middle of the stroke, so the two vortices are not compared.":
            has_piv and "piv" not in seen,
        "The CFD shows no vortex near the tip in the middle of the stroke, so its series is not drawn.":
            "cfd" not in seen,
        "No recording (images.h5) is kept for this level, so no camera picture is shown.": "camera" not in sections,
        "The uncertainty of the finger's shape and pressure (FEA band) was not propagated: bands show the measurement alone.":
            finger,
    }  # fmt: skip
    return [note for note, holds in notes.items() if holds]


def render(files: StageFiles) -> str:
    """The page as text; FileNotFoundError or ValueError in one sentence where a required input is missing."""
    comparison = COMPARISON.read(files.required("comparison.json", "compare"))
    run = RUN.read(files.required("run/run.json", "run"))
    sections = pictures(files.required("figures/figures.json", "figures"))
    loads = files.optional("loads.h5")
    errors = trust.level_errors(files.numbers)
    trial = trust.trial(errors, files.level)
    stages = read_costs(files.out, run["wall_time"])
    if stages:
        save(draw_costs(stages), files.figures / "costs.svg")
    scene = scene_numbers(files)
    with read_plane(files.required("sheet.h5", "sheet")) as plane:
        tip_height = float(plane["tip"].values[..., 1].max())
    slider = sections.get("slider", [None])[0]
    pinch = comparison["summary"].get("pinch")
    pinch_columns, pinch_rows = pinch_table(pinch) if pinch else ([], [])
    return page_template("report.html").render(
        title=files.numbers.title,
        scene=files.scene,
        level=files.level,
        agrees=None if trial else comparison["verdict"]["agrees"],
        answer=wording.answer(comparison, trial),
        numerics=trust.level_sentence(errors, files.scene, files.level),
        power=trust.power_sentence(run["power_balance"]),
        deflection=deflection_sentence(read_loads(loads).attrs) if loads else "",
        tiles=wording.tiles(comparison),
        rows=wording.rows(comparison),
        sentences=wording.sentence_rows(comparison),
        middle=comparison["middle_of_stroke_s"],
        sections=sections,
        pinch=pinch,
        pinch_columns=pinch_columns,
        pinch_rows=pinch_rows,
        slider=slider,
        slider_data=json.dumps({"times": slider["times"], "frames": slider["frames"]})
        if slider
        else "",
        notes=absences(comparison, sections, finger=not scene.get("body")),
        body="fingers" if pinch else "body" if scene.get("body") else "finger",
        modelled=statements(scene, comparison["scale"]["value"], tip_height),
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
            f"{files.out / 'report.html'} would have {len(page.encode()) / 1e6:.0f} MB, more than {MAX_BYTES / 1e6:.0f}; lower FRAMES in postprocess/report/flow_figures.py"
        )
    path = files.out / "report.html"
    write_text(path, page)
    return path


def run(scene: Scene, quiet: bool = False) -> None:
    """Stage report."""
    path = make_report(StageFiles(scene))
    if not quiet:
        print(path)
