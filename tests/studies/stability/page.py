"""The page docs/stability.md and its maps, from the tables that `make stability`, `make faults` and `make fuzz` write."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Patch

from fileio.atomic import whole, write_text
from pipeline.study.table import read_study
from tests.damage import WAYS

matplotlib.rcParams["svg.hashsalt"] = "softfinger"  # equal pictures give equal files

STUDY = (
    Path(__file__).resolve().parents[3] / "cases" / "single_finger" / "studies" / "stability.csv"
)
BASE = "pressure_20"  # from which one axis is changed at a time
COLOURS = {
    "completed": "#4c9f70",
    "refused": "#5b7db1",
    "stopped": "#e0a03b",
    "all flagged": "#9fb8d8",
    "WRONG": "#c0392b",
    "CRASH": "#000000",
    "FAILED": "#000000",
    "HANG": "#7d3c98",
}
MEANS = {
    "completed": "completed, energy bounded",
    "refused": "refused beforehand",
    "stopped": "stopped by a guard",
    "all flagged": "every vector marked as bad",
    "WRONG": "plausible wrong answer",
    "CRASH": "crash",
    "FAILED": "solver failed",
    "HANG": "hang",
}
DARK = ("WRONG", "CRASH", "FAILED", "HANG")  # colours on which black is not read
OF_IMAGES = {"completed": "evaluated", "refused": "refused"}
AXES = {
    "pressure": "pressure (kPa), FEA",
    "paper": "pressure (kPa), equations",
    "reversal": "from … to … kPa",
    "actuation": "actuation time (s)",
    "timestep": "time step (s)",
    "viscosity": "viscosity (m²/s)",
    "tank": "tank scaled",
    "finger": "finger scaled",
    "model": "model",
    "ranks": "ranks",
    "scheme": "time scheme",
    "turbulence": "turbulence",
    "level": "level",
    "motion": "pressure history",
    "mesh": "mesh",
    "gap": "gap to the plane",
    "law": "closing law",
    "corner": "pressure, actuation time,\ntime step and viscosity",
}


def read_rows(path: Path) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """The provenance line and the rows of a table; empty where there is none yet."""
    if not path.exists():
        return {}, []
    lines = path.read_text(encoding="utf-8").splitlines()
    made = json.loads(lines[0][2:]) if lines and lines[0].startswith("# ") else {}
    return made, list(csv.DictReader(line for line in lines if not line.startswith("# {")))


def save(figure: plt.Figure, path: Path) -> None:
    """Write a picture whole or not at all, without a date in it."""
    with whole(path, suffix=True) as part:
        figure.savefig(part, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)


def tiles(lines: list[tuple[str, list[tuple[str, str]]]], width: int, **words: str) -> plt.Figure:
    """A map: a line of tiles per axis, each with its value, in the colour of how it ended; `words` in place of those of MEANS."""
    rows: list[
        tuple[str, list[tuple[int, str, str]]]
    ] = []  # name, and the place, the value and the end of each tile
    for name, values in lines:
        at = width
        for value, ended in values:
            span = tiles_of(value)
            if at + span > width or not rows or rows[-1][0] != name:
                rows.append((name, []))
                at = 0
            rows[-1][1].append((at, value, ended))
            at += span
    figure, axes = plt.subplots(figsize=(11, 0.42 * len(rows) + 0.9))
    seen = []
    for y, (name, values) in enumerate(rows):
        if y == 0 or rows[y - 1][0] != name:
            axes.text(-0.15, y, name, ha="right", va="center", fontsize=9)
        for x, value, ended in values:
            seen.append(ended)
            span = tiles_of(value)
            axes.add_patch(
                plt.Rectangle((x + 0.03, y - 0.42), span - 0.06, 0.84, color=COLOURS[ended], lw=0)
            )
            size = 8 if len(value) < 9 else 6.5
            colour = "white" if ended in DARK else "black"
            axes.text(x + span / 2, y, value, ha="center", va="center", fontsize=size, color=colour)
    axes.set(xlim=(-2.4, width), ylim=(len(rows) - 0.4, -0.6))
    axes.axis("off")
    words = MEANS | words
    handles = [Patch(color=COLOURS[key], label=words[key]) for key in COLOURS if key in seen]
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncol=4,
        frameon=False,
        fontsize=8,
    )
    return figure


def tiles_of(value: str) -> int:
    """How many tiles wide a value is."""
    return 1 if len(value) < 12 else 1 + len(value) // 11


def by_axis(
    rows: list[dict[str, str]], names: dict[str, str]
) -> list[tuple[str, list[tuple[str, str]]]]:
    """Rows grouped by axis, in the table's order; numbers ascending."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for row in rows:
        groups.setdefault(names.get(row["axis"], row["axis"]), []).append(
            (row["value"], row["ended"])
        )
    return [(name, sorted(values, key=_number)) for name, values in groups.items()]


