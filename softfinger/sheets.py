"""Laser sheets over other views than a scene's own, as recordings of a laboratory need them."""

from pathlib import Path

from pipeline.runs.run import Run
from piv.files.lock import exclusive
from piv.files.provenance import digest
from piv.files.record import changed_outputs, read_record, record_path, write_record


def make_sheet(
    run: Run, view: tuple[float, ...], path: Path, quiet: bool = False, most: int | None = None
) -> None:
    """Sample the laser sheet of a run over another view (m: x0, x1, y0, y1), if stale.

    `most`: of its planes, evenly spread; None: all.

    The record lies beside the file.
    """
    from pipeline.sheet import run as sample

    about = {"digest": digest([run.digest("sheet"), view, most])}
    path.parent.mkdir(parents=True, exist_ok=True)
    with exclusive(path):
        record = read_record(path.parent, path.stem)
        same = record is not None and record["digest"] == about["digest"]
        if record and same and not changed_outputs(path.parent, record):
            return
        record_path(path.parent, path.stem).unlink(missing_ok=True)
        sample(run.scene, quiet, view, path, most)
        write_record(path.parent, path.stem, about, [path])
