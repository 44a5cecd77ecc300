"""A page of the docs about one scene: what was asked, what was measured, with which versions.

It is docs/<scene>.md of a run at the default level, docs/<scene>_<level>.md of any other.

Sections written by hand, reference/words.md of the scene, are taken in as they are.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fileio.atomic import write_bytes, write_text
from fileio.command import DEFAULT_LEVEL, add_scene
from fileio.formats.records import COMPARISON, LOSSES, RUN
from postprocess.draw.quantity_text import measured_text
from postprocess.evidence.stage_files import StageFiles
from postprocess.report.pinch_wording import pinch_table
from postprocess.report.wording import WORDS, balance_sentence, requirement, sentence_rows


def verdict_cell(check: dict[str, Any]) -> str:
    """Met, not met or not judged, and why not where there is a note."""
    word = WORDS[check["met"]]
    notes = "; ".join(check["notes"])
    return (word if check["met"] else f"**{word}**") + (f" ({notes})" if notes else "")


def verdict_sentence(verdict: dict[str, Any]) -> str:
    """Counts of the verdict as a sentence."""
    kinds = verdict["counts"]
    parts = [
        f"{k['met']} of {k['met'] + k['not_met'] + k['not_judged']} {name}"
        for name, k in kinds.items()
    ]
    return f"Checks met: {' and '.join(parts)} findings."


def page(
    scene: str,
    level: str,
    comparison: dict[str, Any],
    run: dict[str, Any],
    picture: str,
    words: str = "",
) -> str:
    """The page as Markdown; `words`: its sections written by hand."""
    rows = "\n".join(
        f"| {c['finding']} | {requirement(c)} | {measured_text(c)} | {verdict_cell(c)} |"
        for c in comparison["checks"]
    )
    versions = ", ".join(f"{name} {version}" for name, version in sorted(run["versions"].items()))
    pinch = comparison["summary"].get("pinch")
    part = pinch_part(Path(picture).stem, pinch, run) if pinch else ""
    body = "fingers" if pinch else "finger"
    return f"""# {scene}, level {level}

Written by `make docs` from `cases/{scene}/out/{level}/`; scene hash `{run["scene_hash"]}`; {versions}.

![Vectors around the {body}, CFD on the left and PIV on the right]({picture})

{verdict_sentence(comparison["verdict"])}

| finding | asked for | measured | verdict |
|---|---|---|---|
{rows}

The reasons of the tolerances are in `cases/{scene}/reference/findings.toml`.
{sentences_part(comparison)}{words and chr(10) + words}{part}
**The run.** {run["cells"]} cells ({run["model"]}), {run["steps"]} steps of {run["time_step"] * 1e3:g} ms, {run["ranks"]} ranks,
{run["wall_time"]:.0f} s of solver; largest Courant number {run["courant_max"]:.2f}. **Power balance**: {balance_sentence(run["power_balance"])}

{power_table(run["power_balance"])}
"""


def power_table(balance: dict[str, Any]) -> str:
    """The share of the fingers' work that each term has taken."""
    taken, work = balance["taken"], abs(balance["work"]) or 1.0
    rows = ["| taken by | of the work |", "|---|---|"]
    rows += [f"| {loss} | {taken[loss] / work:.1%} |" for loss in LOSSES]
    return "\n".join(rows)


def sentences_part(comparison: dict[str, Any]) -> str:
    """The paper's sentences with what answers each, as a table; nothing where the scene lists none."""
    rows = sentence_rows(comparison)
    if not rows:
        return ""
    lines = "\n".join(
        f"| “{quote}” ({where}){f' *Reading: {reading}.*' if reading else ''} | {measured} | {verdict if verdict == 'met' else f'**{verdict}**'} |"
        for quote, where, reading, measured, verdict in rows
    )
    return f"""
## What the paper says, sentence by sentence

| sentence | measured | verdict |
|---|---|---|
{lines}
"""


def pinch_part(name: str, pinch: dict[str, Any], run: dict[str, Any]) -> str:
    """The part of the page about two fingers: contact, key numbers, pictures (of the page `name`) and field mappings."""
    columns, rows = pinch_table(pinch)
    table = "\n".join(f"| {row} | {' | '.join(values)} |" for row, values in rows)
    met = pinch["contact_time"]
    contact = (
        f"The tips stop {pinch['residual_gap'] * 1e3:g} mm before the plane between them (the residual gap; {2e3 * pinch['residual_gap']:g} mm"
        f" between the tips stay open) and are in contact, within 0.1 mm of that, from {met:.3f} s on."
        if met is not None
        else f"The tips do not meet: the least gap to the plane between them is {pinch['least_gap'] * 1e3:.2f} mm."
    )
    mappings = run.get("field_mappings", [])
    settled = lambda s: "not within the overlap" if s is None else f"{s * 1e3:.1f} ms"  # noqa: E731
    meshes = "".join(
        f" Field mapping at {s['time']:.3f} s: kinetic energy {s['jump_fraction'] * 100:+.2f} %, force disturbance gone after"
        f" {settled(s['force_settled_after'])}."
        for s in mappings
    )
    formed = pinch["cfd"].get("ventral_forms_time") is not None
    pictures = "\n".join(
        f"![The {pair} pair, CFD]({name}_pair_{pair}.png)"
        for pair in ("dorsal", "ventral")
        if pair == "dorsal" or formed
    )
    return f"""
## Two fingers

{contact} Gaps are those of one tip to the plane.

| | {" | ".join(columns)} |
|{"---|" * (len(columns) + 1)}
{table}

{pictures}
![Both pairs, half the plane and the jet, by integrals]({name}_integrals.svg)
![The two tip vortices against each other]({name}_pair.svg)
![On the plane between the fingers: the parting line, the jet below and the flow above]({name}_centreline.svg)
![Closing: gap, speed, pressure and jet]({name}_closing.svg)

**Meshes.** {len(run.get("intervals", [0]))} for the stroke.{meshes}
"""


PINCH_PICTURES = (
    "pair_dorsal.png",
    "pair_ventral.png",
    "integrals.svg",
    "pair.svg",
    "centreline.svg",
    "closing.svg",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `docs-page`."""
    add_scene(parser)
    parser.add_argument("--docs", type=Path, default=Path("docs"))


def run(args: argparse.Namespace) -> None:
    """Command `docs-page`."""
    files = StageFiles(args.scene, args.level)
    comparison = COMPARISON.read(files.required("comparison.json", "compare"))
    record = RUN.read(files.required("run/run.json", "run"))
    flow = sorted((files.out / "figures").glob("flow_*.png"))
    if not flow:
        raise FileNotFoundError(f"{files.figures}: no flow_*.png; run the stage 'report' first")
    name = files.scene if files.level == DEFAULT_LEVEL else f"{files.scene}_{files.level}"
    picture = f"{name}.png"
    write_bytes(
        args.docs / picture, flow[len(flow) // 2].read_bytes()
    )  # half-way; of a pinch about contact
    path = files.scene_folder / "reference" / "words.md"
    words = path.read_text(encoding="utf-8") if path.exists() else ""
    text = page(files.scene, args.level, comparison, record, picture, words)
    for figure in PINCH_PICTURES:
        if (files.figures / figure).exists():
            write_bytes(args.docs / f"{name}_{figure}", (files.figures / figure).read_bytes())
    write_text(args.docs / f"{name}.md", text)
