"""Scenes drawn from the models' own types, at the edges and far outside: each is accepted and sane, or refused in one sentence.

Command: python -m tests.studies.fuzz.scenes [--examples 2000] [--table docs/stability/scenes.csv]
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
import traceback
import types
import typing
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from fileio.atomic import write_text
from fileio.errors import StageError
from pipeline.kinematics import stage as kinematics
from pipeline.scene.limits import MAX_CELLS, MAX_CPU, MAX_DISK
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene, load_scene
from pipeline.stage_settings import update_settings

CASES = Path(__file__).resolve().parents[3] / "cases"
PARENTS = ("single_finger", "pinch")
NOT_DRAWN = {"name", "level", "folder", "actuator", "fea", "body"}
LONGEST = 10.0  # s
LONGEST_SENTENCE = 700  # characters
FAR = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-12,
    1e-6,
    1e-3,
    1e3,
    1e6,
    1e12,
    -1e12,
    5e-324,
    1e308,
    math.nan,
    math.inf,
    -math.inf,
]
FAR_WHOLE = [0, 1, 2, 3, 7, -1, 1000, 2**31, 2**32, 2**63, 10**30]
OTHER_KINDS: list[Any] = ["9_98", "", "nan", True, [], [1.0], {}]


def edges(metadata: list[Any]) -> list[float]:
    """The bounds of a field, and what is just within and beyond."""
    bounds = [
        getattr(m, side) for m in metadata for side in ("ge", "gt", "le", "lt") if hasattr(m, side)
    ]
    return [
        value
        for b in bounds
        for value in (b, b + max(abs(b), 1e-9) * 1e-9, b - max(abs(b), 1e-9) * 1e-9, 2 * b, 0.5 * b)
    ]


def of_kind(kind: Any, metadata: list[Any]) -> st.SearchStrategy[Any]:
    """Values of a field of type `kind`, allowed and not."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return of_kind(parts[0], [*metadata, *parts[1:]])
    if origin in (typing.Union, types.UnionType):
        return st.one_of(*(of_kind(part, metadata) for part in parts if part is not type(None)))
    if origin is typing.Literal:
        return st.sampled_from([*parts, "nonsense", -1])
    if origin is tuple:
        if parts[-1] is Ellipsis:
            return st.lists(of_kind(parts[0], metadata), max_size=3)
        return st.tuples(*(of_kind(part, metadata) for part in parts)).map(list)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return st.fixed_dictionaries(
            {}, optional={key: of_field(field) for key, field in kind.model_fields.items()}
        )
    if kind is bool:
        return st.booleans()
    if kind is int:
        near = [int(e) + d for e in edges(metadata) if abs(e) < 1e15 for d in (-1, 0, 1)]
        return st.sampled_from([*FAR_WHOLE, *near]) | st.integers(-100, 10_000)
    if kind is float:
        numbers = st.floats(1e-6, 1e3) | st.floats(allow_nan=True)
        return st.sampled_from([*FAR, *edges(metadata)]) | numbers
    return st.text("abc/._é", max_size=8)


def of_field(field: FieldInfo) -> st.SearchStrategy[Any]:
    """Values of a field: of its type, near its default, and now and then of another kind."""
    drawn = of_kind(field.annotation, field.metadata)
    if isinstance(field.default, int | float) and not isinstance(field.default, bool):
        kind = type(field.default)
        near = st.sampled_from([0.5, 0.8, 0.9, 1.0, 1.1, 1.5, 2.0]).map(
            lambda by: kind(by * field.default)
        )
        return st.one_of(near, near, near, drawn, drawn, st.sampled_from(OTHER_KINDS))
    return st.one_of(drawn, drawn, drawn, drawn, st.sampled_from(OTHER_KINDS))


def keys() -> list[tuple[str, str, FieldInfo]]:
    """Section, key and field of every number of a scene."""
    numbers = []
    for section, field in Scene.model_fields.items():
        if section in NOT_DRAWN:
            continue
        kinds = [field.annotation, *typing.get_args(field.annotation)]
        model = next((k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)
        if model is not None:
            numbers += [(section, key, inner) for key, inner in model.model_fields.items()]
    return numbers


@st.composite
def scenes(draw: st.DrawFn) -> tuple[str, dict[str, dict[str, Any]]]:
    """A shipped scene, and one to three keys of it that are given other values."""
    table: dict[str, dict[str, Any]] = {}
    for section, key, field in draw(
        st.lists(st.sampled_from(keys()), min_size=1, max_size=3, unique_by=lambda k: k[:2])
    ):
        table.setdefault(section, {})[key] = draw(of_field(field))
    return draw(st.sampled_from(PARENTS)), table


def toml(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def scene_text(parent: str, table: dict[str, dict[str, Any]]) -> str:
    """The scene.toml of a drawn scene, whose values hold at every level."""
    lines = [f"extends = {json.dumps(str(CASES / parent))}"]
    for section, values in table.items():
        lines += [f"[{section}]", *(f"{key} = {toml(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def outcome(text: str, folder: Path) -> str:
    """ "accepted", "warned" or "refused" of a scene at level smoke by the settings and kinematics stages; AssertionError otherwise."""
    write_text(folder / "scene.toml", text)
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            scene = load_scene(folder, "smoke")
            update_settings(scene, quiet=True)
            kinematics.run(scene, quiet=True)
        size, told = predicted(scene), scene.remarks()
        assert size.cells <= MAX_CELLS, size
        assert size.disk <= MAX_DISK, size
        assert size.cpu <= MAX_CPU, size
        result = "warned" if told else "accepted"
    except (StageError, OSError) as error:
        told, result = [str(error)], "refused"
    except AssertionError:
        raise
    except BaseException as error:
        raise AssertionError(f"{text}\n{''.join(traceback.format_exception(error))}") from None
    took = time.process_time() - begin
    assert took < LONGEST, f"{text}\n{took:.0f} s: {told}"
    for sentence in told:
        assert sentence.count("\n") == 0, f"{text}\n{sentence}"
        assert len(sentence) < LONGEST_SENTENCE, f"{text}\n{sentence}"
    return result


def count_outcomes(examples: int) -> Counter[str]:
    """How many of so many drawn scenes are accepted, warned of and refused; AssertionError with the first that is neither."""
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:

        @settings(
            max_examples=examples,
            database=None,
            derandomize=True,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        )
        @given(scenes())
        def each(scene: tuple[str, dict[str, dict[str, Any]]]) -> None:
            counts[outcome(scene_text(*scene), Path(folder) / "scene")] += 1

        each()
    return counts


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=2000)
    parser.add_argument("--table", type=Path, help="CSV to write")
    args = parser.parse_args(argv)
    counts = count_outcomes(args.examples)
    rows = ["outcome,scenes", *(f"{name},{count}" for name, count in sorted(counts.items()))]
    print("\n".join(rows))
    if args.table:
        write_text(args.table, "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
