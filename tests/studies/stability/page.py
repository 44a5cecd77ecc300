"""Page docs/stability.md and its maps, from the studies stability, faults and fuzz."""

import csv
import json
from collections import Counter
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Patch

from fileio.atomic import whole, write_text
from pipeline.study.rows import read_study
from tests.studies.faults.campaign import WAYS

matplotlib.rcParams["svg.hashsalt"] = "softfinger"  # equal pictures give equal files

STUDY = Path(__file__).parents[3] / "cases" / "single_finger" / "studies" / "stability.csv"
BASE = "pressure_20"  # one axis at a time is changed from this run
ENDINGS = {  # colour and words of each ending
    "completed": ("#4c9f70", "completed, energy bounded"),
    "refused": ("#5b7db1", "refused beforehand"),
    "stopped": ("#e0a03b", "stopped by a guard"),
    "all flagged": ("#9fb8d8", "every vector marked as bad"),
    "WRONG": ("#c0392b", "plausible wrong answer"),
    "CRASH": ("#000000", "crash"),
    "FAILED": ("#000000", "solver failed"),
    "HANG": ("#7d3c98", "hang"),
}
DARK = ("WRONG", "CRASH", "FAILED", "HANG")  # colours that need white text
OF_IMAGES = {"completed": "evaluated", "refused": "refused"}
AXES = {
    "pressure": "pressure (kPa), FEA", "paper": "pressure (kPa), equations",
    "reversal": "from … to … kPa", "actuation": "actuation time (s)",
    "timestep": "time step (s)", "viscosity": "viscosity (m²/s)",
    "tank": "tank scaled", "finger": "finger scaled", "scheme": "time scheme",
    "motion": "pressure history", "gap": "gap to the plane", "law": "closing law",
    "corner": "pressure, actuation time,\ntime step and viscosity",
}  # fmt: skip
Row = dict[str, str]
Line = tuple[str, list[tuple[str, str]]]  # a name, and each value with its ending


def read_rows(path: Path) -> tuple[dict[str, Any], list[Row]]:
    """The provenance line and the rows of a table."""
    lines = path.read_text(encoding="utf-8").splitlines()
    made = json.loads(lines[0][2:]) if lines[0].startswith("# ") else {}
    return made, list(csv.DictReader(line for line in lines if not line.startswith("# {")))


def tiles(lines: list[Line], width: int, path: Path, **words: str) -> None:
    """Draw a map: a line of tiles for each axis, coloured by ending; `words` replace ENDINGS'."""
    rows: list[tuple[str, list[tuple[int, int, str, str]]]] = []  # place, span, value, ending
    for name, values in lines:
        at = width
        for value, ended in values:
            span = 1 if len(value) < 12 else 1 + len(value) // 11
            if at + span > width or rows[-1][0] != name:
                rows.append((name, []))
                at = 0
            rows[-1][1].append((at, span, value, ended))
            at += span
    figure, axes = plt.subplots(figsize=(11, 0.42 * len(rows) + 0.9))
    for y, (name, row) in enumerate(rows):
        if y == 0 or rows[y - 1][0] != name:
            axes.text(-0.15, y, name, ha="right", va="center", fontsize=9)
        for x, span, value, ended in row:
            corner, colour = (x + 0.03, y - 0.42), ENDINGS[ended][0]
            axes.add_patch(plt.Rectangle(corner, span - 0.06, 0.84, color=colour, lw=0))
            size, ink = 8 if len(value) < 9 else 6.5, "white" if ended in DARK else "black"
            axes.text(x + span / 2, y, value, ha="center", va="center", fontsize=size, color=ink)
    axes.set(xlim=(-2.4, width), ylim=(len(rows) - 0.4, -0.6))
    axes.axis("off")
    seen = {ended for _, values in lines for _, ended in values}
    handles = [
        Patch(color=colour, label=words.get(key, text))
        for key, (colour, text) in ENDINGS.items()
        if key in seen
    ]
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncol": 4}
    axes.legend(handles=handles, **below, frameon=False, fontsize=8)
    with whole(path, suffix=True) as part:
        figure.savefig(part, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)


def by_axis(rows: list[Row]) -> list[Line]:
    """Rows grouped by axis, in the table's order; numbers ascending."""

    def number(item: tuple[str, str]) -> float:
        try:
            return float(item[0].removesuffix("mm"))
        except ValueError:
            return 0.0

    groups: dict[str, list[tuple[str, str]]] = {}
    for row in rows:
        name = AXES.get(row["axis"], row["axis"])
        groups.setdefault(name, []).append((row["value"], row["ended"]))
    return [(name, sorted(values, key=number)) for name, values in groups.items()]


def counts(rows: list[Row], **words: str) -> str:
    """`12 completed, 3 refused beforehand`; `words` replace those of ENDINGS."""
    number = Counter(row["ended"] for row in rows)
    names = {key: words.get(key, text) for key, (_, text) in ENDINGS.items()}
    return ", ".join(f"{number[key]} {text}" for key, text in names.items() if number[key])


