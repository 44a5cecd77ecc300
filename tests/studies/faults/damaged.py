"""Every input of every stage of a finished run, damaged in twelve ways: each must be refused.

python -m tests.studies.faults.damaged cases/single_finger --level smoke --table TABLE
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from pathlib import Path

from fileio.stages import STAGES, Stage, until

from pipeline.__main__ import main as run_stage
from tests.damage import WAYS, damage
from tests.studies.pages import write_table

COLUMNS = ("stage", "input", "ways", "refused", "sentence")


def _inputs_of(stage: Stage, out: Path) -> list[Path]:
    """Files of the stages before one, its settings, and the case's mesh."""
    files = [out / name for before in until(stage.name)[:-1] for name in before.outputs]
    if stage.piv:
        files.append(out / "settings" / f"{stage.target}.json")
    if stage.name == "run":
        mesh = (out / "case").glob("interval_*/constant/polyMesh/*")
        files += sorted(path for path in mesh if path.name[0] != ".")
    return [path for path in dict.fromkeys(files) if path.is_file()]


def _answer(stage: Stage, scene: Path, level: str, path: Path, way: str) -> tuple[bool, str]:
    """Whether a stage refuses a damaged input in one sentence with its name, and the output."""
    content, state = path.read_bytes(), path.stat()
    output = io.StringIO()
    try:
        damage(path, way)
        with contextlib.redirect_stderr(output), contextlib.redirect_stdout(io.StringIO()):
            code = run_stage([stage.name, str(scene), "--level", level, "--quiet"])
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    text = output.getvalue().strip()
    return code == 2 and "\n" not in text and str(path) in text, text


def main() -> int:
    """Command line; 1 where a damaged input was used or refused in another way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path, help="folder of a scene that was run to its report")
    parser.add_argument("--level", default="smoke")
    parser.add_argument("--table", type=Path, required=True, help="CSV to write")
    args = parser.parse_args()
    out, rows = args.scene / "out" / args.level, []
    for stage in STAGES:
        for path in _inputs_of(stage, out):
            answers = {way: _answer(stage, args.scene, args.level, path, way) for way in WAYS}
            wrong = [f"{way}: {text}" for way, (good, text) in answers.items() if not good]
            sentence = wrong[0] if wrong else next(iter(answers.values()))[1]
            refused, sentence = len(WAYS) - len(wrong), sentence.replace(f"{out}/", "")
            cells = (stage.name, path.relative_to(out), len(WAYS), refused, sentence)
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
            print(*cells, sep="  ", flush=True)
    write_table(args.table, COLUMNS, rows)
    return int(any(row["refused"] != row["ways"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
