"""Scenes as they are shipped, inherited and resolved; which stages a key makes again."""

import shutil
from pathlib import Path

import pytest
from fileio.stages import STAGES
from hypothesis import given
from hypothesis import strategies as st
from pipeline.stage_settings import make_rules, settings_of, write_settings

from fileio.errors import StageError
from pipeline.kinematics.stage import kinematics_values
from pipeline.openfoam.base_case import template_files, templates_digest
from pipeline.scene.scene import load_scene
from pipeline.scene.sections import Numerics
from tests.conftest import ROOT, write_scene

SCENES = sorted(p.parent for p in (ROOT / "cases").glob("*/scene.toml"))


@pytest.mark.parametrize("folder", SCENES, ids=lambda p: p.name)
@pytest.mark.parametrize("level", ["smoke", "draft", "coarse", "medium", "fine", "reference"])
def test_every_shipped_scene_is_valid_at_every_level(folder, level):
    assert load_scene(folder, level).level == level


@pytest.mark.parametrize("folder", SCENES, ids=lambda p: p.name)
def test_the_levels_that_are_refined_together_share_one_convection_scheme(folder):
    levels = ["draft", "coarse", "medium", "fine", "reference"]
    assert len({load_scene(folder, level).numerics.convection for level in levels}) == 1


def test_a_finger_near_the_bottom_is_warned_of_and_one_that_hits_it_refused(tmp_path):
    assert write_scene(tmp_path / "as_shipped").remarks() == []
    scene = write_scene(tmp_path / "near", more="[finger]\nroot = [0.0, 0.16]")
    assert "0.1 m" in scene.remarks()[0]
    kinematics_values(scene)
    with pytest.raises(StageError, match=r"hits the bottom at .* raise finger.root"):
        kinematics_values(write_scene(tmp_path / "deep", more="[finger]\nroot = [0.0, 0.065]"))


def test_lengths_that_are_not_given_go_with_the_size_of_the_finger(tmp_path):
    more = "[finger]\nlength = 0.14\n[mesh]\ntip_transition = 0.03"
    for name, text, lengths in (
        ("one", "", (0.012, 0.02, 0.002)),
        ("two", more, (0.024, 0.03, 0.004)),
    ):
        mesh = write_scene(tmp_path / name, more=text).mesh
        assert (mesh.tip_distance, mesh.tip_transition, mesh.wall_distance) == lengths


def test_missing_scene_and_level_name_what_there_is(tmp_path):
    with pytest.raises(StageError, match="no such scene"):
        load_scene(tmp_path / "nowhere")
    with pytest.raises(StageError, match="coarse, draft, fine, medium, reference, smoke"):
        load_scene(ROOT / "cases" / "single_finger", "huge")
    with pytest.raises(StageError, match=r"no level .smok.; did you mean smoke[?]"):
        load_scene(ROOT / "cases" / "single_finger", "smok")
    (tmp_path / "scene.toml").write_text(f"extends = '{ROOT}/cases/single_fingr'\n")
    with pytest.raises(StageError, match=r"extends = .*: no .*; did you mean single_finger[?]"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    "old, new, stages",
    [
        ("", "[piv]\nspacing = 4\n", {"piv"}),
        ("", "[fluid]\ndensity = 1000.0\n", {"case"}),
        ("", "[sheet]\nspacing = 2e-3\n", {"sheet"}),
        ("", "[camera]\nseed = 7\n", {"images"}),
        ("write_interval = 0.01", "write_interval = 0.02", {"case"}),
        # mesh intervals begin with pictures, and shapes cover overlaps of so many time steps
        ("", "[sheet]\nrate_hz = 250.0\n", {"mesh", "case", "images"}),
        ("time_step = 1e-3", "time_step = 5e-4", {"mesh", "case"}),
    ],
)
def test_a_number_changes_only_the_stages_that_use_it(tmp_path, old, new, stages):
    scene = write_scene(tmp_path / "scene")
    assert set(write_settings(scene)) == {stage.target for stage in STAGES}
    assert write_settings(scene) == []
    path = scene.folder / "scene.toml"
    path.write_text(
        path.read_text().replace(old or "[levels.tiny]", new + "[levels.tiny]" * (not old))
    )
    assert set(write_settings(load_scene(scene.folder, "tiny"))) == stages


