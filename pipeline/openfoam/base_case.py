"""The templates of the OpenFOAM dictionaries of every interval."""

from pathlib import Path

from piv.files.errors import StageError

BASE = Path(__file__).resolve().parents[2] / "cases" / "_base"
if not BASE.is_dir():  # installed from a wheel
    BASE = Path(__file__).with_name("base")


def template_files() -> list[Path]:
    """The files of the base case but editors' backups, by relative name; StageError without any."""
    files = [
        p
        for p in BASE.rglob("*")
        if p.is_file() and not p.name.startswith(".") and p.name[-1] != "~"
    ]
    if not files:
        raise StageError(
            f"{BASE}: the base case is missing; restore it with git checkout cases/_base"
        )
    return sorted(files, key=lambda path: path.relative_to(BASE).as_posix())