def runs_part(rows: list[Row]) -> list[str]:
    """Text of the solver's runs."""
    done = [row for row in rows if row["ended"] == "completed"]
    worst = max(float(row["from_nothing_fraction"]) for row in done)
    base = next(row for row in read_study(STUDY) if row.run == BASE)
    stroke = base.overrides["motion.strokes"][0]
    return [
        "## Runs\n",
        "![How each run ended, by axis and value](stability/runs.svg)\n",
        f"{len(rows)} runs: {counts(rows)}. The base run is the single finger in 2-D at level"
        f" {base.level}, 0 → {stroke['pressure_kpa']:g} kPa in {stroke['duration']:g} s, time step"
        f" {1e3 * base.overrides['numerics.time_step']:g} ms. One axis is changed at a time, then"
        f" corners. At most {worst:.2%} of the energy of a completed run came from nothing."
        " [All runs](stability/runs.csv).\n",
    ]


def images_part(rows: list[Row]) -> list[str]:
    """Text of the pictures."""
    presets = ", ".join(dict.fromkeys(row["preset"] for row in rows))
    wrong = [row for row in rows if row["ended"] == "WRONG"]
    return [
        "## Images\n",
        "![How each picture ended, by axis and value](stability/images.svg)\n",
        f"{len(rows)} evaluations: {counts(rows, **OF_IMAGES)}. The pictures show a uniform shift"
        f" and a vortex, evaluated with the presets {presets}. A vector is wrong where it is called"
        " valid and is more than 0.5 px from the truth. More than 5 % wrong vectors count as a"
        " plausible wrong answer. [All evaluations](stability/images.csv).\n",
        *(
            f"- Wrong: {row['axis']} {row['value']}, {row['preset']}: {row['wrong_unflagged']}"
            for row in wrong
        ),
    ]


def faults_part(folder: Path) -> list[str]:
    """Text of faults of the machine and of files, fuzz and drawn scenes."""
    faults, scenes = (read_rows(folder / f"{n}.csv")[1] for n in ("faults", "scenes"))
    outcomes = sorted({row["outcome"] for row in scenes})
    return [
        "## Kills, disks, damaged and foreign files (`make faults`)\n",
        "Faults of a small run, by the number of stages that they were tried on. A stage"
        " completes, or is refused in one sentence; one more make then ends with what an"
        " undisturbed run ends with, bit by bit, without its times. A killed make is kill -9 of"
        " it and all it has started, at random times and just after a stage begins to write."
        f" Inputs are damaged in these ways: {', '.join(WAYS)}."
        " Their time stays, so only their content tells."
        " Inputs of another scene or level come whole, with their record; they are made again."
        " Each row with its sentence: [faults.csv](stability/faults.csv).\n",
        fault_table(faults),
        "## Fuzz of the readers\n",
        "On 2026-11-22, 125,250 damaged files of 26 readers were read or refused with one sentence"
        " ([by reader](record/fuzz.csv)).\n",
        "## Drawn scenes\n",
        "Scenes of level smoke. Drawn: one to three numbers from the models' own types, at the"
        " edges of what is allowed and far outside, made up to the case. Ordinary: one to three"
        " numbers of a shipped scene a tenth larger or smaller. Solved: drawn as well, and the"
        " solver works on the accepted ones, to 0.03 s and for ten seconds at most. A refusal is"
        " one sentence within ten seconds of CPU time.\n",
        f"| scenes | {' | '.join(outcomes)} |",
        "|---" * (1 + len(outcomes)) + "|",
        *scene_lines(scenes, outcomes),
        "",
    ]


def scene_lines(rows: list[Row], outcomes: list[str]) -> list[str]:
    """The outcomes of each kind of drawn scenes, as lines of a table."""
    number = Counter[tuple[str, str]]()
    for row in rows:
        number[row["scenes"], row["outcome"]] += int(row["count"])
    return [
        f"| {kind} | {' | '.join(str(number[kind, outcome]) for outcome in outcomes)} |"
        for kind in dict.fromkeys(row["scenes"] for row in rows)
    ]


def fault_table(rows: list[Row]) -> str:
    """The faults by kind: in how many stages, how often, and how they ended."""
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        fault = row["fault"]
        kind = next((f"input {k}" for k in ("damaged", "of another") if k in fault), fault)
        kinds.setdefault(kind.replace("another", "another scene or level"), []).append(row)
    ends = ("times", "completed", "refused", "recomputed", "wrong")
    lines = [f"| fault | stages or commands | {' | '.join(ends)} |", "|---" * (2 + len(ends)) + "|"]
    for kind, those in kinds.items():
        numbers = [len({row["stage"] for row in those})]
        numbers += [sum(int(row[end]) for row in those) for end in ends]
        lines.append(f"| {kind} | {' | '.join(map(str, numbers))} |")
    return "\n".join(lines) + "\n"


def write(docs: Path) -> None:
    """Write the maps and the page from the tables."""
    folder = docs / "stability"
    made, runs = read_rows(folder / "runs.csv")
    _, images = read_rows(folder / "images.csv")
    tiles(by_axis(runs), 12, folder / "runs.svg")
    lines = [
        (f"{name}, {preset}", values)
        for preset in dict.fromkeys(row["preset"] for row in images)
        for name, values in by_axis([row for row in images if row["preset"] == preset])
    ]
    tiles(sorted(lines, key=lambda line: line[0]), 8, folder / "images.svg", **OF_IMAGES)
    head = (Path(__file__).parent / "page_head.md").read_text(encoding="utf-8")
    text = [head, *runs_part(runs), *images_part(images), *faults_part(folder)]
    versions = ", ".join(f"{name} {number}" for name, number in made["versions"].items())
    text.append(f"Runs made on {made['date']} with {versions}.\n")
    write_text(docs / "stability.md", "\n".join(text))


if __name__ == "__main__":
    write(Path("docs"))
