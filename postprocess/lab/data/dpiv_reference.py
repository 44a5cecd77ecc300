"""The table of the keys of dpiv.toml, and a file to start from."""

from __future__ import annotations

from pathlib import Path

from fileio.atomic import write_text
from fileio.key_reference import csv_text, keys_of, template
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.seen_in_data import seen_in

PAGE = Path("docs/reference/dpiv_keys.csv")
_FOUND = list(keys_of(Dpiv, without=frozenset({"folder"})))
_TABLES = [key.name.rpartition(".")[0] for key in _FOUND]
# the keys of one table stand together, where its first key is
KEYS = sorted(_FOUND, key=lambda key: _TABLES.index(key.name.rpartition(".")[0]))


def reference() -> str:
    """The table."""
    return csv_text(KEYS)


def write_reference() -> None:
    """Write docs/reference/dpiv_keys.csv."""
    write_text(PAGE, reference())


def dpiv_template(data: Path | None) -> str:
    """A dpiv.toml to start from, with what the files of a folder show filled in."""
    return template(KEYS, seen_in(data) if data else None)
