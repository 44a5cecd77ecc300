"""Every input of every stage of a finished run, damaged in twelve ways: refused in one sentence, never used.

Command: python -m tests.studies.faults.damaged cases/single_finger --level smoke --table docs/stability/damaged.csv
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import os
import sys
from pathlib import Path

from fileio.atomic import whole
from fileio.stages import STAGES, Stage, until
from pipeline.__main__ import main as run_stage
from tests.damage import WAYS, damage

COLUMNS = ("stage", "input", "ways", "refused", "told")


def inputs_of(stage: Stage, out: Path) -> list[Path]:
    """The files that a stage follows from: those of the stages before it, its settings, and the case's mesh."""
    files = [
        out / name for before in until(stage.name) if before != stage for name in before.outputs
    ]
    if stage.piv:
        files.append(out / "settings" / f"{stage.target}.json")
    if stage.name == "run":
        files += sorted(
            p for p in (out / "case").glob("interval_*/constant/polyMesh/*") if p.name[0] != "."
        )
    return [path for path in dict.fromkeys(files) if path.is_file()]


def told_of(stage: Stage, scene: Path, level: str, path: Path, way: str) -> tuple[bool, str]:
    """Whether the stage refused its input damaged in a way with one sentence that names it, and what it said; the file is mended."""
    content, state = path.read_bytes(), path.stat()
    said = io.StringIO()
    try:
        damage(path, way)
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = run_stage([stage.name, str(scene), "--level", level, "--quiet"])
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    text = said.getvalue().strip()
    return code == 2 and "\n" not in text and str(path) in text, text


def damaged_inputs(scene: Path, level: str) -> list[dict[str, object]]:
    """A row per stage and input."""
    out, rows = scene / "out" / level, list[dict[str, object]]()
    for stage in STAGES:
        for path in inputs_of(stage, out):
            results = [told_of(stage, scene, level, path, way) for way in WAYS]
            wrong = [
                f"{way}: {text}"
                for way, (good, text) in zip(WAYS, results, strict=True)
                if not good
            ]
            told = (wrong or [results[0][1]])[0].replace(f"{out}/", "")
            rows.append(dict(zip(COLUMNS, (stage.name, path.relative_to(out), len(WAYS), sum(good for good, _ in results), told), strict=True)))  # fmt: skip
            print(*rows[-1].values(), sep="  ", flush=True)
    return rows


def main() -> int:
    """Command line; 1 where an input was used or refused otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path, help="folder of a scene that was run to its report")
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--table", type=Path, help="CSV to write")
    args = parser.parse_args()
    rows = damaged_inputs(args.scene, args.level)
    if args.table:
        with whole(args.table) as part, part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    return int(any(row["refused"] != row["ways"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
