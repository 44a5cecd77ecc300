"""Folders, modules and functions stay small; ruff checks lines and complexity."""

import ast
from collections import Counter

from tests.conftest import ROOT

PARTS = ("piv", "pipeline", "postprocess", "softfinger", "docs/evidence")


def docstring_lines(node: ast.AST) -> int:
    """Lines of the docstrings in a module or function."""
    texts = [
        part.body[0]
        for part in ast.walk(node)
        if isinstance(part, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(part)
    ]
    return sum((text.end_lineno or text.lineno) - text.lineno + 1 for text in texts)


def test_a_module_has_350_lines_and_a_function_80_at_most() -> None:
    """Without docstrings: those of the public functions have parameters and an example."""
    large = {}
    for path in (path for part in PARTS for path in (ROOT / part).rglob("*.py")):
        text, name = path.read_text(encoding="utf-8"), str(path.relative_to(ROOT))
        tree = ast.parse(text)
        if (lines := len(text.splitlines()) - docstring_lines(tree)) > 350:
            large[name] = lines
        for node in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            lines = (node.end_lineno or 0) - node.lineno + 1 - docstring_lines(node)
            if lines > 80:
                large[f"{name}: {node.name}"] = lines
    assert large == {}


def test_a_folder_has_16_modules_at_most() -> None:
    folders = Counter(path.parent for part in PARTS for path in (ROOT / part).rglob("[!_]*.py"))
    assert {str(folder): count for folder, count in folders.items() if count > 16} == {}
