"""Scenes drawn from the models' own types: refused in one sentence, or made up to the case."""

import json
import math
import shutil
import signal
import tempfile
import time
import traceback
import types
import typing
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from pipeline.case import stage as case
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.scene.limits import MAX_CELLS, MAX_CPU, MAX_DISK
from pipeline.scene.measurement import piv_settings, render_settings
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene, load_scene
from piv.files.atomic import write_text
from piv.files.errors import StageError
from tests.conftest import CASES

PARENTS = ("single_finger", "pinch")
NOT_DRAWN = {"name", "level", "folder", "actuator", "fea", "body"}
STAGE_OF = {"kinematics": kinematics.run, "mesh": mesh.run, "case": case.run}
STAGES = list(STAGE_OF)
LONGEST = 10.0  # s of CPU time until a refusal
LONGEST_STAGE = 300  # s of a stage
LONGEST_SENTENCE = 700  # characters
FAR = [
    0.0, -0.0, 1.0, -1.0, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12, -1e12, 5e-324, 1e308,
    math.nan, math.inf, -math.inf,
]  # fmt: skip
FAR_WHOLE = [0, 1, 2, 3, 7, -1, 1000, 2**31, 2**32, 2**63, 10**30]
OTHER_KINDS: list[Any] = ["9_98", "", "nan", True, [], [1.0], {}]
Table = dict[str, dict[str, Any]]  # section, key and value


def _edges(metadata: list[Any]) -> list[float]:
    """The bounds of a field, values just within and beyond, half and double."""
    sides = ("ge", "gt", "le", "lt")
    bounds = [getattr(m, side) for m in metadata for side in sides if hasattr(m, side)]
    found = []
    for b in bounds:
        near = max(abs(b), 1e-9) * 1e-9
        found += [b, b + near, b - near, 2 * b, 0.5 * b]
    return found


