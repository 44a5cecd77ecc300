"""Results of a stage that another run has made already: linked, not made again."""

import os
import re
import shutil
from pathlib import Path

from pipeline.runs.run import Run
from pipeline.runs.stages import BY_NAME
from piv.files.lock import exclusive
from piv.files.record import read_record, record_path

_OF_CASE = {"0", "0.orig", "constant", "system", "case.foam"}  # in an interval's folder
_FIELDS = re.compile(r"[0-9.e-]+$|processor")  # folders that the solver writes


def take_over(run: Run, stage: str, source: Path) -> None:
    """Give a run the files of a stage that another run has made in the folder `source`.

    Recorded files and fields become hard links: no stage writes into a finished file. Files that a
    solver appends to or rewrites are copied, and those of a run are no part of its case.
    """
    record = read_record(source, stage)
    assert record is not None
    record_path(run.out, stage).unlink(missing_ok=True)

    def copy(old: str, new: str) -> None:
        name = Path(old).relative_to(source)
        part = name.parts[2]  # case/interval_0/<part>
        field = part not in _OF_CASE and _FIELDS.match(part)
        (_link if name.as_posix() in record["outputs"] or field else shutil.copy2)(old, new)

    def ignore(folder: str, names: list[str]) -> list[str]:
        interval = stage == "case" and Path(folder).parent == source / "case"
        return [name for name in names if interval and name not in _OF_CASE]

    folders = BY_NAME[stage].folders
    with exclusive(run.out / "solver"):  # no solver may be at work there
        for name in folders:
            if (source / name).is_dir():
                shutil.rmtree(run.out / name, ignore_errors=True)
                shutil.copytree(source / name, run.out / name, ignore=ignore, copy_function=copy)
    apart = [name for name in record["outputs"] if name.split("/")[0] not in folders]
    for name in (*apart, record_path(Path(), stage)):
        new = run.out / name
        new.parent.mkdir(parents=True, exist_ok=True)
        part = new.with_name(f"{new.name}.part")
        part.unlink(missing_ok=True)
        _link(source / name, part)
        os.replace(part, new)


def _link(old: str | Path, new: str | Path) -> None:
    try:
        os.link(old, new)
    except OSError:  # a file system without hard links
        shutil.copy2(old, new)
