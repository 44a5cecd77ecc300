"""What a change of a scene makes stale: the stages whose result it changes, and no other."""

import shutil
from functools import cache
from pathlib import PurePath
from typing import Any

import pytest
from pydantic import BaseModel

from pipeline.openfoam.base_case import BASE
from pipeline.runs.estimate import _EACH, _FLOW_ALONE, estimate, of_page
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME, FILMED, STAGES
from pipeline.scene.read_toml import FILE_KEYS
from pipeline.scene.scene import Scene, load_scene
from softfinger.options import open_moved
from tests.conftest import CASES, write_scene

FILES = {f"motion.{key}" for key in FILE_KEYS}  # whose content counts, not the name
PLACES = {"name", "level", "folder", "parents", "out", "notes"}  # of the run, not of its scene


def changed(value: Any) -> Any:
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, tuple | list):
        return (*value, changed(value[-1])) if value else (1,)
    return {**value, "more": 1} if isinstance(value, dict) else f"{value} more"


def variants(model: BaseModel, above: str = ""):
    """The dotted name of each key of a scene, and the scene with that key changed."""
    for name in type(model).model_fields:
        if not above and name in PLACES:
            continue
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            for key, inner in variants(value, f"{above}{name}."):
                yield key, model.model_copy(update={name: inner})
        else:
            yield f"{above}{name}", model.model_copy(update={name: changed(value)})


@cache
def scenes() -> dict[str, Scene]:
    """A scene with each section: those of a pinch, of a support and of a rigid body are added."""
    names = ("single_finger", "pinch", "validation/oscillating_cylinder")
    return {name: load_scene(CASES / name, "coarse") for name in names}


def keys() -> list[tuple[str, str]]:
    known = [(name, key) for name, scene in scenes().items() for key, _ in variants(scene)]
    return [(name, key) for name, key in known if key not in FILES]


def test_a_run_of_the_flow_alone_makes_neither_pictures_nor_piv(tmp_path):
    """Its solution is that of the whole run, which it takes over."""
    folder = write_scene(tmp_path / "tiny").folder
    whole, alone = (open_moved(folder, "tiny", None, filmed) for filmed in (None, False))
    assert alone.out == whole.out / "flow"
    assert {*whole.stale("report")} - {*alone.stale("report")} == FILMED
    for stage in ("solve", "sheet", "vortices_cfd", "loads"):
        assert alone.digest(stage) == whole.digest(stage)
    assert alone.digest("compare") != whole.digest("compare")
    coupled = open_moved(folder, "tiny", True, False)
    assert coupled.out == whole.out / "coupled" / "flow"
    assert coupled.scene.coupled
    again = open_moved(folder, "tiny", None, True)
    assert again.out == whole.out


def test_a_run_of_the_flow_alone_samples_as_often_as_piv_would(tmp_path):
    """Every picture was read and searched for vortices: half of a run's cost at smoke."""
    alone = open_moved(CASES / "single_finger", "smoke", None, False)
    assert alone.scene.sheet.every == 5
    whole = open_moved(CASES / "single_finger", "smoke", None, True)
    assert alone.digest("solve") == whole.digest("solve")
    assert alone.digest("sheet") != whole.digest("sheet")


def with_those_after(stages: set[str]) -> set[str]:
    """The stages, and all that read a result of one of them."""
    grown = stages | {stage.name for stage in STAGES if stages & {*stage.inputs}}
    return grown if grown == stages else with_those_after(grown)


@pytest.mark.filterwarnings("ignore:Pydantic serializer")
@pytest.mark.parametrize("name, key", keys())
def test_a_key_makes_stale_the_stages_that_name_it_and_those_after_them(
    name: str, key: str
) -> None:
    """That each stage names what it reads: tests/cases/test_keys_that_stages_read.py."""
    scene, before = scenes()[name], digests(name)
    after = Run(dict(variants(scene))[key])
    found = {stage.name for stage in STAGES if after.digest(stage.name) != before[stage.name]}
    section, inner = [*key.split("."), ""][:2]
    keys_of = {stage.name: stage.sections.get(section, ()) for stage in STAGES}
    naming = {stage for stage, keys in keys_of.items() if keys is True or inner in keys}
    assert found == with_those_after(naming)


@cache
def digests(name: str) -> dict[str, str]:
    run = Run(scenes()[name])
    return {stage.name: run.digest(stage.name) for stage in STAGES}


def test_the_table_names_sections_and_keys_that_there_are() -> None:
    """A misspelt key of a row would make a stage pass for fresh."""
    numbers = scenes()["pinch"].model_dump()
    for stage in STAGES:
        for section, keys in stage.sections.items():
            assert section in numbers
            assert keys is True or keys <= numbers[section].keys()


