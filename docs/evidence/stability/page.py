"""Summaries of docs/stability.md, from the tables of runs, drawn runs, images and faults."""

from pathlib import Path

import pandas as pd

from postprocess.tables import write_table

ENDINGS = {
    "completed": "completed",
    "refused": "refused beforehand",
    "stopped": "stopped by a guard",
    "wrong": "completed but wrong, with a warning",
    "UNWARNED": "completed but wrong by a fifth, without a warning",
    "all flagged": "every vector marked as bad",
    "WRONG": "plausible wrong answer",
    "CRASH": "crash",
    "FAILED": "solver failed",
    "HANG": "hang",
}


def fault_kinds(rows: pd.DataFrame) -> pd.DataFrame:
    """Count the faults by kind: on how many stages, how often, and how they ended."""
    ends = ["times", "completed", "refused", "recomputed", "wrong"]
    kinds = {"damaged .*": "input damaged", ".* of another .*": "input of another scene or level"}
    kind = rows["fault"].replace(kinds, regex=True)
    rows = rows[["stage"]].assign(fault=kind).join(rows[ends].astype(int))
    return rows.groupby("fault", sort=False).agg({"stage": "nunique"} | dict.fromkeys(ends, "sum"))


def write(folder: Path) -> None:
    """Write the summaries beside the tables."""
    tables = {
        path.stem: pd.read_csv(path, comment="#", dtype=str, keep_default_na=False)
        for path in (folder / f"{name}.csv" for name in ("runs", "drawn", "images", "faults"))
        if path.exists()
    }
    drawn = tables.pop("drawn")
    in_space = drawn["level"] != "smoke"
    tables |= {"drawn, plane": drawn[~in_space], "drawn, in space": drawn[in_space]}
    endings = pd.DataFrame({"ending": ENDINGS.values()})
    for name in [name for name in tables if name != "faults"]:
        count = {ending: str((tables[name]["ended"] == ending).sum()) for ending in ENDINGS}
        if name == "runs":
            count["UNWARNED"] = "not judged"  # no finer run is made of these
        endings[name] = count.values()
    write_table(folder / "endings.csv", endings)
    write_table(folder / "fault_kinds.csv", fault_kinds(tables["faults"]).reset_index())


if __name__ == "__main__":
    write(Path("docs/stability"))