def base_case(folder: Path, files: dict[str, str]) -> Path:
    """A base case of few files, written in the order given."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_the_digest_of_the_templates_is_of_names_and_content_alone(tmp_path):
    files = {"system/fvSolution": "tolerance 1e-6;", "system/fvSchemes": "Euler", "0/p": "0"}
    one = base_case(tmp_path / "one", files)
    other = base_case(tmp_path / "elsewhere" / "two", dict(reversed(files.items())))
    assert [str(path.relative_to(one)) for path in template_files(one)] == sorted(files)
    assert templates_digest(one) == templates_digest(other)
    moved = {name.replace("0/p", "1/p"): text for name, text in files.items()}
    changed = [
        moved,
        files | {"system/fvSolution": "tolerance 1e-7;"},
        files | {"system/fvConstraints": ""},
    ]
    digests = {templates_digest(base_case(tmp_path / f"{k}", c)) for k, c in enumerate(changed)}
    assert len(digests | {templates_digest(one)}) == 4
    with pytest.raises(StageError, match="git checkout cases/_base"):
        templates_digest(tmp_path / "nowhere")


def test_another_template_makes_the_case_again_and_what_is_before_it_not(tmp_path, monkeypatch):
    scene = write_scene(tmp_path / "scene")
    write_settings(scene)
    base = tmp_path / "base"
    shutil.copytree(ROOT / "cases" / "_base", base)
    monkeypatch.setattr("pipeline.stage_settings.templates_digest", lambda: templates_digest(base))
    assert write_settings(scene) == []
    (base / "system" / "fvSolution").open("a").write("// a remark\n")
    assert write_settings(scene) == ["case"]


@pytest.mark.parametrize("level", ["smoke", "coarse"])
@pytest.mark.parametrize("folder", SCENES, ids=lambda p: p.name)
def test_a_shipped_scene_finds_the_states_it_names_or_inherits(folder, level):
    scene = load_scene(folder, level)
    assert scene.motion.states is None or (scene.folder / scene.motion.states).is_file()
    assert "missing" not in settings_of(scene, "kinematics")["files"].values()


def test_a_scene_cannot_extend_itself(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(f'extends = "../{other}"\n')
    with pytest.raises(StageError, match="break the circle"):
        load_scene(tmp_path / "a")
    (tmp_path / "a" / "scene.toml").write_text("extends = 1\n")
    with pytest.raises(StageError, match="give the folder"):
        load_scene(tmp_path / "a")


@given(st.text(max_size=60))
def test_any_text_is_a_scene_or_one_sentence(tmp_path_factory, text):
    folder: Path = tmp_path_factory.mktemp("scene")
    (folder / "scene.toml").write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(StageError):
        load_scene(folder)


@pytest.mark.parametrize(
    "time_step, rate, steps",
    [
        (1e-3, 125.0, 2),
        (0.5e-3, 500.0, 4),
        (0.5e-3, 250.0, 4),
        (4e-3, 250.0, 1),
        (1e-3, 1e3 / 3, 1),
    ],
)
def test_power_is_sampled_at_least_every_2_ms_and_whenever_the_sheet_is(time_step, rate, steps):
    numerics = Numerics(time_step=time_step)
    assert numerics.balance_steps(rate) == steps
    assert numerics.sampling_steps(rate) % steps == 0


def test_make_is_told_of_every_file_that_a_scene_is_made_of(tmp_path):
    """Also where the scene and its parent lie outside cases/."""
    parent = write_scene(tmp_path / "a b")
    child = tmp_path / "child"
    child.mkdir()
    (child / "scene.toml").write_text('extends = "../a b"\n')
    scene = load_scene(child, parent.level)
    first, *others = make_rules(scene).splitlines()
    target, files = first.split(": ", 1)
    assert target == str(scene.out / "settings" / ".stamp")
    named = [name.replace("\0", " ") for name in files.replace("\\ ", "\0").split()]
    assert {Path(name).resolve() for name in named} >= {
        child / "scene.toml",
        parent.folder / "scene.toml",
        (parent.folder / parent.motion.states).resolve(),
    }
    assert len(others) == len(named)
