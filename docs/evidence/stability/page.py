"""Maps and summaries of docs/stability.md, from the tables of stability, faults and fuzz."""

from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.patches import Patch

from piv.files.atomic import whole
from postprocess.tables import write_table

matplotlib.rcParams["svg.hashsalt"] = "softfinger"  # equal pictures give equal files

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
Line = tuple[str, list[tuple[str, str]]]  # a name, and each value with its ending


def read_rows(path: Path) -> pd.DataFrame:
    """The rows of a table, all as text."""
    return pd.read_csv(path, comment="#", dtype=str, keep_default_na=False)


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
    known = [(key, *ENDINGS[key]) for key in ENDINGS if key in seen]
    handles = [Patch(color=colour, label=words.get(key, text)) for key, colour, text in known]
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncol": 4}
    axes.legend(handles=handles, **below, frameon=False, fontsize=8)
    with whole(path, suffix=True) as part:
        figure.savefig(part, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)


def by_axis(rows: pd.DataFrame) -> list[Line]:
    """Rows grouped by axis, in the table's order; numbers ascending."""

    def number(item: tuple[str, str]) -> float:
        try:
            return float(item[0].removesuffix("mm"))
        except ValueError:
            return 0.0

    return [
        (AXES.get(name, name), sorted(zip(of["value"], of["ended"], strict=True), key=number))
        for name, of in rows.groupby("axis", sort=False)
    ]


def fault_kinds(rows: pd.DataFrame) -> pd.DataFrame:
    """The faults by kind: on how many stages, how often, and how they ended."""
    ends = ["times", "completed", "refused", "recomputed", "wrong"]
    kinds = {"damaged .*": "input damaged", ".* of another .*": "input of another scene or level"}
    kind = rows["fault"].replace(kinds, regex=True)
    rows = rows[["stage"]].assign(fault=kind).join(rows[ends].astype(int))
    return rows.groupby("fault", sort=False).agg({"stage": "nunique"} | dict.fromkeys(ends, "sum"))


def write(folder: Path) -> None:
    """Write the maps and the summaries beside the tables."""
    runs, images, faults = (read_rows(folder / f"{n}.csv") for n in ("runs", "images", "faults"))
    tiles(by_axis(runs), 12, folder / "runs.svg")
    lines: list[Line] = []
    for preset, of in images.groupby("preset", sort=False):
        lines += [(f"{name}, {preset}", values) for name, values in by_axis(of)]
    tiles(sorted(lines, key=lambda line: line[0]), 8, folder / "images.svg", **OF_IMAGES)
    endings = pd.DataFrame({"ending": [text for _, text in ENDINGS.values()]})
    for name, of in (("runs", runs), ("images", images)):
        endings[name] = [(of["ended"] == ending).sum() for ending in ENDINGS]
    write_table(folder / "endings.csv", endings)
    write_table(folder / "fault_kinds.csv", fault_kinds(faults).reset_index())


if __name__ == "__main__":
    write(Path("docs/stability"))
