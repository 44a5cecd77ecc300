"""The page of a comparison with a laboratory, its figures (SVG and PDF) and what the first screen says."""

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
from fileio.formats.lab_fields import read_fields
from fileio.formats.plane_series import read_plane
from fileio.formats.records import LAB_COMPARISON
from postprocess.draw.style import save
from postprocess.evidence.stage_files import scene_title
from postprocess.lab.data.files import LabFiles, read_registration
from postprocess.lab.registration.register import law_pressure
from postprocess.lab.report import answers, draw, wording
from postprocess.report.page_template import page_template

FIELD_DPI = 120


def make_report(files: LabFiles) -> Path:
    """Write figures/*.svg, *.pdf and report.html. FileNotFoundError where the comparison was not run."""
    if not files.comparison.exists():
        raise FileNotFoundError(
            f"{files.comparison} is missing; run python -m postprocess.lab compare first"
        )
    result = LAB_COMPARISON.read(files.comparison)
    pictures = {
        name: (_saved(files, name, figure), alt) for name, figure, alt in figures(files, result)
    }
    path = files.folder / "report.html"
    write_text(path, page(scene_title(files.stage.scene_folder), result, pictures))
    return path


def page(title: str, result: dict[str, Any], pictures: dict[str, tuple[str, str]]) -> str:
    """The page of a comparison (comparison.json); `pictures`: address and alternative text by name."""
    return page_template("lab.html").render(
        title=title,
        result=result,
        answer=answers.answer(result),
        tiles=wording.tiles(result),
        rows=wording.rows(result),
        pictures=pictures,
        registration=result["registration"],
        pretty=lambda value: json.dumps(value, indent=1, sort_keys=True),
    )


def _saved(files: LabFiles, name: str, figure: Figure) -> str:
    """The figure on disk as SVG and PDF, and as an address for the page (a bitmap where it holds a picture)."""
    folder = files.folder / "figures"
    svg = save(figure, folder / f"{name}.svg", bbox_inches="tight")
    save(figure, folder / f"{name}.pdf", bbox_inches="tight")
    if name.startswith(("field", "picture")):
        svg = save(figure, folder / f"{name}.png", dpi=FIELD_DPI, bbox_inches="tight")
    kind = "svg+xml" if svg.suffix == ".svg" else "png"
    return f"data:image/{kind};base64,{base64.b64encode(svg.read_bytes()).decode()}"


def figures(files: LabFiles, result: dict[str, Any]) -> Iterator[tuple[str, Figure, str]]:
    """All figures: name, figure and alternative text."""
    registration = read_registration(files.registration)
    kinematics = read_kinematics(files.stage.required("kinematics.h5", "kinematics"))
    series = pd.read_csv(files.folder / "series.csv")
    by_name = {q["name"]: q for q in result["quantities"]}
    window = tuple(result["window_s"])
    planes = {name: read_plane(files.side(name)) for name in ("data", "direct")}
    planes["virtual"] = (
        read_plane(files.side("virtual")) if files.side("virtual").exists() else planes["direct"]
    )
    rows = result["rows"]
    fields = read_fields(files.folder / "fields.h5")
    error, significance = fields["error"].values, fields["significance"].values
    picture = fields["picture"].values if "picture" in fields else None
    picture_time = float(fields.attrs.get("picture_time", 0.0))
    alt = "Difference of every quantity over its uncertainty, as bars with the limit of 95 %"
    yield "verdicts", draw.verdicts(result["quantities"]), alt
    alt = "Share of every source in the uncertainty of each quantity, as stacked bars"
    yield "budgets", draw.budgets(result["quantities"]), alt
    for part, word in ((0.25, "early"), (0.75, "late")):
        k = int(part * (len(rows) - 1))
        figure = draw.fields(
            planes["data"], planes["virtual"], rows[k], error[k], significance[k], 2.45
        )
        time = float(planes["data"]["time"].values[rows[k]])
        alt = f"Velocity of laboratory and simulation, their difference and its significance at {time:.3f} s"
        yield f"field_{word}", figure, alt
    alt = "Circulation, core radius and jet speed over time, laboratory and simulation, with 95 % bands"
    yield "series", draw.series(series, by_name, window), alt
    figure = draw.paths(series, planes["direct"], registration.pose, window, by_name["centre"])
    yield "paths", figure, "Paths of the vortex centre over the finger's outline"
    law, bends = registration.law, None
    if registration.times.size:
        bends = (registration.times - law.delay, kinematics.bend(registration.pressures))
    figure = draw.motion(series, result["registration"], bends)
    yield "motion", figure, "Bend angle over time, simulation and recording"
    if picture is not None:
        fitted = law_pressure(kinematics, np.array([picture_time + law.delay]), law.values)[0]
        pressures = {"recording, fitted": fitted, "simulation": float(kinematics.law(picture_time))}
        outlines = {
            name: registration.pose.to_px(kinematics.shape("outline", p))
            for name, p in pressures.items()
        }
        alt = "A picture of the recording with the finger's outline as fitted and as simulated"
        yield "picture", draw.overlay(picture, outlines), alt
    for plane in planes.values():
        plane.close()
