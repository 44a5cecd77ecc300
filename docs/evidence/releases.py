"""Locks and release dates of docs/reference/licences.csv, from pylock files of the locks.

uv pip compile --no-deps --format pylock.toml requirements.lock -o pylock.toml; likewise of the
others to pylock.study.toml, pylock.dev.toml, … in one folder, then
python -m docs.evidence.releases FOLDER
"""

import csv
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

from piv.files.atomic import write_text

TABLE = Path(__file__).resolve().parents[1] / "reference" / "licences.csv"


def main(folder: Path) -> None:
    """Write the table; a package that it has no licence of gets an empty one."""
    locks, released = defaultdict(list), {}
    for path in sorted(folder.glob("pylock*.toml")):
        short = path.name.removeprefix("pylock").removesuffix("toml").strip(".") or "requirements"
        for package in tomllib.loads(path.read_text())["packages"]:
            files = [*package.get("wheels", []), *filter(None, [package.get("sdist")])]
            locks[package["name"]].append(short)
            released[package["name"]] = max(file["upload-time"] for file in files).date()
    with TABLE.open() as file:
        licences = {row["package"]: row["licence"] for row in csv.DictReader(file)}
    rows = [
        f"{name},{licences.get(name, '')},{' and '.join(locks[name])},{released[name]}\n"
        for name in sorted(locks)
    ]
    write_text(TABLE, "".join(["package,licence,lock,released\n", *rows]))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
