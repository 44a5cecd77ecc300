"""The keys of dpiv.toml, and a file to start from."""

from __future__ import annotations

from pathlib import Path

from fileio.key_reference import keys_of, template
from postprocess.lab.data.dpiv_toml import Dpiv
from postprocess.lab.data.seen_in_data import seen_in

_FOUND = list(keys_of(Dpiv, without=frozenset({"folder"})))
_TABLES = [key.name.rpartition(".")[0] for key in _FOUND]
# the keys of one table stand together, where its first key is
KEYS = sorted(_FOUND, key=lambda key: _TABLES.index(key.name.rpartition(".")[0]))


def dpiv_template(data: Path | None) -> str:
    """A dpiv.toml to start from, with what the files of a folder show filled in."""
    return template(KEYS, seen_in(data) if data else None)
