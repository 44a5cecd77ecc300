"""The keys of a TOML file as its pydantic model declares them: a reference, a file to start from, and what is wrong with one."""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from fileio.errors import nearest

LONGEST = 60  # characters of what was given, in a message
NAMES = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    Path: "path",
    dict: "table",
}
BOUNDS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
MISSING, WITH_TABLE = "required", "required in this table"


@dataclass(frozen=True)
class Key:
    """A key by its dotted name; `default` as TOML has it, or MISSING (WITH_TABLE of a table that may be absent), or ""."""

    name: str
    type: str
    unit: str
    default: str
    meaning: str


def keys_of(
    model: type[BaseModel],
    above: str = "",
    without: frozenset[str] = frozenset(),
    optional: bool = False,
) -> Iterator[Key]:
    """All keys of a model and of the tables in it, but for the names in `without`; `optional`: the table may be absent."""
    said = _strings_below(model)
    for name, field in model.model_fields.items():
        if name in without:
            continue
        dotted = f"{above}{name}"
        inner, listed = _model_of(field.annotation)
        if inner is None or type_of(field) != "table" or (field.is_required() and not optional):
            yield _key(dotted, field, optional, said.get(name, ""))
        if inner is not None:
            absent = optional or not field.is_required()
            yield from keys_of(inner, f"{dotted}[]." if listed else f"{dotted}.", optional=absent)


def _strings_below(model: type[BaseModel]) -> dict[str, str]:
    """The string below each key of a model. pydantic would read the sources of all models whenever they are imported."""
    known = {}
    for kind in reversed(model.__mro__[: model.__mro__.index(BaseModel)]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
        assert isinstance(tree, ast.ClassDef)
        for key, text in pairwise(tree.body):
            match key, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=str(words))
                ):
                    known[name] = inspect.cleandoc(words)
    return known


def _key(name: str, field: FieldInfo, optional: bool, said: str) -> Key:
    inner, _ = _model_of(field.annotation)
    about = said or (inner.__doc__ or "" if inner else "").partition("\n")[0]
    meaning, unit = re.fullmatch(r"(.*?)(?: \[([^][]+)\])?", about.strip()).groups("")  # type: ignore[union-attr]
    default = WITH_TABLE if optional else MISSING
    if not field.is_required():
        default = toml_value(field.get_default(call_default_factory=True))
    return Key(name, type_of(field), unit, default, meaning)


def toml_value(value: Any) -> str:
    """A value as TOML has it; "" of None."""
    if value is None or value == {}:
        return ""
    if isinstance(value, bool | str | Path):
        return json.dumps(value if isinstance(value, bool) else str(value), ensure_ascii=False)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(toml_value, value))}]"
    return str(value)


def type_of(field: FieldInfo) -> str:
    """What a key takes, with its bounds."""
    return _type_text(field.annotation, tuple(field.metadata))


def _type_text(annotation: Any, metadata: tuple[Any, ...] = ()) -> str:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type_text(parts[0], (*metadata, *parts[1:]))
    if origin in (Union, types.UnionType):
        return " or ".join(
            dict.fromkeys(_type_text(p, metadata) for p in parts if p is not type(None))
        )
    if origin is Literal:
        return ", ".join(map(toml_value, parts))
    if origin in (tuple, list):
        if origin is list or parts[-1] is Ellipsis:
            return f"list of {_type_text(parts[0])}"
        return f"[{', '.join(map(_type_text, parts))}]"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    bounds = [
        f"{sign} {getattr(m, kind):.10g}"
        for m in _flat(metadata)
        for kind, sign in BOUNDS.items()
        if getattr(m, kind, None) is not None
    ]
    return " ".join(
        [NAMES.get(origin or annotation, "text"), ", ".join(dict.fromkeys(bounds))]
    ).strip()


def _flat(metadata: tuple[Any, ...]) -> Iterator[Any]:
    for m in metadata:
        yield from _flat(tuple(m.metadata)) if isinstance(m, FieldInfo) else (m,)


