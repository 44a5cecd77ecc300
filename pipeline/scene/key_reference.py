"""The keys of a TOML file from its pydantic model: a reference, a template, and complaints."""

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

from piv.files.errors import suggestion

# in place of the words of pydantic, by its kind of error
_KINDS = {
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    "tuple_type": "a list",
    "list_type": "a list",
}
_LONGEST = 60  # characters of a wrong value in a message
_NAMES = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    Path: "path",
    dict: "table",
}
_MEANING = re.compile(r"(.*?)(?: \[([^][]+)\])?")  # with a unit in brackets
_BOUNDS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
MISSING, _WITH_TABLE = "required", "required in this table"


@dataclass(frozen=True)
class Key:
    """A key by its dotted name; `default` as TOML has it, "", MISSING or _WITH_TABLE."""

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
    """All keys of a model and its tables but those in `without`; `optional`: it may be absent."""
    meanings = _strings_below(model)
    for name, field in model.model_fields.items():
        if name in without:
            continue
        dotted = f"{above}{name}"
        inner, listed = _model_of(field.annotation)
        kind, required = _type_text(field.annotation, tuple(field.metadata)), field.is_required()
        if inner is None or kind != "table" or (required and not optional):
            about = meanings.get(name) or ((inner and inner.__doc__) or "").partition("\n")[0]
            meaning, unit = _MEANING.fullmatch(about.strip()).groups("")  # type: ignore[union-attr]
            default = _WITH_TABLE if optional else MISSING
            if not required:
                default = toml_value(field.get_default(call_default_factory=True))
            yield Key(dotted, kind, unit, default, meaning)
        if inner is not None:
            absent = optional or not required
            yield from keys_of(inner, f"{dotted}[]." if listed else f"{dotted}.", optional=absent)


def _strings_below(model: type[BaseModel]) -> dict[str, str]:
    """The string below each key of a model."""
    # read here: pydantic would read all sources at each import
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


def toml_value(value: Any) -> str:
    """A value as TOML has it; "" of None."""
    if value is None or value == {}:
        return ""
    if isinstance(value, bool | str | Path):
        return json.dumps(value if isinstance(value, bool) else str(value), ensure_ascii=False)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(toml_value, value))}]"
    return str(value)


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
        for kind, sign in _BOUNDS.items()
        if getattr(m, kind, None) is not None
    ]
    return " ".join(
        [_NAMES.get(origin or annotation, "text"), ", ".join(dict.fromkeys(bounds))]
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


def template(keys: list[Key], known: Mapping[str, str] | None = None) -> str:
    """A file to start from: required keys are open, the others are comments with their defaults.

    `known`: values read from the data, as TOML has them, by dotted name.
    """
    known = known or {}
    tables = {key.name for key in keys if key.type == "table" and key.default == MISSING}
    mixed = {key.name for key in keys if "table or " in key.type}
    text, section = "", ""
    for key in keys:
        head, _, name = key.name.rpartition(".")
        if "[]" in head or head in mixed or key.name in tables:
            continue  # the key of a list or optional table describes its content
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
        value = key.default if key.default not in ("", MISSING, _WITH_TABLE) else "…"
        comment = "" if key.default == MISSING else "# "
        text += f"{comment}{name} = {value}  {about}\n"
    return text


def complaints(errors: list[Any], model: type[BaseModel], section: str = "") -> list[str]:
    """The faults of a table, a sentence for each kind; for an unknown key the nearest spelling."""
    keys_of = dict[str, list[str]]()  # of each message
    for error in errors:
        key = ".".join(_cut(part) for part in (section, *map(str, error["loc"])) if part)
        key = re.sub(r"\.(\d+)", r"[\1]", key)
        message = error["msg"].removeprefix("Value error, ")
        if error["type"] == "extra_forbidden":
            *place, name = error["loc"]
            table: Any = model
            for part in place:
                if part in getattr(table, "model_fields", {}):
                    table, _ = _model_of(table.model_fields[part].annotation)
            near = suggestion(str(name), getattr(table, "model_fields", {}))
            message = f"this key is not known{near or '; check its spelling or remove it'}"
        elif error["type"] in _KINDS:
            message = f"give {_KINDS[error['type']]}"
            if not isinstance(error["input"], dict):
                message += f" (got {_cut(repr(error['input']))})"
        elif error["type"] == "missing":
            message = "this key is missing; add it"
        elif error["loc"] and not isinstance(error["input"], dict):
            message += f" (got {_cut(repr(error['input']))})"
        keys_of.setdefault(message, []).append(key)
    return [
        f"{keys}: {m}" if (keys := ", ".join(filter(None, k))) else m for m, k in keys_of.items()
    ]


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"
