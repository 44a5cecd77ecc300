"""The reference of dpiv.toml, docs/dpiv_reference.md, and a file to start from."""

from __future__ import annotations

from pathlib import Path

from fileio.atomic import write_text
from fileio.key_reference import keys_of, markdown, template
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.seen_in_data import seen_in

PAGE = Path("docs/dpiv_reference.md")
HEAD = """# Every key of dpiv.toml

Written by `softfinger reference`; what the keys are for: [comparison](comparison.md).
A file to start from: `softfinger new-dpiv [FOLDER]`; with a
folder of pictures or vectors, the keys that these show are filled in.
"""
_FOUND = list(keys_of(Dpiv, without=frozenset({"folder"})))
_TABLES = [key.name.rpartition(".")[0] for key in _FOUND]
# the keys of one table stand together, where its first key is
KEYS = sorted(_FOUND, key=lambda key: _TABLES.index(key.name.rpartition(".")[0]))


def reference() -> str:
    """The page."""
    return HEAD + markdown(KEYS)


def write_reference() -> None:
    """Write docs/dpiv_reference.md."""
    write_text(PAGE, reference())


def dpiv_template(data: Path | None) -> str:
    """A dpiv.toml to start from, with what the files of a folder show filled in."""
    return template(KEYS, seen_in(data) if data else None)
