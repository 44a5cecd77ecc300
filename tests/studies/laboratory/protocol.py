"""What docs/lab_protocol.md says that a verdict can see, from the tables of docs/comparison.md.

python -m tests.studies.laboratory.protocol   (the study of waters does it with each table that it writes)
"""

from __future__ import annotations

import re
from pathlib import Path

from postprocess.lab.judgement.validation import detectable_factor, joint_level
from tests.studies.pages import between, write_between

DOCS = Path(__file__).resolve().parents[3] / "docs"
QUANTITIES = 7  # that a comparison of pictures judges
LEVELS = ("smoke", "coarse")
SEEN = ("circulation", "jet speed", "velocity field", "core radius", "centre")


def cells(text: str) -> dict[str, list[str]]:
    """The rows of a text's tables, by their first cell."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {row[0]: [cell.strip() for cell in row[1:]] for row in rows}


def summary(page: Path) -> str:
    """Table and sentences of the protocol: of the first level whose waters were recorded, and what is found at each."""
    tables = {level: cells(between(page, f"study at {level}")) for level in LEVELS}
    made = {level: table for level, table in tables.items() if table}
    level, table = next(iter(made.items()))
    factor = detectable_factor(1, joint_level(QUANTITIES))
    recordings = next(
        int(found[1]) for key in table if (found := re.match(r"registration \((\d+) ", key))
    )
    lines = [
        f"| quantity | standard uncertainty of the data alone ({recordings} recordings at {level}) | {factor:.1f} times that: smallest error seen, were that all |",
        "|---|---|---|",
    ]
    for label, row in (
        ("pressure by the bend", "pressure factor"),
        ("duration of the stroke", "duration factor"),
    ):
        error = 100 * float(table[row][1])
        lines.append(f"| {label} | {error:.2g} % (RMS error) | {factor * error:.1f} % |")
    spread = float(table["circulation, cm²/s"][1])
    lines.append(
        f"| circulation | {spread:.2g} cm²/s (mean u_D of five instants) | {factor * spread:.0f} cm²/s |"
    )
    lines += [
        "",
        "With what grid and motion leave open, the smallest errors that would be found (medians; the centre's of a tip's width):",
        "",
    ]
    lines += [f"| level | {' | '.join(SEEN)} |", f"|---|{'---|' * len(SEEN)}"]
    lines += [
        f"| {level} | {' | '.join(found[name][0] for name in SEEN)} |"
        for level, found in made.items()
    ]
    return "\n".join(lines)


def write(page: Path, protocol: Path) -> None:
    """Write what the tables of `page` say into the page `protocol`."""
    write_between(protocol, "seen", summary(page))


if __name__ == "__main__":
    write(DOCS / "comparison.md", DOCS / "lab_protocol.md")