def _number(item: tuple[str, str]) -> float:
    try:
        return float(item[0].removesuffix("mm"))
    except ValueError:
        return 0.0


def counts(rows: list[dict[str, str]], **words: str) -> str:
    """`12 completed, 3 refused beforehand`; `words` in place of those of MEANS."""
    number = {key: sum(row["ended"] == key for row in rows) for key in MEANS}
    return ", ".join(
        f"{number[key]} {text}" for key, text in (MEANS | words).items() if number[key]
    )


def runs_part(rows: list[dict[str, str]]) -> list[str]:
    """What happened to the solver's runs."""
    done = [row for row in rows if row["ended"] == "completed"]
    worst = max((float(row["from_nothing_fraction"]) for row in done), default=0.0)
    closure = sorted(float(row["closure_fraction"]) for row in done)
    base = next(row for row in read_study(STUDY) if row.run == BASE)
    stroke = base.overrides["motion.strokes"][0]
    return [
        "## Runs\n",
        "![How each run ended, by axis and value](stability/runs.svg)\n",
        f"{len(rows)} runs: {counts(rows)}. Base: the single finger in 2-D at level {base.level}, 0 → {stroke['pressure_kpa']:g} kPa in"
        f" {stroke['duration']:g} s, time step {1e3 * base.overrides['numerics.time_step']:g} ms;"
        " one axis is changed at a time, then corners. In the completed runs the water never has more than"
        f" {worst:.2%} of its energy from nothing; neither kinetic energy nor dissipation by gradients in the cells is"
        f" {closure[0]:.0%} to {closure[-1]:.0%} of the work, most of it taken by the schemes. Every run with its numbers and, where it was refused or stopped, the sentence: [runs.csv](stability/runs.csv)."
        " `force_of_plate`: the peak force on a plate as long as the finger, ρ W (π/4 L² a + L U²), a check that is made without"
        " the solver.\n" if done else "",
    ]  # fmt: skip


def images_part(rows: list[dict[str, str]]) -> list[str]:
    """What happened to the pictures."""
    presets = list(dict.fromkeys(row["preset"] for row in rows))
    wrong = [row for row in rows if row["ended"] == "WRONG"]
    return [
        "## Images\n",
        "![How each picture ended, by axis and value](stability/images.svg)\n",
        f"{len(rows)} evaluations: {counts(rows, **OF_IMAGES)}. A uniform shift and a vortex, {', '.join(presets)}, 32 px windows."
        " A vector is wrong where it is called valid and is further than 0.5 px from the truth (where no vector can be right:"
        " wherever it is called valid); more than 5 % wrong counts as a plausible wrong answer. Every evaluation:"
        " [images.csv](stability/images.csv).\n",
        *(f"- Wrong: {row['axis']} {row['value']}, {row['preset']}: {row['wrong_unflagged']}" for row in wrong),
    ]  # fmt: skip


def chain_kills(rows: list[dict[str, str]]) -> list[str]:
    """What whole runs that were killed again and again ended with."""
    runs = {(r["scene"], r["level"], r["ranks"], r["end_time"]): r["compared"] for r in rows}
    struck = [r for r in rows if r["killed"] != "ended before"]
    of_all = sum(r["killed"] == "all" for r in struck)
    lines = [
        f"| {' | '.join(run)} | {ended or 'not compared yet'} |" for run, ended in runs.items()
    ]
    return [
        "## Kills of whole runs (`python -m tests.studies.faults.campaign`)\n",
        f"kill -9 {len(struck)} times in {len(runs)} runs, in succession within each: {of_all} times of make and all that it has"
        f" started, {len(struck) - of_all} times of one process alone; {sum(r['stage'] == 'run' for r in struck)} times while the"
        " flow was solved. After the last kill make goes on, and sheet, images, PIV, vortices, forces, power, loads and the"
        " table of the comparison are compared with those of an undisturbed run, bit for bit. Runs of two ranks at smoke have"
        " a finer mesh (smoke's has too few cells for two); an end before that of the scene keeps a run short. By kill:"
        " [kills.csv](stability/kills.csv).\n",
        "| scene | level | ranks | end, s | every final file |\n|---|---|---|---|---|",
        *lines,
        "",
    ]  # fmt: skip


