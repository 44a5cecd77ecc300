"""Modules of docs/evidence run for hours and seldom: each is at least imported here."""

from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "docs" / "evidence").rglob("*.py"))
    if path.stem != "peers"  # peers: other programs, installed by bench-piv
]


@pytest.mark.parametrize("name", MODULES)
def test_a_module_of_the_studies_is_imported(name):
    import_module(name)
