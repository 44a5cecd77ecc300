"""Modules and functions stay small; ruff checks lines and complexity."""

import ast
from pathlib import Path

import pytest

from tests.conftest import ROOT

PARTS = ("piv", "pipeline", "postprocess", "softfinger", "docs/evidence")
MODULES = [path for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_has_350_lines_and_a_function_80_at_most(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 350
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    lengths = {f.name: (f.end_lineno or f.lineno) - f.lineno + 1 for f in functions}
    assert {name: length for name, length in lengths.items() if length > 80} == {}