def _model_of(annotation: Any) -> tuple[type[BaseModel] | None, bool]:
    """The model of a table, or of the tables of a list (True); None of anything else."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    listed = get_origin(annotation) in (tuple, list)
    for part in get_args(annotation):
        model, deeper = _model_of(part)
        if model is not None:
            return model, listed or deeper
    return None, False


def markdown(keys: list[Key], levels: Mapping[str, str] | None = None) -> str:
    """The keys as a table for each section; `levels`: a last column of what overrides a key, by its name."""
    columns = (
        "key",
        "type",
        "unit",
        "default",
        "meaning",
        *(("levels",) if levels is not None else ()),
    )
    text, section = "", None
    for key in keys:
        head, _, name = key.name.rpartition(".")
        if head != section:
            title = f"`[{head}]`" if head else "Outside of tables"
            text += f"\n## {title}\n\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|\n"
            section = head
        cells = (
            f"`{name}`",
            key.type,
            key.unit,
            key.default,
            key.meaning,
            (levels or {}).get(key.name, ""),
        )[: len(columns)]
        text += "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"
    return text


def template(keys: list[Key], known: Mapping[str, str] | None = None) -> str:
    """A file to start from: what is required is open, what has a default is a comment with it; `known`: values as TOML has them, by
    dotted name, that were read from the data."""
    known = known or {}
    tables = {key.name for key in keys if key.type == "table" and key.default == MISSING}
    mixed = {key.name for key in keys if "table or " in key.type}
    text, section = "", ""
    for key in keys:
        head, _, name = key.name.rpartition(".")
        if "[]" in head or head in mixed or key.name in tables:
            continue  # of a list of tables, and of what may be a table, its key says what it takes
        if head != section:
            text += f"\n{'' if head in tables else '# '}[{head}]\n"
            section = head
        inner = ", ".join(
            k.name.rpartition(".")[2]
            for k in keys
            if k.name.rpartition(".")[0].removesuffix("[]") == key.name
        )
        unit = f", {key.unit}" if key.unit else ""
        about = f"# {key.meaning}{unit}; {key.type}" + (f" of {inner}" if inner else "")
        if key.name in known:
            text += (
                f"{name} = {known[key.name]}  # read from the data, check it: {key.meaning}{unit}\n"
            )
            continue
        given = f"{name} = " + (
            key.default if key.default not in ("", MISSING, WITH_TABLE) else "…"
        )
        text += f"{given}  {about}\n" if key.default == MISSING else f"# {given}  {about}\n"
    return text


def complaints(errors: list[Any], model: type[BaseModel], section: str = "") -> list[str]:
    """What is wrong with a table, a sentence for each key, with the nearest spelling of one that is not known."""
    sentences = []
    for error in errors:
        key = ".".join(part for part in (section, *map(str, error["loc"])) if part)
        message = error["msg"].removeprefix("Value error, ")
        if error["type"] == "extra_forbidden":
            near = nearest_key(str(error["loc"][-1]), model, error["loc"][:-1])
            message = "this key is not known; " + (
                f"{near!r} is" if near else "check its spelling or remove it"
            )
        elif error["type"] == "missing":
            message = "this key is missing; add it"
        elif error["loc"]:
            given = repr(error["input"])
            message = f"{message} (got {given if len(given) <= LONGEST else given[:LONGEST] + '…'})"
        sentences.append(f"{key}: {message}" if key else message)
    return sentences


def nearest_key(name: str, model: type[BaseModel], place: tuple[Any, ...]) -> str | None:
    """The key nearest to `name` in the table at `place` (names, and numbers of a list) of a model, or None."""
    inner: type[BaseModel] | None = model
    for part in place:
        if isinstance(part, str) and inner is not None and part in inner.model_fields:
            inner, _ = _model_of(inner.model_fields[part].annotation)
    known = list(inner.model_fields) if inner is not None else []
    return nearest(name, known)
