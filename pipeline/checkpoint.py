"""Finding the last whole set of fields a run has written."""

from __future__ import annotations

from pathlib import Path

from pipeline.foamfile import is_complete

FIELDS = ("U", "p", "phi", "pointDisplacement", "polyMesh/points", "uniform/time")


def saved_times(case: Path) -> list[tuple[float, str]]:
    """Times of `case` (or of one processor's folder) at which every field is whole, ascending."""
    found = []
    for folder in case.iterdir() if case.is_dir() else ():
        try:
            time = float(folder.name)
        except ValueError:
            continue
        if time > 0 and all(_whole(folder / name) for name in FIELDS):
            found.append((time, folder.name))
    return sorted(found)


def _whole(path: Path) -> bool:
    zipped = path.with_name(path.name + ".gz")
    if path.exists():
        return is_complete(path)
    return zipped.exists() and is_complete(zipped)


def last_checkpoint(case: Path, ranks: int) -> tuple[float, str] | None:
    """Latest time that all ranks have written whole; None where there is none."""
    folders = [case] if ranks == 1 else [case / f"processor{rank}" for rank in range(ranks)]
    common: dict[float, str] | None = None
    for folder in folders:
        times = dict(saved_times(folder))
        common = times if common is None else {t: n for t, n in common.items() if t in times}
    return max(common.items()) if common else None
