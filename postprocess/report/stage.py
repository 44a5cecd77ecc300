"""Stage report: report.html, one static page with everything inside it."""

import json
from pathlib import Path
from typing import Any

from pipeline.formats.records import COMPARISON, FIGURES, RUN
from pipeline.runs.estimate import duration
from pipeline.runs.stages import STAGES
from pipeline.scene.scene import Scene
from piv.files.atomic import write_text
from piv.files.record import read_record
from postprocess.evidence.stage_files import StageFiles
from postprocess.report import trust, wording
from postprocess.report.assumptions import flow_numbers, purpose, statements
from postprocess.report.page_template import data_uri, page_template


def make_report(files: StageFiles) -> Path:
    """Write report.html; FileNotFoundError for a missing input."""
    comparison = COMPARISON.read(files.required("comparison.json", "compare"))
    run = RUN.read(files.required("run/run.json", "solve"))
    index = files.required("figures/figures.json", "figures")
    scene = files.numbers
    figures = FIGURES.read(index)
    middle = comparison["middle_of_stroke_s"]
    parents, end = [scene.folder, *scene.parents], scene.motion.end_time
    error = trust.level_error(parents, files.level, middle, end)
    trial = error.trial
    sections = _sections(figures["entries"], index.parent)
    slider = sections["slider"]
    sentences, unquoted = wording.quoted(comparison, sections["flow"], bool(trial))
    pinch = comparison["summary"].get("pinch")
    page = page_template("report.html").render(
        title=scene.title,
        scene=files.scene,
        level=files.level,
        agrees=None if trial else comparison["verdict"]["agrees"],
        purpose=purpose(scene, trial, comparison["scale"]["value"], figures["tip_height"]),
        flow_numbers=flow_numbers(scene, comparison["scale"]["value"], figures["tip_way"], run),
        answer=wording.answer(comparison, trial),
        error=error,
        power=wording.power_sentence(run["power_balance"]),
        motion=figures["motion"],
        tiles=wording.tiles(comparison, error.end),
        rows=wording.rows(comparison, bool(trial)),
        sentences=sentences,
        unquoted=unquoted,
        judged=wording.judged_words(comparison),
        strokes=len(scene.motion.strokes),
        sections=sections,
        pinch=pinch,
        slider=slider,
        middle_frame=len(slider[0]["times"]) // 2,
        slider_data=json.dumps(
            {
                "times": slider[0]["times"],
                "frames": [entry["frames"] for entry in slider],
                "texts": sections["timeline"][0]["texts"],
                "end": error.end,
            }
        ),
        notes=wording.absences(comparison, finger=not scene.body),
        body="fingers" if pinch else "body" if scene.body else "finger",
        modelled=statements(scene, comparison["scale"]["value"], figures["tip_height"]),
        numbers=_numbers(files.out),
        run=run,
        costs=_costs(files.out, run["wall_time"]),
        provenance=comparison["provenance"],
        pretty=lambda value: json.dumps(value, indent=1, sort_keys=True, default=str),
    )
    path = files.out / "report.html"
    write_text(path, page)
    return path


def _sections(entries: list[dict[str, Any]], folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Pictures by section, each with its `data`, or of the slider with its `frames`."""
    sections: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        path = folder / entry["file"]
        if entry["section"] == "slider":
            frames = [_data_uri(path / f"frame_{n:03d}.webp") for n in range(len(entry["times"]))]
            more: dict[str, Any] = {"frames": frames}
        else:
            more = {"data": _data_uri(path)}
        sections.setdefault(entry["section"], []).append(entry | more)
    return sections


def _data_uri(path: Path) -> str:
    return data_uri(path.suffix, path.read_bytes())


def _records(out: Path) -> list[dict[str, Any]]:
    """The records of the stages before the report, in their order."""
    records = (read_record(out, stage.name) for stage in STAGES if stage.name != "report")
    return [dict(record) for record in records if record]


def _numbers(out: Path) -> dict[str, Any]:
    """The numbers of the scene that the stages before have used, by dotted key."""
    return {k: v for r in _records(out) for k, v in r["made_from"]["numbers"].items()}


def _costs(out: Path, solver_time: float) -> list[dict[str, Any]]:
    """Costs of the stages in their order; the report's own is not known yet.

    A resumed run records its last part alone, so its time is at least `solver_time` (s).
    """
    costs = _records(out)
    for cost in costs:
        if cost["stage"] == "solve":
            cost["wall_time"] = max(cost["wall_time"], solver_time)
    return costs


def outcome(scene: Scene) -> tuple[str, str]:
    """What a run has computed, and what it shows, of a run whose report is made."""
    out, files = scene.out, StageFiles(scene)
    comparison, run = COMPARISON.read(out / "comparison.json"), RUN.read(out / "run" / "run.json")
    middle, end = comparison["middle_of_stroke_s"], scene.motion.end_time
    trial = trust.level_error([scene.folder, *scene.parents], scene.level, middle, end).trial
    seconds = sum(cost["wall_time"] for cost in _costs(files.out, run["wall_time"]))
    warning = run["power_balance"].get("warning")
    warned = f". Warning: {warning}" if warning else ""
    return (
        f"{scene.name} at level {scene.level}: {run['cells']} cells ({run['model']}),"
        f" {run['steps']} steps to {scene.motion.end_time:g} s; its stages took"
        f" {duration(seconds)}, some at the same time{warned}",
        wording.answer(comparison, trial),
    )


def run(scene: Scene, quiet: bool = False) -> None:
    """Run the stage report."""
    make_report(StageFiles(scene))
