"""reference/inputs.toml and the rows of the runs beside the nominal one."""

import pytest

from pipeline.scene.scene import load_scene
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.inputs import Input, read_inputs
from softfinger.__main__ import main
from tests.lab_scene import CASE


@pytest.fixture
def case(tmp_path):
    """A scene that extends single_finger, and its numbers."""
    folder = tmp_path / "cases" / "finger"
    folder.mkdir(parents=True)
    (folder / "scene.toml").write_text(f'extends = "{CASE}"\n')
    return folder, scene_numbers(StageFiles(load_scene(folder, "smoke")))


def changed_by(case, of):
    """The scene of a run beside the nominal one."""
    return load_scene(case[0], "smoke", of.overrides(case[1]), case[0] / of.name)


def test_each_run_changes_one_number(case):
    nominal = load_scene(case[0], "smoke")
    changed = {of.name: changed_by(case, of) for of in read_inputs(CASE)}
    assert changed["pressure"].motion.strokes[0].pressure_kpa == pytest.approx(21.0)
    assert changed["duration"].motion.strokes[0].duration == pytest.approx(0.44)
    for part in ("mesh", "numerics", "finger", "camera"):
        assert all(getattr(one, part) == getattr(nominal, part) for one in changed.values()), part


def test_the_only_stroke_needs_no_run_for_its_duration(case):
    pressure, duration = read_inputs(CASE)
    assert pressure.stretch(case[1]) is None
    assert duration.stretch(case[1]) == pytest.approx(1.1)
    strokes = 2 * case[1]["motion"]["strokes"]
    assert duration.stretch({"motion": {"strokes": strokes}}) is None


def asked(key: str, step: float = 0.001) -> Input:
    """What inputs.toml would say of one number."""
    return Input(name="one", key=key, step=step, limit=1.0, reason="r")


@pytest.mark.parametrize("key, step", [("finger.tip.length", 0.001), ("mesh.tip_cell", 0.0001)])
def test_a_number_of_a_table_or_of_a_level_is_changed(case, key, step):
    """finger.tip.thickness has no value in TOML; mesh.tip_cell is set by the level."""
    value = case[1]
    for name in key.split("."):
        value = value[name]
    assert asked(key, step).overrides(case[1]) == {key: value + step}
    run = changed_by(case, asked(key, step))
    for name in key.split("."):
        run = getattr(run, name)
    assert run == pytest.approx(value + step)


@pytest.mark.parametrize(
    "key", ["nothing.at.all", "motion", "motion.strokes.first", "motion.source", "motion.states"]
)
def test_a_key_that_is_no_number_of_the_scene_is_refused(case, key):
    with pytest.raises(ValueError, match="the scene has no number"):
        asked(key).overrides(case[1])


def test_a_scene_that_states_no_inputs_has_none(tmp_path):
    assert read_inputs(tmp_path) == ()


SOUND = 'format = "inputs"\nformat_version = 2\n'
INPUT = "[[input]]\nname = 'a'\nkey = 'b.c'\nstep = 0\nlimit = 1\nreason = 'r'"


@pytest.mark.parametrize(
    "text, message",
    [
        (SOUND.replace('"inputs"', '"x"') + INPUT, "format is 'x', not 'inputs'"),
        (SOUND.replace("2", "1") + INPUT, "format_version of this inputs file is 1"),
        (SOUND, "input: this key is missing"),
        (SOUND + INPUT, r"input\[0\]\.step: .* greater than 0"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, text, message):
    (tmp_path / "reference").mkdir()
    (tmp_path / "reference" / "inputs.toml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_inputs(tmp_path)


def test_command_asks_for_dpiv_toml(tmp_path, capsys):
    assert main(["compare", str(CASE), str(tmp_path), "--level", "smoke"]) == 2
    assert "dpiv.toml: missing" in capsys.readouterr().err
