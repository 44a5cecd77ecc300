"""The page of a comparison with a laboratory, and its figures."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fileio.atomic import write_text
from postprocess.draw.animation import write_picture
from postprocess.draw.style import save
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.pictures import LabRecording
from postprocess.lab.judgement.case import Case
from postprocess.lab.registration.register import law_pressure
from postprocess.lab.report import answers, draw
from postprocess.report.page_template import page_template

PICTURE_DPI = 120
TYPES = {".svg": "svg+xml", ".png": "png", ".webp": "webp"}


def make_report(
    files: LabFiles, dpiv: Dpiv, case: Case, result: dict[str, Any], series: pd.DataFrame | None
) -> Path:
    """Write figures and report.html, or quick.html without a `series` of the flow."""
    drawn = _figures(files, dpiv, case, result, series)
    pictures = {path.stem: (_address(path), alt) for path, alt in drawn}
    path = files.folder / ("quick.html" if series is None else "report.html")
    write_text(path, page(files.stage.numbers.title, result, pictures))
    return path


def page(title: str, result: dict[str, Any], pictures: dict[str, tuple[str, str]]) -> str:
    """The page of a comparison; `pictures`: address and alternative text by name."""
    return page_template("lab.html").render(
        title=title,
        result=result,
        answer=answers.answer(result),
        rows=[answers.row(q) for q in result["quantities"]],
        pictures=pictures,
        registration=result["registration"],
        pretty=lambda value: json.dumps(value, indent=1, sort_keys=True),
    )


def _address(path: Path) -> str:
    return f"data:image/{TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _figures(
    files: LabFiles, dpiv: Dpiv, case: Case, result: dict[str, Any], series: pd.DataFrame | None
) -> list[tuple[Path, str]]:
    """Draws all figures; their files and alternative texts."""
    folder, registration, out = files.folder / "figures", case.registration, []
    kinematics, law, pose = case.kinematics, registration.law, registration.pose
    tight: dict[str, Any] = {"bbox_inches": "tight"}
    if series is not None and case.flow is not None:
        circulation = next(q for q in result["quantities"] if q["name"] == "circulation")
        path = save(draw.series(series, circulation), folder / "series.svg", **tight)
        out.append((path, "Circulation over time with 95 % bands"))
        image = draw.flow(case.flow, series, pose, float(np.mean(circulation["window"])))
        write_picture(image, folder / "flow.webp", quality=85)
        out.append((folder / "flow.webp", "Vectors of the recording beside the simulation's"))
    path = save(draw.motion(kinematics, registration), folder / "motion.svg", **tight)
    out.append((path, "Bend angle over time, simulation and recording"))
    if dpiv.kind == "pictures":
        with LabRecording(dpiv) as recording:
            middle = len(recording) // 2
            picture, time = recording.frame(middle), float(recording.times[middle])
        fitted = law_pressure(kinematics, np.array([time]), law.values)[0]
        outlines = (
            pose.to_px(kinematics.shape("outline", p))
            for p in (fitted, float(kinematics.law(time - law.delay)))
        )
        figure = draw.overlay(picture, *outlines)
        path = save(figure, folder / "picture.png", dpi=PICTURE_DPI, **tight)
        out.append((path, "A picture of the recording with the outline as fitted and as simulated"))
    return out
