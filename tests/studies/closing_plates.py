"""Closing fingers beside closing plates: the jet and the circulation, scaled by tip speed and length; docs/pinch_plates.md.

python -m tests.studies.closing_plates --levels smoke draft coarse   (make closing-plates; needs the pinch's vortices at these levels)
The plates are two rigid ones, hinged at one end, in two dimensions: what they push through the line between their tips follows from
continuity, and the circulation of a slug of that speed from its flux, ∫U²/2 dt (Didden 1979).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from fileio.atomic import write_text
from fileio.formats.records import RUN
from postprocess.draw.style import CFD, GREY, PIV, THIRD, new_figure, save
from postprocess.evidence.load import load_evidence
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, pair_of
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.evidence.strokes import tip_speed
from tests.studies.pages import libraries

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "pinch_plates.md"
HALF_ANGLE = np.radians(30.0)  # of Mahulkar & Arakeri's plates before they close
GAPS = (0.3, 0.2, 0.1, 0.05)  # of the length: rows of the page's table
COLUMNS = ("gap", "jet", "rise", "dorsal", "ventral")


@dataclass(frozen=True)
class Closing:
    """What closes: a table of `COLUMNS` over the falling gap, scaled by peak tip speed and length, and how it was made."""

    name: str
    table: pd.DataFrame
    reynolds: float  # mean tip speed until contact times width over viscosity; NaN of the plates


def plates(points: int = 400) -> Closing:
    """Two hinged plates that turn at a constant rate from HALF_ANGLE on, in two dimensions."""
    half = np.linspace(HALF_ANGLE, 0.01, points)
    jet = np.cos(2 * half) / (2 * np.sin(half))  # d(area)/dt over the width between the tips
    slug = cumulative_trapezoid(0.5 * jet**2, HALF_ANGLE - half, initial=0.0)
    nothing = np.full(points, np.nan)
    table = pd.DataFrame(
        np.column_stack([np.sin(half), jet, nothing, slug, nothing]), columns=list(COLUMNS)
    )
    return Closing("plates, continuity", table, np.nan)


def fingers(files: StageFiles) -> Closing:
    """The pinch of a level, until contact."""
    evidence, scene = load_evidence(files), scene_numbers(files)
    plane, lines, integrals = (
        evidence.planes["cfd"],
        evidence.lines["cfd"],
        evidence.integrals["cfd"],
    )
    time, length, met = plane["time"].values, float(scene["finger"]["length"]), evidence.clock.met()
    closing = time <= met
    unit = evidence.scale * length
    table = pd.DataFrame({"time": time, "gap": evidence.clock.gap_at(time) / length})
    table["jet"] = lines["jet_speed"] / evidence.scale
    table["rise"] = lines["rise_speed"] / evidence.scale
    for name, pair in (("dorsal", DORSAL), ("ventral", VENTRAL)):
        rows = pair_of(integrals, *pair)
        table = table.merge(
            rows[["time", "circulation"]].rename(columns={"circulation": name}), "left", "time"
        )
        table[name] /= unit
    mean = float(tip_speed(time, plane["tip"].values)[closing].mean())
    reynolds = mean * float(scene["finger"]["width"]) / float(scene["fluid"]["kinematic_viscosity"])
    model = "2-D" if RUN.read(files.required("run/run.json", "run"))["model"] == "2d" else "3-D"
    plane.close()
    return Closing(
        f"fingers, {files.level} ({model})",
        table[closing][list(COLUMNS)].reset_index(drop=True),
        reynolds,
    )


def figure(all_of_them: list[Closing]):
    """Jet (down full, up dashed) and circulation over the gap, both scaled."""
    drawn, axes = new_figure(10.5, 4.4, 1, 2, sharex=True)
    for closing, colour in zip(all_of_them, (GREY, CFD, PIV, THIRD, "#7a4d9e"), strict=False):
        table = closing.table
        axes[0].plot(table["gap"], table["jet"], color=colour, label=closing.name)
        axes[0].plot(table["gap"], table["rise"], "--", color=colour)
        axes[1].plot(table["gap"], table["dorsal"], color=colour, label=closing.name)
        axes[1].plot(table["gap"], table["ventral"], "--", color=colour)
    axes[0].set(
        ylabel="speed / peak tip speed", ylim=(0, 5), title="Jet down (full), flow up (dashed)"
    )
    axes[1].set(
        ylabel="Γ / (peak tip speed · length)",
        ylim=(0, 3),
        title="Circulation: dorsal (full), ventral (dashed)",
    )
    for ax in axes:
        ax.set(xlabel="gap of one tip to the plane / length", xscale="log")
        ax.invert_xaxis()
    axes[1].legend()
    return drawn


def at_gaps(closing: Closing, name: str) -> list[str]:
    """A column at GAPS, as text; – where it is not there."""
    gap, values = closing.table["gap"].to_numpy()[::-1], closing.table[name].to_numpy()[::-1]
    inside = [gap[0] <= at <= gap[-1] for at in GAPS]
    found = [
        float(np.interp(at, gap, values)) if ok else np.nan
        for at, ok in zip(GAPS, inside, strict=True)
    ]
    return [f"{value:.2f}" if np.isfinite(value) else "–" for value in found]


def page(all_of_them: list[Closing]) -> str:
    """The page as Markdown."""
    words = (
        (ROOT / "cases" / "pinch" / "reference" / "plates.md").read_text(encoding="utf-8").strip()
    )
    rows = [
        "| gap / length | " + " | ".join(f"{gap:g}" for gap in GAPS) + " |",
        "|---|" + "---|" * len(GAPS),
    ]
    for closing in all_of_them:
        for name, label in (("jet", "jet / U"), ("dorsal", "Γ / (U L)")):
            rows.append(f"| {closing.name}: {label} | " + " | ".join(at_gaps(closing, name)) + " |")
    reynolds = ", ".join(
        f"{c.reynolds:.0f} ({c.name})" for c in all_of_them if np.isfinite(c.reynolds)
    )
    return "\n".join(
        [
            words,
            "",
            *rows,
            "",
            f"Reynolds number by mean tip speed until contact and width: {reynolds}.",
            "",
            "![Jet and circulation of closing plates and fingers](pinch_plates.svg)",
            "",
            f"Written by `make closing-plates`; every number is in [pinch_plates.csv](pinch_plates.csv). {libraries()}.",
            "",
        ]
    )


def main() -> None:
    """Write page, figure and table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--levels", nargs="+", required=True)
    levels = parser.parse_args().levels
    found = [plates(), *(fingers(StageFiles(ROOT / "cases" / "pinch", level)) for level in levels)]
    table = pd.concat([closing.table.assign(of=closing.name) for closing in found])
    write_text(PAGE.with_suffix(".csv"), table.to_csv(index=False, float_format="%.5g"))
    save(figure(found), PAGE.with_suffix(".svg"))
    write_text(PAGE, page(found))


if __name__ == "__main__":
    main()
