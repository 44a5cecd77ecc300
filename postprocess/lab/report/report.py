"""The page of a comparison with a laboratory, and its figures (SVG and PDF)."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fileio.atomic import write_text
from fileio.formats.kinematics import read_kinematics
from fileio.formats.records import LAB_COMPARISON
from postprocess.draw.style import save
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.files import LabFiles, read_registration
from postprocess.lab.data.pictures import LabRecording
from postprocess.lab.registration.register import law_pressure
from postprocess.lab.report import answers, draw
from postprocess.report.page_template import page_template

PICTURE_DPI = 120


def make_report(files: LabFiles, dpiv: Dpiv) -> Path:
    """Write figures and report.html; FileNotFoundError where the comparison was not run."""
    if not files.comparison.exists():
        raise FileNotFoundError(f"{files.comparison} is missing; run make compare first")
    result = LAB_COMPARISON.read(files.comparison)
    pictures = {
        n: (_saved(files, n, figure), alt) for n, figure, alt in _figures(files, dpiv, result)
    }
    path = files.folder / "report.html"
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


def _saved(files: LabFiles, name: str, figure: Figure) -> str:
    """The figure on disk as SVG and PDF, and as an address for the page; pictures as bitmaps."""
    folder = files.folder / "figures"
    svg = save(figure, folder / f"{name}.svg", bbox_inches="tight")
    save(figure, folder / f"{name}.pdf", bbox_inches="tight")
    if name == "picture":
        svg = save(figure, folder / f"{name}.png", dpi=PICTURE_DPI, bbox_inches="tight")
    kind = "svg+xml" if svg.suffix == ".svg" else "png"
    return f"data:image/{kind};base64,{base64.b64encode(svg.read_bytes()).decode()}"


def _figures(
    files: LabFiles, dpiv: Dpiv, result: dict[str, Any]
) -> Iterator[tuple[str, Figure, str]]:
    """All figures: name, figure and alternative text."""
    registration = read_registration(files.registration)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    table = pd.read_csv(files.folder / "series.csv")
    by_name = {q["name"]: q for q in result["quantities"]}
    alt = "Circulation over time with 95 % bands"
    yield "series", draw.series(table, by_name, tuple(result["window_s"])), alt
    law = registration.law
    bends = registration.times - law.delay, kinematics.bend(registration.pressures)
    figure = draw.motion(table, result["registration"], *bends)
    yield "motion", figure, "Bend angle over time, simulation and recording"
    if dpiv.kind == "pictures":
        with LabRecording(dpiv) as recording:
            middle = len(recording) // 2
            picture, time = recording.frame(middle), float(recording.times[middle])
        fitted = law_pressure(kinematics, np.array([time]), law.values)[0]
        pressures = fitted, float(kinematics.law(time - law.delay))
        outlines = (registration.pose.to_px(kinematics.shape("outline", p)) for p in pressures)
        alt = "A picture of the recording with the finger's outline as fitted and as simulated"
        yield "picture", draw.overlay(picture, *outlines), alt
