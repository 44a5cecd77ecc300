"""The table of tuned constants, docs/reference/tuned.csv, is that of the code."""

import csv
from importlib import import_module

from tests.conftest import ROOT


def test_every_listed_constant_has_its_value_and_says_what_set_it() -> None:
    with (ROOT / "docs" / "reference" / "tuned.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len({row["constant"] for row in rows})
    for row in rows:
        module, _, name = row["constant"].rpartition(".")
        assert repr(getattr(import_module(module), name)) == row["value"], row["constant"]
        assert row["set by"], row["constant"]
