"""Digest of the sources that a module imports within the project: results know their code."""

import ast
import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from piv.files.atomic import sha256, write_text

ROOT = Path(__file__).resolve().parents[2]
_PARSED = Path(__file__).parent / "__pycache__" / "sources.json"
_OWN = Path(__file__).read_bytes()  # another one parses anew
_DATA = {".css", ".html", ".js", ".toml"}  # suffixes of files that the code reads


@cache
def sources_digest(module: str, root: Path = ROOT) -> str:
    """Short SHA-256 of a module's sources and of those that it imports, itself or by others.

    Comments, docstrings and formatting do not count. Other files that the code reads, such as
    templates, count with the modules of their folder.
    """
    parts = sources(module, root).items()
    total = sorted((path.relative_to(root).as_posix(), part) for path, part in parts)
    return hashlib.sha256(repr(total).encode()).hexdigest()[:16]


def sources(module: str, root: Path = ROOT) -> dict[Path, str]:
    """Digest of each file of which `sources_digest` is."""
    known = _known()
    before, parts, waiting = len(known), {}, [module]
    while waiting:
        name = waiting.pop()
        path = _path(name, root)
        if path is None or path in parts:
            continue
        source = path.read_bytes()
        key = hashlib.sha256(_OWN + source).hexdigest()
        if key not in known:
            tree = ast.parse(source, path)
            text = repr(_structure(tree))
            known[key] = hashlib.sha256(text.encode()).hexdigest(), sorted({*_imports(tree)})
        parts[path], imports = known[key]
        waiting += [*imports, name.rpartition(".")[0]]
        parts |= _data(path.parent)
    if len(known) > before:
        with suppress(OSError):  # a tree that cannot be written to: it is parsed again
            write_text(_PARSED, json.dumps(known))
    return parts


@cache
def _known() -> dict[str, Any]:
    """Digest and imports of the sources that were parsed before."""
    try:
        return dict(json.loads(_PARSED.read_bytes()))
    except (OSError, ValueError):
        return {}


def _path(name: str, root: Path) -> Path | None:
    """The file of a module or package of the project; None of any other name."""
    place = root.joinpath(*name.split("."))
    paths = place.with_name(f"{place.name}.py"), place / "__init__.py"
    return next((path for path in paths if path.is_file()), None)


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names that may be modules, from all imports but those for type checkers."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            waiting += ast.iter_child_nodes(node)


def _structure(node: Any) -> Any:
    """A syntax tree as nested tuples, equal in all versions of Python, without docstrings."""
    if isinstance(node, list):
        return tuple(_structure(one) for one in node if not _is_text(one))
    if not isinstance(node, ast.AST):
        return node
    fields = ((name, value) for name, value in ast.iter_fields(node) if value not in (None, []))
    return type(node).__name__, *((name, _structure(value)) for name, value in fields)


def _is_text(node: Any) -> bool:
    """Whether a statement is a docstring, of a module, a function or a field."""
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


@cache
def _data(package: Path) -> dict[Path, str]:
    """SHA-256 of the files beside modules, also in folders that are no packages."""
    folders = [package]
    for folder in folders:
        inner = (one for one in folder.iterdir() if one.is_dir() and one.name != "__pycache__")
        folders += [one for one in inner if not (one / "__init__.py").exists()]
    files = (one for folder in folders for one in folder.iterdir() if one.suffix in _DATA)
    return {file: sha256(file) for file in files}