def faults_part(docs: Path) -> list[str]:
    """Kills, conditions and the fuzz."""
    text = []
    _, kills = read_rows(docs / "stability" / "stage_kills.csv")
    if kills:
        total = sum(int(r["kills"]) for r in kills)
        bad = [r for r in kills if r["difference"]]
        text += [
            "## Kills in each stage (`make faults`)\n",
            f"kill -9 of make and all it has started, {total} times in {len(kills)} stages, at random times and just after a stage"
            " has begun to write; then make goes on and ends with what an undisturbed run ends with: bit by bit, the solver's"
            f" tables at least within 1e-6. {'All did.' if not bad else f'{len(bad)} did not.'} By stage: [stage_kills.csv](stability/stage_kills.csv).\n",
            *(f"- {row['stage']}: {row['difference']}" for row in bad),
        ]  # fmt: skip
    _, kills = read_rows(docs / "stability" / "kills.csv")
    if kills:
        text += chain_kills(kills)
    _, faults = read_rows(docs / "stability" / "faults.csv")
    if faults:
        kinds = {
            key: sum(row["ended"] == key for row in faults)
            for key in dict.fromkeys(row["ended"] for row in faults)
        }
        text += [
            "## Disks, files, paths, OpenFOAM, two makes (`make faults`)\n",
            f"{len(faults)} conditions: {', '.join(f'{number} {key}' for key, number in kinds.items())}. Each with what was said and"
            " what make ends with once the condition is over: [faults.csv](stability/faults.csv).\n",
        ]  # fmt: skip
    _, fuzz = read_rows(docs / "stability" / "fuzz.csv")
    if fuzz:
        total, broken = (sum(int(r[c]) for r in fuzz) for c in ("inputs", "faults"))
        text += [
            "## Fuzz of the readers (`make fuzz`)\n",
            f"{total} damaged files in {len(fuzz)} readers, {broken} faults: each other was read or refused with one sentence. By"
            " reader: [fuzz.csv](stability/fuzz.csv).\n",
        ]  # fmt: skip
    _, scenes = read_rows(docs / "stability" / "scenes.csv")
    if scenes:
        counts = {row["outcome"]: int(row["scenes"]) for row in scenes}
        text += [
            "## Drawn scenes (`make fuzz`)\n",
            f"{sum(counts.values())} scenes with one to three numbers drawn from the models' own types, at the edges of what is"
            f" allowed and far outside, at level smoke: {', '.join(f'{n} {kind}' for kind, n in counts.items())}; none ended in a"
            " traceback, and none took ten seconds of CPU time to be judged.\n",
        ]  # fmt: skip
    _, damaged = read_rows(docs / "stability" / "damaged.csv")
    if damaged:
        ways, refused = (sum(int(row[key]) for row in damaged) for key in ("ways", "refused"))
        text += [
            "## Damaged inputs (`make faults`)\n",
            f"Every input of every stage of a finished run, each damaged in {damaged[0]['ways']} ways ({', '.join(WAYS)}): {refused}"
            f" of {ways} were refused in one sentence that names the file; none was used. By stage and input:"
            " [damaged.csv](stability/damaged.csv).\n",
        ]  # fmt: skip
    return text


def write(docs: Path) -> None:
    """Write the maps and the page from the tables that are there."""
    folder = docs / "stability"
    made, runs = read_rows(folder / "runs.csv")
    _, images = read_rows(folder / "images.csv")
    head = (Path(__file__).parent / "page_head.md").read_text(encoding="utf-8")
    text = [head]
    if runs:
        save(tiles(by_axis(runs, AXES), 12), folder / "runs.svg")
        text += runs_part(runs)
    if images:
        names = {row["axis"]: row["axis"] for row in images}
        lines = [(f"{name}, {p}", values) for p in dict.fromkeys(r["preset"] for r in images)
                 for name, values in by_axis([r for r in images if r["preset"] == p], names)]  # fmt: skip
        save(tiles(sorted(lines, key=lambda line: line[0]), 8, **OF_IMAGES), folder / "images.svg")
        text += images_part(images)
    text += faults_part(docs)
    if made:
        versions = ", ".join(f"{k} {v}" for k, v in made["versions"].items())
        text.append(f"Made by `make stability` on {made['date']} with {versions}.\n")
    write_text(docs / "stability.md", "\n".join(text))


if __name__ == "__main__":
    write(Path("docs"))
