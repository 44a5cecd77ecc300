"""Modules and functions stay small; ruff checks lines and complexity."""

import ast

from tests.conftest import ROOT

PARTS = ("piv", "pipeline", "postprocess", "softfinger", "docs/evidence")


def test_a_module_has_350_lines_and_a_function_80_at_most() -> None:
    large = {}
    for path in (path for part in PARTS for path in (ROOT / part).rglob("*.py")):
        text, name = path.read_text(encoding="utf-8"), str(path.relative_to(ROOT))
        if (lines := len(text.splitlines())) > 350:
            large[name] = lines
        for node in ast.walk(ast.parse(text)):
            lines = (node.end_lineno or 0) - node.lineno if isinstance(node, ast.FunctionDef) else 0
            if lines >= 80:
                large[f"{name}: {node.name}"] = lines + 1
    assert large == {}