def test_of_the_system_folder_the_case_stage_owns_all_that_no_run_writes() -> None:
    """A template that its pattern leaves out would not be made again."""
    pattern = next(p for p in BY_NAME["case"].outputs if "/system/" in p)
    names = {path.name for path in (BASE / "system").iterdir()}
    own = {name for name in names if PurePath(f"case/interval_0/system/{name}").match(pattern)}
    assert names - own == {"numbers", "decomposeParDict"}


def test_content_of_a_file_counts_not_its_name(tmp_path) -> None:
    text = 'motion = { source = "fea", states = "states.h5" }\n'
    runs = []
    for place in ("one", "two"):
        scene = write_scene(tmp_path / place, more=text)
        shutil.copy(CASES / "single_finger/kinematics/states.h5", scene.folder)
        runs.append(Run(scene))
    assert runs[0].digest("sheet") == runs[1].digest("sheet")
    (tmp_path / "two" / "states.h5").write_bytes(b"another")
    assert Run(runs[1].scene).digest("kinematics") != runs[0].digest("kinematics")


def test_overrides_are_the_scene_with_another_number(tmp_path) -> None:
    scene = write_scene(tmp_path / "plain")
    other = write_scene(tmp_path / "other", more="[fluid]\ndensity = 1000.0\n")
    run = open_run(scene.folder, "tiny", {"fluid.density": 1000.0}, tmp_path / "place")
    assert run.out == tmp_path / "place"
    assert run.digest("sheet") == Run(other).digest("sheet")
    assert run.digest("kinematics") == Run(scene).digest("kinematics")


def test_a_coupled_run_has_versions_and_costs_of_its_own(tmp_path) -> None:
    """A new coupling makes no prescribed run stale."""
    plain = Run(scenes()["single_finger"])
    coupled = open_run(plain.scene.folder, "coarse", {"motion.source": "structure"}, tmp_path)
    assert coupled.made_from("case")["version"] > plain.made_from("case")["version"]
    empty = open_run(plain.scene.folder, "coarse", {}, tmp_path)
    # docs/coupling.md has 1.01 to 1.3 at draft and coarse, and more at smoke
    assert 1.1 < estimate(coupled, "solve")[0] / estimate(empty, "solve")[0] < 1.4


def test_the_cost_of_a_stage_follows_from_what_it_reads() -> None:
    """A scene of 1,920 pictures of the sheet was predicted as one of 210: 65 s in place of 256."""
    coarse, long = (
        Run(load_scene(CASES / "single_finger", "coarse", {"motion.end_time": end}))
        for end in (0.42, 1.68)
    )
    for stage in STAGES:
        known = estimate(coarse, stage.name, recorded=False)[0]
        if stage.grows:
            assert known == pytest.approx(stage.cost[0] + 0.5, rel=0.02)  # that of this very run
            later = estimate(long, stage.name, recorded=False)[0]
            assert later - known == pytest.approx(3 * stage.cost[0], rel=0.02)
    half = {"camera.columns": coarse.scene.camera.columns // 2}  # as many frames of half the size
    small = Run(load_scene(CASES / "single_finger", "coarse", half))
    images = [estimate(run, "images", recorded=False)[0] - 0.5 for run in (coarse, small)]
    assert images[1] == pytest.approx((0.5 + 0.5 * _EACH) * images[0], rel=0.02)
    alone = Run(coarse.scene.model_copy(update={"filmed": False}))
    without = sum(stage.cost[0] + 0.5 for stage in STAGES if stage.name in FILMED)
    without += (1 - _FLOW_ALONE) * BY_NAME["figures"].cost[0]
    assert of_page(coarse, False) - of_page(alone, False) == pytest.approx(without, rel=0.02)


def test_a_pinch_is_compared_with_the_single_finger_that_moves_as_it_does(tmp_path) -> None:
    law = scenes()["pinch"].model_copy(update={"parents": (tmp_path,)})
    motion = law.motion.model_copy(update={"source": "structure"})
    coupled = law.model_copy(update={"motion": motion})
    out = tmp_path / "out" / law.level
    for scene, beside in ((law, out), (coupled, out / "coupled")):
        before = [Run(one).digest("compare") for one in (law, coupled)]
        beside.mkdir(parents=True)
        (beside / "vortices_cfd.csv").write_text("time\n")
        after = [Run(one).digest("compare") for one in (law, coupled)]
        changes = [old != new for old, new in zip(before, after, strict=True)]
        assert changes == [scene is law, scene is coupled]


def test_ranks_count_where_a_study_compares_them() -> None:
    """Then the solver's result and all that is made of it differ; without them none does."""
    scene = scenes()["single_finger"]
    one, two = Run(scene, ranks=1), Run(scene, ranks=2)
    differ = {stage.name for stage in STAGES if one.digest(stage.name) != two.digest(stage.name)}
    assert differ == with_those_after({"solve"})