def _of_kind(kind: Any, metadata: list[Any]) -> st.SearchStrategy[Any]:
    """Values of a field of type `kind`, allowed and not."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _of_kind(parts[0], [*metadata, *parts[1:]])
    if origin in (typing.Union, types.UnionType):
        return st.one_of(*(_of_kind(part, metadata) for part in parts if part is not type(None)))
    if origin is typing.Literal:
        return st.sampled_from([*parts, "nonsense", -1])
    if origin is tuple:
        if parts[-1] is Ellipsis:
            return st.lists(_of_kind(parts[0], metadata), max_size=3)
        return st.tuples(*(_of_kind(part, metadata) for part in parts)).map(list)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        fields = {key: _of_field(field) for key, field in kind.model_fields.items()}
        return st.fixed_dictionaries({}, optional=fields)
    if kind is bool:
        return st.booleans()
    if kind is int:
        near = [int(e) + d for e in _edges(metadata) if abs(e) < 1e15 for d in (-1, 0, 1)]
        return st.sampled_from([*FAR_WHOLE, *near]) | st.integers(-100, 10_000)
    if kind is float:
        numbers = st.floats(1e-6, 1e3) | st.floats(allow_nan=True)
        return st.sampled_from([*FAR, *_edges(metadata)]) | numbers
    return st.text("abc/._é", max_size=8)


def _of_field(field: FieldInfo) -> st.SearchStrategy[Any]:
    """Values of a field: of its type, near its default, and now and then of another kind."""
    drawn, other = _of_kind(field.annotation, field.metadata), st.sampled_from(OTHER_KINDS)
    if isinstance(field.default, int | float) and not isinstance(field.default, bool):
        kind = type(field.default)
        factors = st.sampled_from([0.5, 0.8, 0.9, 1.0, 1.1, 1.5, 2.0])
        near = factors.map(lambda factor: kind(factor * field.default))
        return st.one_of(near, near, near, drawn, drawn, other)
    return st.one_of(drawn, drawn, drawn, drawn, other)


def _keys() -> list[tuple[str, str, FieldInfo]]:
    """Section, key and field of every number of a scene."""
    numbers = []
    for section, field in Scene.model_fields.items():
        kinds = [field.annotation, *typing.get_args(field.annotation)]
        model = next((k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)
        if section not in NOT_DRAWN and model is not None:
            numbers += [(section, key, inner) for key, inner in model.model_fields.items()]
    return numbers


@st.composite
def scenes(draw: st.DrawFn) -> tuple[str, Table]:
    """A shipped scene, and one to three keys of it with other values."""
    table: Table = {}
    keys = st.sampled_from(_keys())
    drawn = draw(st.lists(keys, min_size=1, max_size=3, unique_by=lambda key: key[:2]))
    for section, key, field in drawn:
        table.setdefault(section, {})[key] = draw(_of_field(field))
    return draw(st.sampled_from(PARENTS)), table


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def _scene_text(parent: str, table: Table) -> str:
    """The scene.toml of a drawn scene, whose values hold at every level."""
    lines = [f"extends = {json.dumps(str(CASES / parent))}"]
    motion: dict[str, Any] = {"max_bend_step_deg": 15.0}  # few meshes
    table = table | {"motion": motion | table.get("motion", {})}
    for section, values in table.items():
        lines += [f"[{section}]", *(f"{key} = {_toml(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


class _Late(BaseException):
    """A stage is not over in its time."""


def _late(*_: Any) -> None:
    raise _Late


def _outcome(text: str, folder: Path, until: str) -> tuple[str, str]:
    """`accepted`, `warned` or `refused`, and the sentence that says why.

    AssertionError where a scene is too large, refused after too long, or ends in another way.
    """
    shutil.rmtree(folder, ignore_errors=True)
    write_text(folder / "scene.toml", text)
    begin, stage = time.process_time(), STAGES[0]
    signal.signal(signal.SIGALRM, _late)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            scene = load_scene(folder, "smoke")
            if scene.camera.centre is not None:
                render_settings(scene.camera, scene.sheet)
            piv_settings(scene.piv, scene.camera)
            size, sentences = predicted(scene), scene.remarks()
            assert size.cells <= MAX_CELLS, size
            assert size.disk <= MAX_DISK, size
            assert size.cpu <= MAX_CPU, size.cpu
            for stage in STAGES[: STAGES.index(until) + 1]:
                signal.alarm(LONGEST_STAGE)
                STAGE_OF[stage](scene, quiet=True)
        result = "warned" if sentences else "accepted"
    except (StageError, OSError) as error:
        sentences, result = [str(error)], "refused"
    except AssertionError:
        raise
    except BaseException as error:
        raise AssertionError(f"{text}\n{''.join(traceback.format_exception(error))}") from None
    finally:
        signal.alarm(0)
    took = time.process_time() - begin
    assert took < LONGEST or result != "refused", f"{text}\n{took:.0f} s: {sentences}"
    for sentence in sentences:
        assert "\n" not in sentence, f"{text}\n{sentence}"
        assert len(sentence) < LONGEST_SENTENCE, f"{text}\n{sentence}"
    return result, "; ".join(sentences)


def count_outcomes(examples: int, until: str) -> Counter[str]:
    """Count the outcomes of drawn scenes, the same each time; prints those that are faults."""
    counts: Counter[str] = Counter()
    options = {"max_examples": examples, "database": None, "deadline": None}
    options |= {"phases": [Phase.generate], "suppress_health_check": list(HealthCheck)}
    with tempfile.TemporaryDirectory() as folder:

        @seed(0)
        @settings(**options)
        @given(scenes())
        def each(scene: tuple[str, Table]) -> None:
            text = _scene_text(*scene)
            try:
                outcome, why = _outcome(text, Path(folder) / "scene", until)
            except AssertionError as error:
                outcome, why = "fault", str(error)
            counts[outcome] += 1
            if outcome == "fault":
                print(f"{outcome}: {text}{why}\n", flush=True)

        each()
    return counts
